"""Reports and comparisons of session files, made with several processes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from daq import read_session
from daq.files import file_sha256, make_room, write_named
from identify import Identification, identify_parameters

from ..diagnostics import PAGE_ENDINGS, require_ending
from ..output import Stage
from .executors import map_items, processes

if TYPE_CHECKING:
    from identify.report.page import Report


def write_report(
    session: Path,
    html: Path,
    pdf: Path | None,
    stage: Callable[[float, str], None],
    written: Callable[[Path], None],
    signed: tuple[str, str] = ("", ""),
) -> Report:
    """Identify a session and write its report.

    `html` and `pdf`: files to write; no PDF if None.  `stage`: called with the share done, 0..1,
    and the present stage.  `written`: called with each finished file.  `signed`: names of the
    operator and of the approver.  Raises InputError if the session cannot be read, or a file has
    another ending or cannot be written.
    """
    stage(0.02, "reading")
    import daq
    from identify import identify
    from identify.report.content import report_of
    from identify.report.evidence import CrossChecks, cross_checks
    from identify.report.page import Source
    from identify.report.typeset import drawings, html_of, pdf_of

    recorded = daq.read_session(session)
    require_ending(html, "page", PAGE_ENDINGS)
    make_room(html)
    if pdf is not None:
        require_ending(pdf, "printed report", (".pdf",))
        make_room(pdf)
    modules = ("identify.report.content", "identify.report.typeset")
    with processes(2, (*modules, "matplotlib.backends.backend_svg")) as pool:
        result = identify(recorded, lambda done, text: stage(0.6 * done, text))
        stage(0.6, "gathering")
        checks = cross_checks(result.estimation) if result.estimation else CrossChecks()
        libraries = {name: version(name) for name in ("numpy", "scipy", "h5py", "matplotlib")}
        today = datetime.now(UTC).date().isoformat()
        source = Source(
            session.name, file_sha256(session), version("bumpbench"), libraries, today, *signed
        )
        report = report_of(recorded, result, checks, source)
        stage(0.7, "drawing")
        # The PDF takes longest: it is begun first.
        sheets = None if pdf is None else pool.submit(pdf_of, report)
        write_named(html, html_of(report, drawings(report.pictures, pool)).encode())
        written(html)
        if pdf is not None and sheets is not None:
            stage(0.85, "PDF")
            write_named(pdf, sheets.result())
            written(pdf)
    return report


def write_figures(report: Report, folder: Path, kind: str) -> list[Path]:
    """Write each picture of a report as `svg` or `png`, moving cars as stills; return the files."""
    from identify.report.cars import still_cars
    from identify.report.page import MovingCars, png_of, svg_of

    pictures = list(report.pictures)
    for section in report.sections:
        moving = [block for block in section.blocks if isinstance(block, MovingCars)]
        pictures += map(still_cars, moving)
    paths = []
    for picture in pictures:
        path = folder / f"{picture.key}.{kind}"
        write_named(path, png_of(picture) if kind == "png" else svg_of(picture).encode())
        paths.append(path)
    return paths


def identify_files(paths: Sequence[str], stage: Stage) -> list[Identification]:
    """Return the results of session files, identified as many at a time as there are processors.

    The residuals, which would fill the memory in a long trend, are left out.  `stage`: called with
    the share done, 0..1.  Raises InputError if one cannot be read.
    """
    workers = min(len(paths), os.cpu_count() or 1)
    return map_items(_result_without_residuals, paths, workers, stage, "compare")


def _result_without_residuals(path: str) -> Identification:
    """Return the result of a session file."""
    result = identify_parameters(read_session(path))
    if result.estimation is None:
        return result
    without_values = tuple(replace(run, values={}) for run in result.estimation.residuals)
    estimation = replace(result.estimation, residuals=without_values)
    return replace(result, estimation=estimation, residuals=())


def labels_of(paths: Sequence[Path]) -> list[str]:
    """Return the names of files, with their folders where two names are equal."""
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}/{path.stem}" for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]
