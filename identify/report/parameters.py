"""Sections on the parameters and what follows from them, and on the forces of a nonlinear car."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..fit.uncertainty import Estimate
from ..numbers import (
    LARGEST_PERCENT,
    by_kind,
    half_width_percent,
    largest_share,
    number,
    rounded,
)
from ..result import Identification
from ..words import (
    damper_columns,
    damper_rows,
    element_answer,
    half_percent,
    half_text,
    parameter_words,
    plain,
    unit_text,
    value_text,
)
from .figure import FAINT, INK, PALETTE, WIDTH_IN, line_axes, lines_height_in, shared_legend
from .page import Block, Picture, Section, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

    from ..nonlinear.forces import Forces

Floats = NDArray[np.float64]

_LEAST_SHARE = 0.005
"""Sources whose share is smaller for every parameter are not drawn."""
_SOURCES = ("#0072b2", "#56b4e9", "#004468", "#d55e00", "#e69f00", "#8a3c00", "#009e73", "#66c2a5",
            "#cc79a7", "#7f7f7f", "#c0c0c0")  # fmt: skip


def parameter_section(result: Identification) -> Section:
    """Return the parameters and the derived quantities."""
    blocks: list[Block] = []
    if result.parameters:
        rests_on = {
            name: "" if name in result.undetermined else largest_share(shares)
            for name, shares in result.drivers.items()
        }
        blocks = [
            intervals_picture(result),
            Table(
                "Parameters of the vehicle",
                ("", "parameter", "#estimate", "#from", "#to", "#±", "unit", "rests mostly on"),
                tuple(
                    (name, parameter_words(name), *estimate_texts(e), rests_on.get(name, ""))
                    for name, e in result.parameters.items()
                ),
                "From and to are the ends of the 95 % interval.",
            ),
            _estimates(
                "What follows from them", "quantity", plain, result.derived,
                "Ratios are known better than masses and springs, most of whose error is common to "
                "all of them. Ride frequency is that of the axle's share of the body on its "
                "suspension, wheel hop that of the wheel between both springs. The dynamic index "
                "is k²/(a b).",
            ),
        ]  # fmt: skip
    if result.motion_ratios:
        note = (
            "Travel of the sensor over that of the wheel, where bench.toml states it with a sigma."
        )
        ratios = result.motion_ratios
        blocks.append(_estimates("Motion ratios as fitted", "channel", str, ratios, note))
    return Section(
        "parameters",
        "Parameters",
        "Every parameter with its 95 % interval. The interval is that of the noise, of the stated "
        "facts and of the stated uncertainties; it holds if the verdict says so.",
        tuple(blocks),
    )


def estimate_texts(e: Estimate) -> tuple[str, str, str, str, str]:
    """Return value, both ends of the interval, its relative half width, and unit."""
    unit = unit_text(e.unit)
    if not e.determined:
        return value_text(e), "", "", "", unit
    if not e.std:
        return value_text(e), "given", "", "", unit
    value, low, high = rounded(e.value, e.low, e.high)
    return value, low, high, half_text(e), unit


def _estimates(
    title: str,
    what: str,
    words: Callable[[str], str],
    estimates: Mapping[str, Estimate],
    note: str,
) -> Table:
    rows = tuple((words(name), *estimate_texts(e)) for name, e in estimates.items())
    return Table(title, (what, "#estimate", "#from", "#to", "#±", "unit"), rows, note)


def intervals_picture(result: Identification) -> Picture:
    """Return the relative interval of each parameter, and the sources of its precision."""
    known = {name: e for name, e in result.parameters.items() if e.determined and e.std and e.value}
    shares = {name: by_kind(result.drivers.get(name, {})) for name in known}
    largest: dict[str, float] = {}
    for row in shares.values():
        for kind, share in row.items():
            largest[kind] = max(largest.get(kind, 0.0), share)
    kinds = {kind for kind, most in largest.items() if most > _LEAST_SHARE}
    # In the order of the runs; sources that are not runs come last.
    runs = dict.fromkeys(run.rpartition("_")[0] for run in result.quality.chi2_by_run)
    order = (*(kind for kind in runs if kind in kinds), *sorted(kinds - set(runs)))
    return Picture(
        "intervals",
        "How well each parameter is known, and what that rests on",
        "Left: the 95 % interval relative to the estimate. Right: which runs, facts and stated "
        "uncertainties its precision rests on; repeats are added up. A bar of one colour means "
        "that one kind of run decides: repeat that one.",
        WIDTH_IN,
        lines_height_in(len(known), len(order)),
        partial(
            _draw_intervals,
            tuple(known),
            np.array([half_percent(e) for e in known.values()]),
            tuple(plain(kind) for kind in order),
            np.array([[row.get(kind, 0.0) for kind in order] for row in shares.values()]),
        ),
    )


def _draw_intervals(
    names: tuple[str, ...],
    half_percents: Floats,
    kinds: tuple[str, ...],
    shares: Floats,
    figure: FigureBase,
) -> None:
    n = len(names)
    left, right = line_axes(figure, n, (0.075, 0.5))
    # A bar of 2,000 %, of a value near zero, would make all others invisible.
    shown = np.where(half_percents <= LARGEST_PERCENT, half_percents, np.nan)
    interval_bars(left, shown)
    left.set_yticks(range(n), names)
    for i, half in enumerate(half_percents):
        text = half_width_percent(100.0, 100.0 - half, 100.0 + half)
        text = f" ±{text}" if text else " may be zero"
        left.text(half if half <= LARGEST_PERCENT else 0.0, i, text, va="center", fontsize=7.5)
    left.set_xlim(*about_zero(shown, 1.6))
    left.set_xlabel("95 % interval about the estimate, %")
    left.set_title("How well each is known")
    start = np.zeros(n)
    for i, kind in enumerate(kinds):
        width = shares[:, i] * 100.0
        colour = _SOURCES[i % len(_SOURCES)]
        right.barh(range(n), width, 0.62, left=start, color=colour, label=kind, ec="white", lw=0.5)
        start += width
    right.set_xlim(0.0, 100.0)
    right.set_yticks(range(n), [""] * n)
    right.set_xlabel("share of its precision, %")
    right.set_title("What it rests on")
    shared_legend(figure)


def interval_bars(axes: Axes, half: Floats) -> None:
    """Draw a bar about zero for each interval."""
    shown = np.where(np.isfinite(half), half, 0.0)
    axes.barh(range(len(half)), 2.0 * shown, 0.55, left=-shown, color=PALETTE[1], alpha=0.45)
    axes.vlines(0.0, -0.5, len(half) - 0.5, INK, lw=0.9)


def about_zero(values: Floats, room: float) -> tuple[float, float]:
    """Return limits of an axis, alike on both sides of zero, `room` times the largest value."""
    finite = np.abs(values[np.isfinite(values)])
    reach = room * (float(finite.max(initial=0.0)) or 1.0)
    return -reach, reach


# Forces of a car that is not linear ---------------------------------------------------------------


def damper_section(forces: Forces) -> Section:
    """Return the section of dampers and friction."""
    blocks: list[Block] = [damper_picture(forces)]
    columns = ("#speed, m/s", *(f"#{name}" for name in damper_columns(forces)))
    blocks.append(
        Table(
            "Force of one corner at a speed, N",
            columns,
            tuple(tuple(row) for row in damper_rows(forces)),
            "Of the damper, and with friction; each with half of its 95 % interval. Empty where "
            "the speed did not occur. The split rests on the law of the friction, the sum does "
            "not.",
        )
    )
    elements = tuple(
        (one.axle, plain(name), value, low, high, unit)
        for one in forces.axles
        for name, e in one.values.items()
        for value, low, high, _, unit in [estimate_texts(e)]
    )
    if elements:
        columns = ("axle", "element", "#estimate", "#from", "#to", "unit")
        notes = "; ".join(f"{one.axle} {note}" for one in forces.axles for note in one.notes)
        blocks.append(Table("Force elements of one corner", columns, elements, notes))
    blocks.append(
        Table(
            "Elements that were tried",
            ("element", "#gain", "#needed", ""),
            tuple(
                (plain(one.name), number(one.gain), number(one.threshold), element_answer(one))
                for one in forces.choices
            ),
            "Gain is the fall of the squared residuals in units of the noise; needed is what the "
            "Bayesian information criterion needs for its number of unknowns.",
        )
    )
    return Section(
        "dampers",
        "Damper dynamometer",
        "A damper dynamometer without removing the dampers: forces of one corner of each axle, "
        "at the wheel, identified from the decays. The band is the 95 % interval. A curve is shown "
        "for the speeds that occurred in 1 to 99 % of the time. c_s among the parameters is the "
        "secant of this curve between -0.1 and 0.1 m/s. Speeds and forces are those of the wheel: "
        "on a test rig a damper of lever ratio i shows 1/i of the force at i times the speed.",
        tuple(blocks),
    )


def damper_picture(forces: Forces) -> Picture:
    """Return the curves of both axles with their bands."""
    return Picture(
        "dampers",
        "Damper force over speed",
        "Compression is positive. The broken line adds the friction, the force that a corner "
        "resists with at that speed; the sum is right whatever the law of the friction is.",
        WIDTH_IN,
        2.9,
        partial(_draw_dampers, forces),
    )


def _draw_dampers(forces: Forces, figure: FigureBase) -> None:
    """Draw one curve for each axle, side by side on the same scale."""
    n = len(forces.axles)
    first = None
    dampers = [one.damper for one in forces.axles]
    speeds = np.concatenate([damper.speed_m_s for damper in dampers])
    forces_n = np.concatenate([np.ravel((*d.band_n, d.force_n, d.total_n)) for d in dampers])
    for i, one in enumerate(forces.axles):
        speed = one.damper.speed_m_s
        left = 0.1 + i * 0.9 / n
        axes = figure.add_axes((left, 0.19, 0.9 / n - 0.07, 0.7), sharey=first)
        first = first or axes
        axes.axhline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.axvline(0.0, color=FAINT, linewidth=0.8, zorder=0)
        axes.fill_between(speed, *one.damper.band_n, color=PALETTE[1], alpha=0.25, lw=0)
        axes.plot(speed, one.damper.force_n, color=PALETTE[1], lw=1.4, label="damper, 95 % band")
        axes.plot(speed, one.damper.total_n, "--", color=PALETTE[2], lw=1.0, label="with friction")
        axes.set_title(one.axle)
        axes.set_xlim(*about_zero(speeds, 1.05))
        axes.set_ylim(*about_zero(forces_n, 1.05))
        axes.set_xlabel("speed, m/s, compression positive")
        if not i:
            axes.set_ylabel("force, N")
            axes.legend(frameon=False, fontsize=7.5, loc="upper left")
