"""`bumpbench compare`: finds what differs between sessions, and how surely."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode
from ..options import JsonResult


def compare(
    sessions: Annotated[
        list[Path],
        typer.Argument(
            help="Session files: the one to compare with, then the others in order of time."
        ),
    ],
    json: JsonResult = False,
    page: Annotated[
        Path | None, typer.Option(help="Also write a page with all differences (*.html).")
    ] = None,
) -> int:
    """Compare sessions with the first one: differences with their significance, and trends."""
    from daq.files import make_room, write_named
    from identify.compare import compare as compared

    from ..diagnostics import PAGES, require_ending
    from ..jobs.comparing import identified, print_comparison
    from ..output import print_json, progress

    if len(sessions) < 2:
        raise typer.BadParameter("name two sessions or more")
    if page is not None:
        require_ending(page, "page", PAGES)
        make_room(page)
    with progress("compare") as stage:
        stage(0.0, f"{len(sessions)} sessions")
        results = identified([str(path) for path in sessions], stage)
    labels = _labels(sessions)
    comparison = compared(labels, results)
    if page is not None:
        from identify.report import comparison_html

        fits = [result.estimation for result in results if result.estimation is not None]
        write_named(page, comparison_html(comparison, fits).encode())
    if json:
        print_json(comparison.document())
    else:
        print_comparison(comparison)
    refused = "refused" in comparison.verdicts
    return ExitCode.ANSWER_IS_NO if refused else ExitCode.OK


def _labels(paths: list[Path]) -> list[str]:
    """Return the names of files, with their folders where two names are equal."""
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}/{path.stem}" for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]
