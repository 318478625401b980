"""`bumpbench report`: writes a report with all evidence from a session."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode, say
from ..options import SessionFile


class FigureFormat(StrEnum):
    """Formats of single figures."""

    SVG = "svg"
    PNG = "png"


def report(
    session: SessionFile,
    out: Annotated[
        Path | None, typer.Option(help="HTML file; default: next to the session, with its name.")
    ] = None,
    pdf: Annotated[Path | None, typer.Option(help="Also write the report as PDF.")] = None,
    figures: Annotated[
        Path | None, typer.Option(help="Also write each figure, into this folder.")
    ] = None,
    figure_format: Annotated[
        FigureFormat, typer.Option("--format", help="Format of the single figures.")
    ] = FigureFormat.SVG,
    operator: Annotated[
        str, typer.Option(help="Name of the person who measured, for the certificate.")
    ] = "",
    approver: Annotated[
        str, typer.Option(help="Name of the person responsible for the result.")
    ] = "",
    json: Annotated[bool, typer.Option("--json", help="Print files and verdict as JSON.")] = False,
) -> int:
    """Identify a session and write its report as one HTML page."""
    from dbc import InputError

    from ..jobs.reporting import write_figures, write_report
    from ..output import print_json, print_line, progress

    written: list[str] = []

    def wrote(path: Path) -> None:
        written.append(str(path))
        if not json:
            print_line(str(path))

    out = session.parent / f"{session.stem}.html" if out is None else out
    if figures is not None and figures.exists() and not figures.is_dir():
        raise InputError(str(figures), "is not a folder", "name another folder")
    with progress("report") as stage:
        page, quality = write_report(session, out, pdf, stage, wrote, (operator, approver))
        if figures is not None:
            stage(0.95, "figures")
            for path in write_figures(page, figures, figure_format.value):
                wrote(path)
    if json:
        verdict = {"verdict": str(quality.verdict), "reasons": list(quality.reasons)}
        print_json({"session": str(session), "files": written, **verdict})
    say(f"verdict: {': '.join([str(quality.verdict), *quality.reasons[:1]])}")
    refused = quality.verdict == "refused"
    return ExitCode.ANSWER_IS_NO if refused else ExitCode.OK
