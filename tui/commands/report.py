"""`bumpbench report`: writes a report with all evidence from a session."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode, say
from ..options import Force, Page, SessionFile


class FigureFormat(StrEnum):
    """Formats of single figures."""

    SVG = "svg"
    PNG = "png"


def report(
    session: SessionFile,
    page: Page = None,
    pdf: Annotated[Path | None, typer.Option(help="Also write the report as PDF.")] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Also write each figure, into this folder.")
    ] = None,
    figure_format: Annotated[
        FigureFormat | None,
        typer.Option("--format", help="Format of the figures of --figures; default: svg."),
    ] = None,
    operator: Annotated[
        str, typer.Option(help="Name of the person who measured, for the certificate.")
    ] = "",
    approver: Annotated[
        str, typer.Option(help="Name of the person responsible for the result.")
    ] = "",
    force: Force = False,
    json: Annotated[bool, typer.Option("--json", help="Print files and verdict as JSON.")] = False,
) -> int:
    """Identify a session and write its report as one HTML page.

    The page is next to the session, with its name, unless --page is given.
    """
    from dbc import InputError
    from identify import Verdict
    from identify.words import SEVERITY

    from ..jobs.reporting import write_figures, write_report
    from ..output import print_json, print_line, progress
    from ..proposal_questions import require_place

    written: list[str] = []

    def wrote(path: Path) -> None:
        written.append(str(path))
        if not json:
            print_line(str(path))

    page = page or session.parent / f"{session.stem}.html"
    for path in (page, pdf):
        if path is not None:
            require_place(path, force)
    if figures is not None and figures.exists() and not figures.is_dir():
        raise InputError(str(figures), "is not a folder", "name another folder")
    if figure_format is not None and figures is None:
        raise InputError("--format", "is for --figures", "name a folder with --figures")
    with progress("report") as stage:
        made = write_report(session, page, pdf, stage, wrote, (operator, approver))
        if figures is not None:
            stage(0.95, "figures")
            for path in write_figures(made, figures, figure_format or FigureFormat.SVG):
                wrote(path)
    quality = made.result.quality
    if json:
        verdict = {"verdict": str(quality.verdict), "reasons": list(quality.reasons)}
        print_json({"session": str(session), "files": written, **verdict})
    say(f"verdict: {quality.verdict}")
    for finding in quality.findings:
        say(f"{SEVERITY[Verdict.of(finding.severity)]}: {finding.text}")
    return ExitCode.ANSWER_IS_NO if quality.verdict is Verdict.REFUSED else ExitCode.OK
