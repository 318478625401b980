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
from identify.report.comparison import unchanged_line
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
    bare = tuple(replace(one, values={}) for one in result.estimation.residuals)
    return replace(result, estimation=replace(result.estimation, residuals=bare), residuals=())


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
    yield from wrap(_headline(comparison), 79)
    if comparison.change is not None:
        yield from wrap(unchanged_line(comparison.change), 79)
    for which in range(len(comparison.labels) - 1):
        yield from _differences(comparison, which)
    changing = [row for row in comparison.quantities if row.trend and row.trend.words]
    if changing:
        yield ""
        yield f"{'Trend':<26}{'per session':>24}{'chi2 / n':>14}   at 95 %"
    for row in changing:
        t = row.trend
        assert t is not None
        slope, misfit = plus_minus(t.slope, t.half), f"{t.chi2:,.1f} / {t.freedom}"
        yield from _named(row, f"{slope:>24}{misfit:>14}   {t.words}")
    yield ""
    if comparison.open:
        yield f"Not compared, not determined in a session: {', '.join(comparison.open)}."
    common = f"; in common are {', '.join(comparison.common)}" if comparison.common else ""
    yield f"Errors of the sessions are taken as independent{common}."


def _headline(comparison: Comparison) -> str:
    """Return what the joint fit and the quantities by themselves show, as one message."""
    change, rows = comparison.change, comparison.quantities
    differ = ", ".join(
        row.name
        for row in rows
        if (row.trend and row.trend.words) or any(d.significant for d in row.differences)
    )
    unchanged = change is not None and change.outcome == "nothing" and not change.apart
    if unchanged and not differ:
        return f"Nothing differs beyond chance: neither by the joint fit, nor any of {len(rows)}."
    alone = f"Each by itself, none of {len(rows)} quantities differs beyond chance."
    if differ:
        alone = f"Each by itself, at 95 % among all {len(rows)} quantities, these differ: {differ}."
    return f"{change.sentence} {alone}" if change is not None else alone


def _differences(comparison: Comparison, which: int) -> Iterator[str]:
    """Yield the quantities of one session that differ from the first, parameters before modes."""
    number = f"{which + 2}"
    for title, quantities in (
        ("Parameters", comparison.parameters),
        ("Forces of one corner", comparison.forces),
        ("Modes", comparison.modes),
    ):
        rows = [row for row in quantities if row.differences[which].significant]
        if rows:
            yield ""
            yield f"{title:<26}{'1':>10}{number:>10}{f'{number} minus 1':>17}{'z':>8}"
        for row in rows:
            first, this, d = row.estimates[0], row.estimates[which + 1], row.differences[which]
            share = plus_minus_percent(d.value, d.half, first.value)
            values = f"{value_text(first):>10}{value_text(this):>10}"
            yield from _named(row, f"{values}{share:>17}{d.z:>+8.2f}")


def _named(row: Compared, cells: str) -> Iterator[str]:
    """Yield the line of a quantity; a name that is too long for its column is a line before it."""
    unit = unit_text(row.estimates[0].unit)
    name = f"{row.name}, {unit}" if unit else row.name
    if len(name) > 25:
        yield name
        name = ""
    yield f"{name:<26}{cells}"
