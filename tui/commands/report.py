"""`bumpbench report`: a session in, a page that convinces out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode


class FigureFormat(StrEnum):
    """Formats of single figures."""

    SVG = "svg"
    PNG = "png"


def report(
    session: Annotated[Path, typer.Argument(help="Session file (HDF5).")],
    out: Annotated[
        Path | None, typer.Option(help="HTML file; default: beside the session, its name, .html.")
    ] = None,
    pdf: Annotated[Path | None, typer.Option(help="Also write the report as PDF.")] = None,
    figures: Annotated[Path | None, typer.Option(help="Also write each figure here.")] = None,
    figure_format: Annotated[
        FigureFormat, typer.Option("--format", help="Format of the single figures.")
    ] = FigureFormat.SVG,
) -> int:
    """Write what a session says of its vehicle as one HTML page: open it, print it, send it."""
    import daq
    import identify as method
    from identify.report.content import report_of
    from identify.report.html import html_of

    from ..output import print_line, progress
    from ..reporting import helpers, make_room, source_of, write_figures, write_file
    from ..result import identification_document

    out = session.with_suffix(".html") if out is None else out
    with progress("report") as stage, helpers() as pool:
        stage(0.02, "reading")
        recorded = daq.read_foreign_session(session)
        for path in (out, *([] if pdf is None else [pdf])):
            make_room(path)
        result = method.identify(recorded, lambda done, text: stage(0.6 * done, text), pool)
        stage(0.6, "gathering")
        page = report_of(recorded, result, source_of(session))
        stage(0.7, "drawing")
        write_file(out, html_of(page, identification_document(result), pool).encode())
        print_line(str(out))
        if pdf is not None:
            from identify.report.pdf import pdf_of

            stage(0.85, "PDF")
            write_file(pdf, pdf_of(page))
            print_line(str(pdf))
        if figures is not None:
            stage(0.95, "figures")
            for path in write_figures(page, figures, figure_format.value):
                print_line(str(path))
    refused = result.quality.verdict == "refused"
    return ExitCode.ANSWER_IS_NO if refused else ExitCode.OK
