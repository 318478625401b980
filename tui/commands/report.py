"""`bumpbench report`: a session in, a page that convinces out."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ..diagnostics import ExitCode, say


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
    import gc
    from concurrent.futures import ThreadPoolExecutor

    from ..output import progress
    from ..reporting import helpers, make_room

    out = session.with_suffix(".html") if out is None else out
    with progress("report") as stage, helpers() as pool, ThreadPoolExecutor(1) as reader:
        stage(0.02, "reading")
        import daq

        reading = reader.submit(daq.read_foreign_session, session)  # while the libraries load
        import identify as method
        from identify.estimation import Estimation
        from identify.report.content import report_of
        from identify.report.decays import decay_section
        from identify.report.html import drawings, html_of

        from ..output import print_line
        from ..reporting import source_of, write_figures, write_file
        from ..result import identification_document

        gc.freeze()  # what is loaded stays, and is searched for garbage no more
        recorded = reading.result()
        for path in (out, *([] if pdf is None else [pdf])):
            make_room(path)
        begun = {}

        def fitted(estimation: Estimation) -> None:
            begun.update(drawings(decay_section(estimation).pictures, pool))

        result = method.identify(recorded, lambda done, text: stage(0.6 * done, text), pool, fitted)
        stage(0.6, "gathering")
        page = report_of(recorded, result, source_of(session))
        stage(0.7, "drawing")
        begun |= drawings((p for p in page.pictures if p.key not in begun), pool)
        write_file(out, html_of(page, identification_document(result), begun).encode())
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
    quality = result.quality
    say(f"verdict: {': '.join([str(quality.verdict), *quality.reasons[:1]])}")
    refused = quality.verdict == "refused"
    return ExitCode.ANSWER_IS_NO if refused else ExitCode.OK
