"""Compares sessions: identifies them in several processes, and prints tables of differences."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

from daq import read_session
from identify import Identification, identify_parameters
from identify.compare import Compared, Comparison
from identify.document import unit_text
from identify.numbers import plus_minus, plus_minus_percent, rounded
from identify.report.comparison import unchanged_line
from identify.report.words import NOT_OK

from ..output import Stage, print_line, print_table
from .executors import map_items


def identified(paths: Sequence[str], stage: Stage) -> list[Identification]:
    """Identify session files, as many at a time as there are processors.

    `stage`: called with the share done, 0..1.  Raises InputError if one cannot be read.
    """
    workers = min(len(paths), os.cpu_count() or 1)
    return map_items(_results, paths, workers, stage, "compare")


def _results(path: str) -> Identification:
    """Return the results without residuals, which would fill the memory in a long trend."""
    result = identify_parameters(read_session(path))
    if result.estimation is None:
        return result
    left = tuple(replace(one, values={}) for one in result.estimation.residuals)
    return replace(result, estimation=replace(result.estimation, residuals=left), residuals=())


def print_comparison(comparison: Comparison) -> None:
    """Write every difference from the first session, then trends where there are some."""
    first = comparison.labels[0]
    if comparison.unlike:
        print_line(f"stated differently (is it one car?): {'; '.join(comparison.unlike)}")
        print_line()
    if comparison.change is not None:
        print_line(comparison.change.sentence)
        print_line(unchanged_line(comparison.change))
        print_line()
    for which, label in enumerate(comparison.labels[1:]):
        for title, rows in (
            ("Parameters", comparison.parameters),
            ("Forces of one corner (damper; corner: with friction)", comparison.forces),
            ("Modes", comparison.modes),
        ):
            if not rows:
                continue
            _print_differences(f"{title}: {label} minus {first}", rows, which)
            print_line()
    if len(comparison.labels) > 2:
        _print_trends(comparison)
        print_line()
    if comparison.open:
        print_line(f"not compared, not determined in a session: {', '.join(comparison.open)}")
    for label, verdict in zip(comparison.labels, comparison.verdicts, strict=True):
        print_line(f"verdict of {label}: {verdict}")
    if set(comparison.verdicts) != {"ok"}:
        print_line(NOT_OK)
    print_line(
        "z: each quantity by itself; errors of the sessions are taken as independent"
        + (f"; in common are {', '.join(comparison.common)}." if comparison.common else ".")
    )


def _print_differences(title: str, quantities: tuple[Compared, ...], which: int) -> None:
    rows = []
    for row in quantities:
        a, b, d = row.estimates[0], row.estimates[which + 1], row.differences[which]
        values = [rounded(e.value, e.low, e.high)[0] for e in (a, b)]
        share = plus_minus_percent(d.value, d.half, a.value)
        found = "differs" if d.significant else ""
        rows.append([row.name, *values, unit_text(a.unit), share, f"{d.z:+.2f}", found])
    print_table(title, ["", "first", "this", "unit", "difference", "z", "at 95 %"], rows)


def _print_trends(comparison: Comparison) -> None:
    rows = []
    for row in comparison.quantities:
        t = row.trend
        if t is not None:
            found = " ".join(["drifts"] * t.drifts + ["varies"] * t.varies)
            slope = plus_minus(t.slope, t.half)
            unit = unit_text(row.estimates[0].unit)
            rows.append([row.name, slope, unit, f"{t.chi2:,.1f} / {t.freedom}", found])
    print_table("Trend", ["", "per session", "unit", "chi2 / n", "at 95 %"], rows)
