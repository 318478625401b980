"""Writes a report with several processes; its files are complete or absent."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from daq.files import make_room, write_named

from ..diagnostics import PAGES, SHEETS, require_ending
from .executors import helpers

if TYPE_CHECKING:  # slow to load
    from identify import Judgement
    from identify.report import Picture, Report, Source

_HEAVY = (
    "identify.report",
    "matplotlib.backends.backend_svg",
)
_LIBRARIES = ("numpy", "scipy", "h5py", "matplotlib")


def source_of(path: Path, operator: str = "", approver: str = "") -> Source:
    """Return the source of the numbers of a session file, and the persons responsible for them."""
    from daq.files import file_sha256
    from identify.report import Source

    digest = file_sha256(path)
    libraries = {name: version(name) for name in _LIBRARIES}
    today = datetime.now(UTC).date().isoformat()
    return Source(path.name, digest, version("bumpbench"), libraries, today, operator, approver)


def write_report(
    session: Path,
    html: Path,
    pdf: Path | None,
    stage: Callable[[float, str], None],
    written: Callable[[Path], None],
    signed: tuple[str, str] = ("", ""),
) -> tuple[Report, Judgement]:
    """Identify a session and write its report.

    `html` and `pdf`: what to write; no PDF if None.  `stage`: called with the share done, 0..1, and
    the present stage.  `written`: called with each finished file.  `signed`: names of the operator
    and of the approver.  Raises InputError if the session cannot be read, or a file has another
    ending or cannot be written.
    """
    stage(0.02, "reading")
    with ThreadPoolExecutor(1) as reader:
        import daq

        reading = reader.submit(daq.read_session, session)  # while the libraries load
        import identify as method
        from identify.fit.estimation import Estimation
        from identify.report import (
            CrossChecks,
            cross_checks,
            decay_section,
            drawings,
            html_of,
            report_of,
        )

        recorded = reading.result()
    require_ending(html, "page", PAGES)
    make_room(html)
    if pdf is not None:
        require_ending(pdf, "printed report", SHEETS)
        make_room(pdf)
    with helpers(_HEAVY) as pool:
        begun = {}
        checks = CrossChecks()

        def fitted(estimation: Estimation) -> None:
            nonlocal checks
            begun.update(drawings(decay_section(estimation).pictures, pool))
            checks = cross_checks(estimation)

        result = method.identify(recorded, lambda done, text: stage(0.6 * done, text), pool, fitted)
        stage(0.6, "gathering")
        page = report_of(recorded, result, checks, source_of(session, *signed))
        stage(0.7, "drawing")
        # The PDF takes longest: it is begun first.
        sheets = None if pdf is None else pool.submit(_pdf_of, page)
        begun |= drawings((p for p in page.pictures if p.key not in begun), pool)
        write_named(html, html_of(page, begun).encode())
        written(html)
        if pdf is not None and sheets is not None:
            stage(0.85, "PDF")
            write_named(pdf, sheets.result())
            written(pdf)
    return page, result.quality


def _pdf_of(page: Report) -> bytes:
    from identify.report import pdf_of  # matplotlib, which the helpers have loaded

    return pdf_of(page)


def pictures_of(report: Report) -> tuple[Picture, ...]:
    """Return every picture of a report, mode shapes as stills."""
    from identify.report import MovingCars, still_cars

    cars = [b for section in report.sections for b in section.blocks if isinstance(b, MovingCars)]
    return (*report.pictures, *map(still_cars, cars))


def write_figures(report: Report, folder: Path, kind: str) -> tuple[Path, ...]:
    """Write each picture of a report as `svg` or `png`; return the files."""
    from identify.report import png_of, svg_of

    written = []
    for picture in pictures_of(report):
        path = folder / f"{picture.key}.{kind}"
        png = kind == "png"
        data = png_of(picture) if png else svg_of(picture).encode()
        write_named(path, data)
        written.append(path)
    return tuple(written)
