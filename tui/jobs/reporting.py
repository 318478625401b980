"""Makes reports, comparisons and the page of a batch from session files."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.resources import files
from math import isfinite, nan
from os.path import relpath
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from daq import read_session
from daq.files import file_sha256, json_in_html, make_room, write_named
from daq.vehicle import parameter_unit
from dbc.words import printable
from identify import Identification, identify, identify_parameters
from identify.batch import Cell, Row

from ..output import PAGE_ENDINGS, Stage, require_ending
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
    from identify.report.content import report_of
    from identify.report.evidence import CrossChecks, cross_checks
    from identify.report.page import Source
    from identify.report.typeset import drawings, html_of, pdf_of

    recorded = read_session(session)
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
        today, sha256 = datetime.now(UTC).date().isoformat(), file_sha256(session)
        source = Source(session.name, sha256, version("bumpbench"), libraries, today, *signed)
        report = report_of(recorded, result, checks, source)
        stage(0.7, "drawing")
        # The PDF takes longest: it is begun first.
        sheets = None if pdf is None else pool.submit(pdf_of, report)
        text = html_of(report, drawings(report, pool))
        write_named(html, text.encode(errors="backslashreplace"))  # a file's name may not be UTF-8
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

    pictures = [picture for section in report.sections for picture in section.pictures]
    blocks = (block for section in report.sections for block in section.blocks)
    pictures += [still_cars(block) for block in blocks if isinstance(block, MovingCars)]
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
    return map_items(_result_without_residuals, paths, workers, stage)


def _result_without_residuals(path: str) -> Identification:
    """Return the result of a session file without residuals."""
    result = identify_parameters(read_session(path))
    if result.estimation is None:
        return result
    without_values = tuple(replace(run, values={}) for run in result.estimation.residuals)
    return replace(result, estimation=replace(result.estimation, residuals=without_values))


def labels_of(paths: Sequence[Path]) -> list[str]:
    """Return the names of files, with their folders where two names are equal."""
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}/{path.stem}" for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def batch_page(columns: Sequence[str], rows: Sequence[Row], folder: Path) -> str:
    """Return the page of a batch: a table with filters, trends by vehicle, links to reports.

    It is one HTML file with its data, style and script; nothing is fetched.  `folder`: where it
    will be; the links lead from there to reports that are next to their sessions.
    """
    estimated = [name for name in columns if f"{name}_std" in columns]
    names = [name for name in estimated if not name.endswith(("_hz", "_damping"))]  # of modes
    # Elements of an axle, whose names begin with a word, have units of many kinds: none is shown.
    units = [parameter_unit(n) if len(n.partition("_")[0]) == 1 else "" for n in names]
    page_rows = []
    for row in rows:
        values = [_rounded(row.get(name)) for name in names]
        stds = [_rounded(row.get(f"{name}_std")) for name in names]
        report = Path(str(row["file"])).with_suffix(".html")
        link = quote(Path(relpath(report, folder)).as_posix()) if report.is_file() else ""
        texts = [str(row.get(name) or "") for name in ("vehicle", "created", "origin", "verdict")]
        reasons = printable(str(row.get("reasons") or ""), 300)
        judged = [*texts, _rounded(row.get("chi2_per_n")), reasons]
        page_rows.append([str(row["file"]), link, *judged, values, stds])
    document = {"parameters": list(zip(names, units, strict=True)), "rows": page_rows}
    here = files(__package__)
    page = (here / "batch_page.html").read_text("utf-8")
    for placeholder, content in (
        ("STYLE", files("identify.report").joinpath("report.css").read_text("utf-8")),
        ("SCRIPT", (here / "batch_page.js").read_text("utf-8")),
        ("DATA", json_in_html(document, separators=(",", ":"))),
    ):
        page = page.replace(f"<!--{placeholder}-->", content, 1)
    return page


def _rounded(cell: Cell) -> float | None:
    """Return a number, also one that a CSV holds as text; None where there is none."""
    try:
        number = float(cell if cell is not None else nan)
    except ValueError:
        return None
    return float(f"{number:.7g}") if isfinite(number) else None
