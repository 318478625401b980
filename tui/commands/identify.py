"""`bumpbench identify`, `report` and `compare`: results of sessions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from .. import output
from ..options import Force, JsonResult, Page, SessionFile
from ..output import PAGE_ENDINGS, ExitCode, require_ending, require_place, say


def identify(session: SessionFile, json: JsonResult = False) -> int:
    """Identify the physical parameters of a session's vehicle."""
    import daq
    from daq.files import file_sha256
    from identify import identify as identify_session

    from ..result import print_identification

    with output.progress("identify") as stage:
        stage(0.05, "reading")
        recorded = daq.read_session(session)
        result = identify_session(recorded, stage)
    if json:
        output.print_json(result.document(file_sha256(session)))
    else:
        print_identification(result, {})
    return ExitCode.ANSWER_IS_NO if result.quality.verdict == "refused" else ExitCode.OK


def report(
    session: SessionFile,
    page: Page = None,
    pdf: Annotated[Path | None, Option(help="Also write the report as PDF.")] = None,
    figures: Annotated[Path | None, Option(file_okay=False, help="Folder for its figures.")] = None,
    figure_format: Annotated[
        Literal["svg", "png"] | None, Option("--format", help="Of --figures; default: svg.")
    ] = None,
    operator: Annotated[str, Option(help="Who measured, for the certificate.")] = "",
    approver: Annotated[str, Option(help="Who is responsible for the result.")] = "",
    force: Force = False,
    json: JsonResult = False,
) -> int:
    """Identify a session and write its report as one HTML page.

    The page is next to the session, with its name, unless --page is given.
    """
    from dbc import InputError
    from identify import Verdict
    from identify.words import SEVERITY

    from ..jobs.reporting import write_figures, write_report

    written: list[str] = []

    def wrote(path: Path) -> None:
        written.append(str(path))
        if not json:
            output.print_line(str(path))

    if not session.exists():  # its folder is that of the page
        raise InputError(str(session), "no such file", "name a session file")
    page = page or session.parent / f"{session.stem}.html"
    for path in filter(None, (page, pdf)):
        require_place(path, force)
    if figure_format is not None and figures is None:
        raise InputError("--format", "is for --figures", "name a folder with --figures")
    with output.progress("report") as stage:
        made = write_report(session, page, pdf, stage, wrote, (operator, approver))
        if figures is not None:
            stage(0.95, "figures")
            for path in write_figures(made, figures, figure_format or "svg"):
                wrote(path)
    quality = made.result.quality
    if json:
        verdict = {"verdict": str(quality.verdict), "reasons": list(quality.reasons)}
        output.print_json({"session": str(session), "files": written, **verdict})
    say(f"verdict: {quality.verdict}")
    for finding in quality.findings:
        say(f"{SEVERITY[Verdict.of(finding.severity)]}: {finding.text}")
    return ExitCode.ANSWER_IS_NO if quality.verdict is Verdict.REFUSED else ExitCode.OK


def compare(
    sessions: Annotated[list[Path], Argument(help="The one to compare with, then others by time.")],
    json: JsonResult = False,
    page: Page = None,
    force: Force = False,
) -> int:
    """Compare sessions with the first one: differences with their significance, and trends.

    --page draws them, too.
    """
    from daq.files import write_named
    from identify.compare import compare as compared

    from ..jobs.reporting import identify_files, labels_of

    if len(sessions) < 2:
        raise typer.BadParameter("name two sessions or more")
    if page is not None:
        require_ending(page, "page", PAGE_ENDINGS)
        require_place(page, force)
    with output.progress("compare") as stage:
        results = identify_files([str(path) for path in sessions], stage)
    comparison = compared(labels_of(sessions), results)
    if page is not None:
        from identify.report.comparison import comparison_html

        write_named(page, comparison_html(comparison).encode(errors="backslashreplace"))
    if json:
        output.print_json(comparison.document())
    else:
        from ..result import print_comparison

        print_comparison(comparison)
    return ExitCode.ANSWER_IS_NO if "refused" in comparison.verdicts else ExitCode.OK
