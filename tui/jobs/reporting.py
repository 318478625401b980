"""Writes a report with several processes; its files are complete or absent."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from daq.files import file_sha256, make_room, write_named

from ..diagnostics import PAGES, SHEETS, require_ending
from .executors import helpers

if TYPE_CHECKING:  # slow to load
    from identify.report import Report

_HEAVY = ("identify.report", "matplotlib.backends.backend_svg")
_LIBRARIES = ("numpy", "scipy", "h5py", "matplotlib")


def write_report(
    session: Path,
    html: Path,
    pdf: Path | None,
    stage: Callable[[float, str], None],
    written: Callable[[Path], None],
    signed: tuple[str, str] = ("", ""),
) -> Report:
    """Identify a session and write its report.

    `html` and `pdf`: what to write; no PDF if None.  `stage`: called with the share done, 0..1, and
    the present stage.  `written`: called with each finished file.  `signed`: names of the operator
    and of the approver.  Raises InputError if the session cannot be read, or a file has another
    ending or cannot be written.
    """
    stage(0.02, "reading")
    import daq
    from identify import identify
    from identify.fit.estimation import Estimation
    from identify.report import (
        CrossChecks,
        Source,
        cross_checks,
        decay_section,
        drawings,
        html_of,
        report_of,
    )

    recorded = daq.read_session(session)
    require_ending(html, "page", PAGES)
    make_room(html)
    if pdf is not None:
        require_ending(pdf, "printed report", SHEETS)
        make_room(pdf)
    with helpers(_HEAVY) as pool:
        begun = {}  # drawings, by the key of their picture
        checks = CrossChecks()

        def fitted(estimation: Estimation) -> None:
            nonlocal checks
            begun.update(drawings(decay_section(estimation).pictures, pool))
            checks = cross_checks(estimation)

        result = identify(recorded, lambda done, text: stage(0.6 * done, text), pool, fitted)
        stage(0.6, "gathering")
        libraries = {name: version(name) for name in _LIBRARIES}
        today = datetime.now(UTC).date().isoformat()
        source = Source(
            session.name, file_sha256(session), version("bumpbench"), libraries, today, *signed
        )
        report = report_of(recorded, result, checks, source)
        stage(0.7, "drawing")
        # The PDF takes longest: it is begun first.
        sheets = None if pdf is None else pool.submit(_pdf_of, report)
        begun |= drawings((p for p in report.pictures if p.key not in begun), pool)
        write_named(html, html_of(report, begun).encode())
        written(html)
        if pdf is not None and sheets is not None:
            stage(0.85, "PDF")
            write_named(pdf, sheets.result())
            written(pdf)
    return report


def _pdf_of(report: Report) -> bytes:
    from identify.report import pdf_of  # matplotlib, which the helpers have loaded

    return pdf_of(report)


def write_figures(report: Report, folder: Path, kind: str) -> list[Path]:
    """Write each picture of a report as `svg` or `png`, moving cars as stills; return the files."""
    from identify.report import MovingCars, png_of, still_cars, svg_of

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
