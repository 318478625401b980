"""A comparison of sessions as blocks of a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import isnan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dbc.words import counted

from ..change import Change
from ..compare import Compared, Comparison
from ..estimate_text import EstimateEntry, high_text, low_text, value_text
from ..fit.estimation import Estimation
from ..fit.uncertainty import COVERAGE_95, Estimate
from ..numbers import NOT_DETERMINED, half_width, plus_minus, signed
from ..words import NOT_OK, unit_text
from .blocks import Block, Cell, Gallery, Picture, Section, Table, cited
from .decays import overlay_gallery
from .figure import (
    HALF_IN,
    INK,
    PALETTE,
    WIDTH_IN,
    Drawing,
    line_axes,
    lines_height_in,
    shared_legend,
)

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

Floats = NDArray[np.float64]

_LEAST_CHANCE = 1e-9

_DRAWN = 24
"""Largest number of trends with a figure, the parameters first."""


def comparison_sections(
    comparison: Comparison, estimations: Sequence[Estimation] = ()
) -> tuple[Section, ...]:
    """Return the differences, the overlaid decays of the fits, and the trends."""
    labels, document = comparison.labels, comparison.document()
    blocks: list[Block] = [_sessions(comparison)]
    if comparison.unlike:
        stated = tuple((Cell(text), Cell("")) for text in comparison.unlike)
        title = "Stated differently: is it one car, with its sensors in their places?"
        blocks.append(Table(title, ("what", ""), stated))
    if comparison.change is not None:
        blocks.append(change_table(comparison.change, document))
    if comparison.common:
        shared = tuple((Cell(text), Cell("")) for text in comparison.common)
        columns = ("what", "")
        blocks.append(Table("Stated alike in all sessions: errors in common", columns, shared))
    if comparison.open:
        names = tuple((Cell(name), Cell(NOT_DETERMINED)) for name in comparison.open)
        blocks.append(Table("Not compared: a session does not determine it", ("", ""), names))
    for number_, label in enumerate(labels[1:]):
        if comparison.parameters:
            blocks.append(_picture(comparison, number_))
        for title, part, rows in (
            ("Parameters", "parameters", comparison.parameters),
            ("Forces (damper; corner: with friction)", "forces", comparison.forces),
            ("Modes", "modes", comparison.modes),
        ):
            if rows:
                name = f"{title}: {label} minus {labels[0]}"
                blocks.append(_differences(name, document, part, rows, number_))
    sections = [Section("differences", "Differences", METHOD, tuple(blocks))]
    gallery = overlay_gallery(labels, estimations)
    if gallery is not None:
        lead = "The same runs in all sessions, as the sensors measured them."
        sections.append(Section("decays", "Overlaid decays", lead, (gallery,)))
    if len(labels) > 2:
        sections.append(_trends(comparison, document))
    return tuple(sections)


METHOD = (
    "What changed is found by one joint fit of all sessions: every parameter, and every element "
    "that all of them have, is common to them unless the data ask for a difference; of all small "
    "sets of differences, the one is named that explains most for its number. In addition, each "
    "quantity is compared by itself, from fits that share nothing. Every session is compared with "
    "the first one named. The errors of two "
    "sessions are taken as independent; facts and weights stated alike in both have errors in "
    "common, which makes the standard deviation of a difference too large rather than too small. "
    "Differences are significant at 95 % among all that are listed (Holm)."
)


def _sessions(comparison: Comparison) -> Table:
    pairs = zip(comparison.labels, comparison.verdicts, strict=True)
    rows = tuple((Cell(f"{i + 1}"), Cell(a), Cell(b)) for i, (a, b) in enumerate(pairs))
    note = "" if set(comparison.verdicts) == {"ok"} else NOT_OK
    return Table("Sessions", ("#", "session", "verdict"), rows, note)


def _differences(
    title: str, document: dict[str, Any], part: str, rows: tuple[Compared, ...], which: int
) -> Table:
    cells = []
    for i, row in enumerate(rows):
        path = (part, i, "differences", which)
        cells.append(
            (
                cited(document, part, i, "name", form=str),
                cited(document, part, i, "estimates", 0, form=value_text),
                cited(document, part, i, "estimates", which + 1, form=value_text),
                cited(document, *path, form=_difference_text),
                cited(document, *path, form=_half_text),
                cited(document, *path, "z", form="{:+.2f}".format),
                Cell("✓ differs" if row.differences[which].significant else "· within chance"),
                Cell(unit_text(row.estimates[0].unit)),
            )
        )
    columns = ("", "#first", "#this", "#difference", "#±", "#z", "at 95 %", "unit")
    return Table(title, columns, tuple(cells))


def _difference_text(difference: Mapping[str, float]) -> str:
    """Write a difference with the digits that its interval justifies."""
    return signed(difference["value"], COVERAGE_95 * difference["std"])


def _half_text(difference: Mapping[str, float]) -> str:
    """Write half of its 95 % interval."""
    return half_width(0.0, COVERAGE_95 * difference["std"])


def _picture(comparison: Comparison, which: int) -> Picture:
    rows = comparison.parameters
    value = np.array([row.estimates[0].value for row in rows])
    return Picture(
        f"differences_{which + 1}",
        f"{comparison.labels[which + 1]} minus {comparison.labels[0]}",
        "Bars: 95 % interval of each difference by itself. Diamonds differ significantly, circles "
        "do not.",
        differences_drawing(
            tuple(row.name for row in rows),
            np.array([row.differences[which].value for row in rows]) / np.abs(value) * 100.0,
            np.array([row.differences[which].std for row in rows])
            / np.abs(value)
            * COVERAGE_95
            * 100.0,
            np.array([row.differences[which].significant for row in rows]),
        ),
    )


def _slope_text(trend: Mapping[str, float]) -> str:
    """Write a slope with its 95 % interval."""
    return plus_minus(trend["slope"], COVERAGE_95 * trend["slope_std"])


def _trends(comparison: Comparison, document: dict[str, Any]) -> Section:
    cells = []
    pictures: list[Picture] = []
    for part, rows in (
        ("parameters", comparison.parameters),
        ("forces", comparison.forces),
        ("modes", comparison.modes),
    ):
        for i, row in enumerate(rows):
            t = row.trend
            if t is None:
                continue
            cells.append(
                (
                    Cell(row.name),
                    cited(document, part, i, "trend", form=_slope_text),
                    Cell(unit_text(row.estimates[0].unit)),
                    Cell("✓ drifts" if t.drifts else "· none"),
                    Cell(f"{t.chi2:.1f} / {t.freedom}", f"{part}/{i}/trend/chi2"),
                    Cell("✓ varies" if t.varies else "· constant"),
                )
            )
            if len(pictures) < _DRAWN:
                value = np.array([e.value for e in row.estimates])
                half = np.array([(e.high - e.low) / 2.0 for e in row.estimates])
                drawing = trend_drawing(value, half, t.slope, unit_text(row.estimates[0].unit))
                pictures.append(Picture(f"trend_{part}_{i}", row.name, "", drawing))
    columns = ("", "#per session", "unit", "slope at 95 %", "#chi2 / n", "constancy at 95 %")
    return Section(
        "trend",
        "Trend over the sessions",
        "Value against session in the order given: a weighted straight line, and how badly one "
        "constant value fits (chi2). Equal steps from session to session are assumed.",
        (
            Table("Slopes and constancy", columns, tuple(cells)),
            Gallery("Values in order", "Bars: 95 % intervals. Line: weighted trend.",
                    tuple(pictures)),
        ),
    )  # fmt: skip


# What changed -------------------------------------------------------------------------------------


def unchanged_line(change: Change) -> str:
    """Return the test that all else is unchanged, in one line."""
    if change.outcome == "not compared":
        return "Each quantity is compared by itself."
    what = "all else" if change.outcome == "parameters" else "everything"
    if change.apart:
        what = f"{what} that all sessions have"
    freedom = f"{counted(change.rest_freedom, 'degree')} of freedom"
    return (
        f"Test that {what} is unchanged: chi2 {change.rest_chi2:,.1f} on {freedom},"
        f" chance {_chance_text(change.rest_p)}."
    )


def change_table(change: Change, document: Mapping[str, Any]) -> Table:
    """Return the named changes with their intervals."""
    rows: list[tuple[Cell, ...]] = []
    for i, one in enumerate(change.named):
        named = ("change", "named", i)
        for k, estimate in enumerate(one.changes):
            path = (*named, "changes", k)
            share = partial(_percent, change=estimate)
            name = ", or instead ".join((one.name, *one.instead))
            rows.append(
                (
                    Cell(name if len(one.changes) == 1 else f"{name}, session {k + 2}"),
                    Cell(one.kind),
                    cited(document, *path, form=_amount_text),
                    cited(document, *path, form=low_text),
                    cited(document, *path, form=high_text),
                    Cell(unit_text(estimate.unit)),
                    Cell("")
                    if isnan(one.shares[k])
                    else cited(document, *named, "shares", k, form=share),
                    cited(document, *named, "p", form=_chance_text),
                )
            )
    title, line = "What changed, by one joint fit", unchanged_line(change)
    if not rows:
        return Table(title, ("what changed", ""), ((Cell(change.sentence), Cell("")),), line)
    columns = ("what changed", "", "#by", "#from", "#to", "unit", "#share", "#chance")
    return Table(title, columns, tuple(rows), line)


def _chance_text(p: float) -> str:
    """Write a chance; one that is too small to matter is written as a bound."""
    return f"{p:.2g}" if p >= _LEAST_CHANCE else f"below {_LEAST_CHANCE:g}"


def _amount_text(change: EstimateEntry) -> str:
    """Write a change with its sign and the digits that its interval justifies."""
    return signed(change["value"], change["high"] - change["value"])


def _percent(share: float, change: Estimate) -> str:
    """Write the change as a share, with the digits of its interval."""
    half = abs(change.high - change.value) / abs(change.value) if change.value else 0.0
    return f"{signed(100.0 * share, 100.0 * half * abs(share))} %"


# Figures ------------------------------------------------------------------------------------------


def differences_drawing(
    names: tuple[str, ...],
    percent: Floats,
    half_percent: Floats,
    significant: NDArray[np.bool_],
) -> Drawing:
    """Return a drawing of each difference with its interval; significant ones by another mark.

    All (n,): difference and half of its 95 % interval, % of the first session's value; True if the
    difference is significant among all.
    """
    draw = partial(_draw_differences, names, percent, half_percent, significant)
    return Drawing(WIDTH_IN, lines_height_in(len(names), 2), draw)


def _draw_differences(
    names: tuple[str, ...],
    percent: Floats,
    half_percent: Floats,
    significant: NDArray[np.bool_],
    figure: FigureBase,
) -> None:
    n = len(names)
    (axes,) = line_axes(figure, n, (0.09,))
    place = np.arange(n)
    axes.hlines(
        place, percent - half_percent, percent + half_percent,
        PALETTE[1], lw=4.0, alpha=0.35,
    )  # fmt: skip
    for chosen, mark, hue, label in (
        (significant, "D", 2, "differs"),
        (~significant, "o", 1, "within chance"),
    ):
        axes.plot(percent[chosen], place[chosen], mark, ms=4.5, color=PALETTE[hue], label=label)
    axes.axvline(0.0, color=INK, lw=0.8)
    axes.set_yticks(place, names)
    axes.set_xlabel("difference, % of the first session's value")
    shared_legend(figure)


def trend_drawing(values: Floats, half: Floats, slope: float, unit: str) -> Drawing:
    """Return a drawing of a quantity over the sessions, with its weighted line.

    `values` and `half`, (n,): value and half of its 95 % interval in each session.  `slope`: of the
    line, per session.
    """
    return Drawing(HALF_IN, 1.7, partial(_draw_trend, values, half, slope, unit))


def _draw_trend(values: Floats, half: Floats, slope: float, unit: str, figure: FigureBase) -> None:
    axes = figure.add_axes((0.2, 0.2, 0.77, 0.74))
    order = np.arange(1, len(values) + 1)
    axes.errorbar(order, values, yerr=half, fmt="o", ms=3.5, color=PALETTE[1], lw=1.0, capsize=2.0)
    weight = half**-2.0
    middle = float(weight @ order / weight.sum())
    level = float(weight @ values / weight.sum())
    axes.plot(order, level + slope * (order - middle), color=PALETTE[2], lw=1.0)
    axes.ticklabel_format(useOffset=False)
    axes.set_xticks(order[:: max(len(order) // 8, 1)])
    axes.set_xlabel("session", labelpad=1.0)
    axes.set_ylabel(unit)
    axes.margins(x=0.08)
