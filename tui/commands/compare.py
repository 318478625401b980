"""`bumpbench compare`: finds what differs between sessions, and how surely."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode
from ..options import Force, JsonResult, Page


def compare(
    sessions: Annotated[
        list[Path],
        typer.Argument(
            help="Session files: the one to compare with, then the others in order of time."
        ),
    ],
    json: JsonResult = False,
    page: Page = None,
    force: Force = False,
) -> int:
    """Compare sessions with the first one: differences with their significance, and trends.

    --page draws them, too.
    """
    from daq.files import write_named
    from identify.compare import compare as compared

    from ..diagnostics import PAGES, require_ending
    from ..jobs.comparing import comparison_lines, identified, labels_of
    from ..output import print_json, print_line, progress
    from ..proposal_questions import require_place

    if len(sessions) < 2:
        raise typer.BadParameter("name two sessions or more")
    if page is not None:
        require_ending(page, "page", PAGES)
        require_place(page, force)
    with progress("compare") as stage:
        stage(0.0, f"{len(sessions)} sessions")
        results = identified([str(path) for path in sessions], stage)
    labels = labels_of(sessions)
    comparison = compared(labels, results)
    if page is not None:
        from identify.report import comparison_html

        fits = [result.estimation for result in results if result.estimation is not None]
        write_named(page, comparison_html(comparison, fits).encode())
    if json:
        print_json(comparison.document())
    else:
        for line in comparison_lines(comparison):
            print_line(line)
    refused = "refused" in comparison.verdicts
    return ExitCode.ANSWER_IS_NO if refused else ExitCode.OK
