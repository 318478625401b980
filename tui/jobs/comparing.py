"""Compares sessions: identifies them in several processes, and states the differences as text."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import wrap

from daq import read_session
from identify import Identification, identify_parameters
from identify.compare import Compared, Comparison
from identify.numbers import plus_minus, plus_minus_percent
from identify.report.comparison import headline_of, unchanged_line
from identify.words import NOT_OK, unit_text, value_text

from ..output import Stage
from .executors import map_items


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
