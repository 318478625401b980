"""Reports and comparisons of session files, made with several processes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from daq import read_session
from daq.files import file_sha256, make_room, write_named
from identify import Identification, identify_parameters
from identify.compare import Compared, Comparison
from identify.numbers import plus_minus, plus_minus_percent
from identify.report.comparison import headline_of, unchanged_line
from identify.words import NOT_OK, unit_text, value_text

from ..diagnostics import PAGES, SHEETS, require_ending
from ..output import Stage
from .executors import helpers, map_items

if TYPE_CHECKING:
    from identify.report import Report


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
        pdf_of,
        report_of,
    )

    recorded = daq.read_session(session)
    require_ending(html, "page", PAGES)
    make_room(html)
    if pdf is not None:
        require_ending(pdf, "printed report", SHEETS)
        make_room(pdf)
    with helpers(("identify.report", "matplotlib.backends.backend_svg")) as pool:
        begun = {}  # drawings, by the key of their picture
        checks = CrossChecks()

        def fitted(estimation: Estimation) -> None:
            nonlocal checks
            begun.update(drawings(decay_section(estimation).pictures, pool))
            checks = cross_checks(estimation)

        result = identify(recorded, lambda done, text: stage(0.6 * done, text), pool, fitted)
        stage(0.6, "gathering")
        libraries = {name: version(name) for name in ("numpy", "scipy", "h5py", "matplotlib")}
        today = datetime.now(UTC).date().isoformat()
        source = Source(
            session.name, file_sha256(session), version("bumpbench"), libraries, today, *signed
        )
        report = report_of(recorded, result, checks, source)
        stage(0.7, "drawing")
        # The PDF takes longest: it is begun first.
        sheets = None if pdf is None else pool.submit(pdf_of, report)
        begun |= drawings((p for p in report.pictures if p.key not in begun), pool)
        write_named(html, html_of(report, begun).encode())
        written(html)
        if pdf is not None and sheets is not None:
            stage(0.85, "PDF")
            write_named(pdf, sheets.result())
            written(pdf)
    return report


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


# Comparisons --------------------------------------------------------------------------------------


def identified(paths: Sequence[str], stage: Stage) -> list[Identification]:
    """Identify session files, as many at a time as there are processors.

    `stage`: called with the share done, 0..1.  Raises InputError if one cannot be read.
    """
    workers = min(len(paths), os.cpu_count() or 1)
    return map_items(_result, paths, workers, stage, "compare")


def _result(path: str) -> Identification:
    """Return the result without residuals, which would fill the memory in a long trend."""
    result = identify_parameters(read_session(path))
    if result.estimation is None:
        return result
    emptied = tuple(replace(run, values={}) for run in result.estimation.residuals)
    estimation = replace(result.estimation, residuals=emptied)
    return replace(result, estimation=estimation, residuals=())


def labels_of(paths: Sequence[Path]) -> list[str]:
    """Return the names of files, with their folders where two names are equal."""
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        names = [f"{path.parent.name}/{path.stem}" for path in paths]
    return names if len(set(names)) == len(names) else [str(path) for path in paths]


def comparison_lines(comparison: Comparison) -> Iterator[str]:
    """Yield what changed, and the quantities that differ, drift or vary, in 80 columns."""
    for number, label in enumerate(comparison.labels, start=1):
        yield f"{number}  {label}: {comparison.verdicts[number - 1]}"
    if set(comparison.verdicts) != {"ok"}:
        yield NOT_OK
    yield ""
    if comparison.unlike:
        yield from wrap(f"Stated differently (is it one car?): {'; '.join(comparison.unlike)}.", 79)
        yield ""
    yield from wrap(headline_of(comparison), 79)
    if comparison.change is not None:
        yield from wrap(unchanged_line(comparison.change), 79)
    for number in range(2, len(comparison.labels) + 1):
        yield from _differences(comparison, number)
    yield from _trends(comparison)
    yield ""
    if comparison.open:
        yield f"Not compared, not determined in a session: {', '.join(comparison.open)}."
    alike = f"; {len(comparison.common)} facts or weights are the same" if comparison.common else ""
    yield from wrap(f"Errors of the sessions are taken as independent{alike}.", 79)


def _differences(comparison: Comparison, number: int) -> Iterator[str]:
    """Yield a table of the parameters, forces and modes that differ from those of session 1.

    `number`: of the session, from 2.
    """
    for title, quantities in (
        ("Parameters", comparison.parameters),
        ("Forces of one corner", comparison.forces),
        ("Modes", comparison.modes),
    ):
        table = [
            (row, row.estimates[0], row.estimates[number - 1], row.differences[number - 2])
            for row in quantities
            if row.differences[number - 2].significant  # session 1 has no difference
        ]
        if table:
            yield ""
            yield f"{title:<26}{'1':>10}{number:>10}{f'{number} minus 1':>17}{'z':>8}"
        for row, first, second, difference in table:
            percent = plus_minus_percent(difference.value, difference.half, first.value)
            values = f"{value_text(first):>10}{value_text(second):>10}"
            yield from _named(row, f"{values}{percent:>17}{difference.z:>+8.2f}")


def _trends(comparison: Comparison) -> Iterator[str]:
    """Yield a table of the quantities that drift or vary over the sessions."""
    table = [(row, row.trend) for row in comparison.quantities if row.trend and row.trend.words]
    if table:
        yield ""
        yield f"{'Trend':<26}{'per session':>24}{'chi2 / n':>14}   at 95 %"
    for row, trend in table:
        slope = plus_minus(trend.slope, trend.half)
        misfit = f"{trend.chi2:,.1f} / {trend.freedom}"
        yield from _named(row, f"{slope:>24}{misfit:>14}   {trend.words}")


def _named(row: Compared, cells: str) -> Iterator[str]:
    """Yield the line of a quantity; a name that is too long for its column is a line before it."""
    unit = unit_text(row.estimates[0].unit)
    name = f"{row.name}, {unit}" if unit else row.name
    if len(name) > 25:  # the column has 26, one of them a space
        yield name
        name = ""
    yield f"{name:<26}{cells}"
