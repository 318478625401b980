"""Section on the parameters, their precision, and the quantities that follow from them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..estimate_text import Document, half_percent, half_text, high_text, low_text, value_text
from ..numbers import LARGEST_PERCENT, by_kind, half_width_percent, largest_share
from ..words import parameter_words, plain, unit_text
from .blocks import Block, Cell, Picture, Section, Table, cited
from .figure import (
    INK,
    PALETTE,
    WIDTH_IN,
    Drawing,
    line_axes,
    lines_height_in,
    shared_legend,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_LEAST_SHARE = 0.005
"""Sources whose share is smaller for every parameter are not drawn."""
_SOURCES = ("#0072b2", "#56b4e9", "#004468", "#d55e00", "#e69f00", "#8a3c00", "#009e73", "#66c2a5",
            "#cc79a7", "#7f7f7f", "#c0c0c0")  # fmt: skip


def parameter_section(document: Document) -> Section:
    """Return the parameters and the derived quantities."""
    blocks: list[Block] = []
    if document["parameters"]:
        blocks += [_intervals(document), _parameters(document), _derived(document)]
    if document["motion_ratios"]:
        blocks.append(_motion_ratios(document))
    return Section(
        "parameters",
        "Parameters",
        "Every parameter with its 95 % interval. The interval is that of the noise, of the stated "
        "facts and of the stated uncertainties; it holds if the verdict says so.",
        tuple(blocks),
    )


def _estimate_cells(
    document: Document, part: Literal["parameters", "derived", "motion_ratios"], name: str
) -> tuple[Cell, ...]:
    """Return value, both ends of the interval, its relative half width, and unit."""
    e = document[part][name]
    ends = (Cell("given"), Cell(""), Cell(""))
    if e["reason"]:
        ends = (Cell(""), Cell(""), Cell(""))
    elif e["std"]:
        ends = (
            cited(document, part, name, form=low_text),
            cited(document, part, name, form=high_text),
            cited(document, part, name, form=half_text),
        )
    return (cited(document, part, name, form=value_text), *ends, Cell(unit_text(e["unit"])))


def _parameters(document: Document) -> Table:
    rows = [
        (
            Cell(name),
            Cell(parameter_words(name)),
            *_estimate_cells(document, "parameters", name),
            Cell(largest_share(document["drivers"].get(name, {}))),
        )
        for name in document["parameters"]
    ]
    return Table(
        "Parameters of the vehicle",
        ("", "parameter", "#estimate", "#from", "#to", "#±", "unit", "rests mostly on"),
        tuple(rows),
        "From and to are the ends of the 95 % interval.",
    )


def _derived(document: Document) -> Table:
    rows = [
        (Cell(plain(name)), *_estimate_cells(document, "derived", name))
        for name in document["derived"]
    ]
    return Table(
        "What follows from them",
        ("quantity", "#estimate", "#from", "#to", "#±", "unit"),
        tuple(rows),
        "Ratios are known better than masses and springs, most of whose error is common to "
        "all of them. Ride frequency is that of the axle's share of the body on its suspension, "
        "wheel hop that of the wheel between both springs. The dynamic index is k²/(a b).",
    )


def _intervals(document: Document) -> Picture:
    known = {n: e for n, e in document["parameters"].items() if e["std"] > 0.0 and e["value"]}
    kinds: dict[str, float] = {}
    rows = {name: by_kind(document["drivers"].get(name, {})) for name in known}
    for row in rows.values():
        for kind, share in row.items():
            kinds[kind] = max(kinds.get(kind, 0.0), share)
    order = _first_named(document, {kind for kind, most in kinds.items() if most > _LEAST_SHARE})
    return Picture(
        "intervals",
        "How well each parameter is known, and what that rests on",
        "Left: the 95 % interval relative to the estimate. Right: which runs, facts and stated "
        "uncertainties its precision rests on; repeats are added up. A bar of one colour means "
        "that one kind of run decides: repeat that one.",
        intervals_drawing(
            tuple(known),
            np.array([half_percent(e) for e in known.values()]),
            tuple(kind.replace("_", " ") for kind in order),
            np.array([[row.get(kind, 0.0) for kind in order] for row in rows.values()]),
        ),
    )


def _first_named(document: Document, kinds: set[str]) -> tuple[str, ...]:
    """Return the kinds in the order of the runs; sources that are not runs come last."""
    labels = [run.rpartition("_")[0] for run in document["chi2_by_run"]]
    runs = [kind for kind in dict.fromkeys(labels) if kind in kinds]
    return (*runs, *sorted(kinds - set(runs)))


def _motion_ratios(document: Document) -> Table:
    rows = [
        (Cell(name), *_estimate_cells(document, "motion_ratios", name))
        for name in document["motion_ratios"]
    ]
    return Table(
        "Motion ratios as fitted",
        ("channel", "#estimate", "#from", "#to", "#±", "unit"),
        tuple(rows),
        "Travel of the sensor over that of the wheel, where bench.toml states it with a sigma.",
    )


def intervals_drawing(
    names: tuple[str, ...],
    half_percent: NDArray[np.float64],
    kinds: tuple[str, ...],
    shares: NDArray[np.float64],
) -> Drawing:
    """Return a drawing of the relative intervals on the left, and of what they rest on.

    `half_percent`, (n,): half of each 95 % interval, % of the value.  `kinds`: kinds of runs and
    facts that a parameter may rest on.  `shares`, (n, n_kinds): share of each, 0..1.
    """
    draw = partial(_draw_intervals, names, half_percent, kinds, shares)
    return Drawing(WIDTH_IN, lines_height_in(len(names), len(kinds)), draw)


def _draw_intervals(
    names: tuple[str, ...],
    half_percent: NDArray[np.float64],
    kinds: tuple[str, ...],
    shares: NDArray[np.float64],
    figure: FigureBase,
) -> None:
    n = len(names)
    left, right = line_axes(figure, n, (0.075, 0.5))
    # A bar of 2,000 %, of a value near zero, would make all others invisible.
    shown = np.where(half_percent <= LARGEST_PERCENT, half_percent, np.nan)
    interval_bars(left, shown)
    left.set_yticks(range(n), names)
    for i, half in enumerate(half_percent):
        text = half_width_percent(100.0, 100.0 - half, 100.0 + half)
        text = f" ±{text}" if text else (" may be zero" if half > 0.0 else " not determined")
        left.text(half if half <= LARGEST_PERCENT else 0.0, i, text, va="center", fontsize=7.5)
    left.set_xlim(*about_zero(shown, 1.9))
    left.set_xlabel("95 % interval about the estimate, %")
    left.set_title("How well each is known")
    start = np.zeros(n)
    for number, kind in enumerate(kinds):
        width = np.nan_to_num(shares[:, number]) * 100.0
        colour = _SOURCES[number % len(_SOURCES)]
        right.barh(range(n), width, 0.62, left=start, color=colour, label=kind, ec="white", lw=0.5)
        start += width
    right.set_xlim(0.0, 100.0)
    right.set_yticks(range(n), [""] * n)
    right.set_xlabel("share of its precision, %")
    right.set_title("What it rests on")
    shared_legend(figure)


def interval_bars(axes: Axes, half: NDArray[np.float64]) -> None:
    """Draw a bar about zero for each interval."""
    shown = np.where(np.isfinite(half), half, 0.0)
    axes.barh(range(len(half)), 2.0 * shown, 0.55, left=-shown, color=PALETTE[1], alpha=0.45)
    axes.vlines(0.0, -0.5, len(half) - 0.5, INK, lw=0.9)


def about_zero(values: NDArray[np.float64], room: float) -> tuple[float, float]:
    """Return limits of an axis that hold all values, with room on the right."""
    finite = np.abs(values[np.isfinite(values)])
    reach = float(finite.max(initial=0.0)) or 1.0
    return -1.1 * reach, room * reach
