"""Writes a comparison of two sessions as lines of text of 80 columns; runs in the worker."""

from __future__ import annotations

from collections.abc import Iterator
from textwrap import wrap

from identify.compare import Compared, Comparison
from identify.document import unit_text
from identify.numbers import plus_minus_percent, rounded
from identify.report.comparison import unchanged_line


def comparison_lines(comparison: Comparison) -> Iterator[str]:
    """Yield the differences of the second session from the first, parameters before modes."""
    first, second = comparison.labels[:2]
    differing = [row.name for row in comparison.quantities if row.differences[0].significant]
    yield f"1  {first}: {comparison.verdicts[0]}"
    yield f"2  {second}: {comparison.verdicts[1]}"
    yield ""
    if comparison.unlike:
        line = f"Stated differently (is it one car?): {'; '.join(comparison.unlike)}."
        yield from wrap(line, 79)
        yield ""
    if comparison.change is not None:
        yield from wrap(comparison.change.sentence, 79)
        yield from wrap(unchanged_line(comparison.change), 79)
        yield ""
    if differing:
        yield f"Each by itself, they differ, at 95 % among all quantities, in {len(differing)}:"
        yield f"  {', '.join(differing)}"
    else:
        yield "Each by itself, nothing differs beyond what noise alone would give."
    for title, rows in (
        ("Parameters", comparison.parameters),
        ("Forces of one corner", comparison.forces),
        ("Modes", comparison.modes),
    ):
        if not rows:
            continue
        yield ""
        yield f"{title:<26}{'1':>10}{'2':>10}{'2 minus 1':>17}{'z':>8}"
        yield from (line for row in rows for line in _lines(row))
    yield ""
    if comparison.open:
        yield f"Not compared, not determined in one of them: {', '.join(comparison.open)}."
    common = f"; in common are {', '.join(comparison.common)}" if comparison.common else ""
    yield f"Errors of the sessions are taken as independent{common}."


def _lines(row: Compared) -> Iterator[str]:
    """Yield the line of a quantity; a name that is too long for its column is a line before it."""
    a, b = (rounded(e.value, e.low, e.high)[0] for e in row.estimates[:2])
    difference = row.differences[0]
    share = plus_minus_percent(difference.value, difference.half, row.estimates[0].value)
    word = "  differs" if difference.significant else ""
    unit = unit_text(row.estimates[0].unit)
    name = f"{row.name}, {unit}" if unit else row.name
    if len(name) > 25:
        yield name
        name = ""
    yield f"{name:<26}{a:>10}{b:>10}{share:>17}{difference.z:>+8.2f}{word}"
