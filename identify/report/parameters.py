"""Sections on the parameters, on the forces of a nonlinear car, and on the modes of vibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..fit.uncertainty import Estimate, ModeEstimate
from ..modes.state_variable_method import StabilisationDiagram
from ..numbers import (
    LARGEST_PERCENT,
    NOT_DETERMINED,
    by_kind,
    half_width_percent,
    largest_share,
    number,
    rounded,
    with_half,
)
from ..result import Identification
from ..words import (
    damper_columns,
    damper_rows,
    element_answer,
    half_text,
    parameter_words,
    plain,
    unit_text,
    value_text,
)
from .cars import shape_of
from .page import (
    FAINT,
    HALF_IN,
    INK,
    PALETTE,
    WIDTH_IN,
    Block,
    Gallery,
    MovingCars,
    Picture,
    Section,
    Table,
)

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase

    from ..nonlinear.forces import Forces


Floats = NDArray[np.float64]

_ABOVE_IN, _ROW_IN, _BELOW_IN = 0.32, 0.195, 1.0
"""Heights of the titles of the intervals, of each parameter, and of axis and legend, inches."""
_HUES = ("#0072b2", "#56b4e9", "#004468", "#d55e00", "#e69f00", "#8a3c00", "#009e73", "#66c2a5",
         "#cc79a7", "#7f7f7f", "#c0c0c0")  # fmt: skip
"""Colours of the sources of precision, in the order of the legend."""


def parameter_section(result: Identification) -> Section:
    """Return the section of the parameters and the derived quantities."""
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
            _estimates_table(
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
        blocks.append(_estimates_table("Motion ratios as fitted", "channel", str, ratios, note))
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


def _estimates_table(
    title: str,
    heading: str,
    words: Callable[[str], str],
    estimates: Mapping[str, Estimate],
    note: str,
) -> Table:
    rows = tuple((words(name), *estimate_texts(e)) for name, e in estimates.items())
    return Table(title, (heading, "#estimate", "#from", "#to", "#±", "unit"), rows, note)


def intervals_picture(result: Identification) -> Picture:
    """Return the picture of each parameter's interval, and of the sources of its precision."""
    known = {name: e for name, e in result.parameters.items() if e.determined and e.std and e.value}
    shares = [by_kind(result.drivers.get(name, {})) for name in known]
    # A source whose share is smaller for every parameter is not drawn.
    kinds = {kind for row in shares for kind, share in row.items() if share > 0.005}
    # In the order of the runs; sources that are not runs come last.
    runs = by_kind(dict.fromkeys(result.quality.chi2_by_run, 0.0))
    order = (*(kind for kind in runs if kind in kinds), *sorted(kinds - set(runs)))
    draw = partial(
        _draw_intervals,
        tuple(known),
        np.array([(e.high - e.low) / 2.0 / abs(e.value) * 100.0 for e in known.values()]),
        tuple(plain(kind) for kind in order),
        np.array([[row.get(kind, 0.0) for kind in order] for row in shares]),
    )
    return Picture(
        "intervals",
        "How well each parameter is known, and what that rests on",
        "Left: the 95 % interval relative to the estimate. Right: which runs, facts and stated "
        "uncertainties its precision rests on; repeats are added up. A bar of one colour means "
        "that one kind of run decides: repeat that one.",
        WIDTH_IN,
        _intervals_height_in(len(known)),
        draw,
    )


def _intervals_height_in(n: int) -> float:
    """Return the height of a figure with a line for each of n parameters, inches."""
    return _ABOVE_IN + _ROW_IN * n + _BELOW_IN


def _draw_intervals(
    names: tuple[str, ...],
    half_percents: Floats,
    kinds: tuple[str, ...],
    shares: Floats,
    figure: FigureBase,
) -> None:
    """Draw half of each interval, (n,) %, beside shares of kinds of sources, (n, n_kinds), 0..1."""
    rows, height_in = np.arange(len(names)), _intervals_height_in(len(names))
    left, right = figure.subplots(
        1, 2, sharey=True,
        gridspec_kw={
            "left": 0.075, "right": 0.97, "wspace": 0.11,
            "top": 1.0 - _ABOVE_IN / height_in, "bottom": _BELOW_IN / height_in,
        },
    )  # fmt: skip
    left.set_yticks(rows, names)
    left.set_ylim(len(names) - 0.5, -0.5)
    for axes in (left, right):
        axes.tick_params(axis="y", length=0.0)
        axes.spines["left"].set_visible(False)
    # A bar of 2,000 %, of a value near zero, would make all others invisible.
    drawn_percents = np.where(half_percents <= LARGEST_PERCENT, half_percents, 0.0)
    left.barh(rows, 2.0 * drawn_percents, 0.55, left=-drawn_percents, color=PALETTE[1], alpha=0.45)
    left.axvline(0.0, color=INK, lw=0.9)
    for row, half, drawn in zip(rows, half_percents, drawn_percents, strict=True):
        text = half_width_percent(100.0, 100.0 - half, 100.0 + half)  # half is % of the value
        text = f" ±{text}" if text else " may be zero"
        left.text(drawn, row, text, va="center", fontsize=7.5)
    left.set_xlim(*about_zero(drawn_percents, 1.6))
    left.set_xlabel("95 % interval about the estimate, %")
    left.set_title("How well each is known")
    ends = np.cumsum(shares * 100.0, axis=1)
    for i, kind in enumerate(kinds):
        width, colour = shares[:, i] * 100.0, _HUES[i % len(_HUES)]
        right.barh(
            rows, width, 0.62, left=ends[:, i] - width, color=colour, label=kind, ec="white", lw=0.5
        )
    right.set_xlim(0.0, 100.0)
    right.set_xlabel("share of its precision, %")
    right.set_title("What it rests on")
    figure.legend(
        loc="lower center", ncols=5, frameon=False, fontsize=7.5, handlelength=1.0,
        columnspacing=1.2, borderaxespad=0.0, borderpad=0.1,
    )  # fmt: skip


def about_zero(values: Floats, room: float) -> tuple[float, float]:
    """Return limits of an axis, alike on both sides of zero, `room` times the largest value."""
    reach = room * (float(np.abs(values).max(initial=0.0)) or 1.0)
    return -reach, reach


# Forces of a car that is not linear ---------------------------------------------------------------


def damper_section(forces: Forces) -> Section:
    """Return the section of damper curves, friction and the other elements."""
    blocks: list[Block] = [damper_picture(forces)]
    columns = ("#speed, m/s", *(f"#{name}" for name in damper_columns(forces)))
    rows = tuple(tuple(row) for row in damper_rows(forces))
    note = (
        "Of the damper, and with friction; each with half of its 95 % interval. Empty where the "
        "speed did not occur. The split rests on the law of the friction, the sum does not."
    )
    blocks.append(Table("Force of one corner at a speed, N", columns, rows, note))
    element_rows = tuple(
        (axle.axle, plain(name), value, low, high, unit)
        for axle in forces.axles
        for name, e in axle.values.items()
        for value, low, high, _, unit in [estimate_texts(e)]
    )
    if element_rows:
        columns = ("axle", "element", "#estimate", "#from", "#to", "unit")
        notes = "; ".join(f"{axle.axle} {note}" for axle in forces.axles for note in axle.notes)
        blocks.append(Table("Force elements of one corner", columns, element_rows, notes))
    tried = tuple(
        (plain(choice.name), number(choice.gain), number(choice.threshold), element_answer(choice))
        for choice in forces.choices
    )
    note = (
        "Gain is the fall of the squared residuals in units of the noise; needed is what the "
        "Bayesian information criterion needs for its number of unknowns."
    )
    blocks.append(
        Table("Elements that were tried", ("element", "#gain", "#needed", ""), tried, note)
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
    """Return the picture of the damper curves of both axles with their bands."""
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
    curves = {axle.axle: axle.damper for axle in forces.axles}
    speeds = np.concatenate([curve.speed_m_s for curve in curves.values()])
    forces_n = np.hstack([np.ravel((*c.band_n, c.force_n, c.total_n)) for c in curves.values()])
    for i, (axle_name, damper) in enumerate(curves.items()):
        axes = figure.add_axes((0.1 + i * 0.9 / n, 0.19, 0.9 / n - 0.07, 0.7))
        for line in (axes.axhline, axes.axvline):
            line(0.0, color=FAINT, linewidth=0.8, zorder=0)
        speed = damper.speed_m_s
        axes.fill_between(speed, *damper.band_n, color=PALETTE[1], alpha=0.25, lw=0)
        axes.plot(speed, damper.force_n, color=PALETTE[1], lw=1.4, label="damper, 95 % band")
        axes.plot(speed, damper.total_n, "--", color=PALETTE[2], lw=1.0, label="with friction")
        axes.set_title(axle_name)
        axes.set_xlim(*about_zero(speeds, 1.05))
        axes.set_ylim(*about_zero(forces_n, 1.05))
        axes.set_xlabel("speed, m/s, compression positive")
        if not i:
            axes.set_ylabel("force, N")
            axes.legend(frameon=False, fontsize=7.5, loc="upper left")


# Modes of each mass state -------------------------------------------------------------------------


def modes_section(result: Identification, diagrams: Mapping[str, StabilisationDiagram]) -> Section:
    """Return the section of the modes of every mass state."""
    blocks: list[Block] = [_modes_table(result, state) for state in result.modal]
    blocks += [moving_cars(result, state) for state in result.modal]
    pictures = [
        stabilisation_picture(
            f"stabilisation_{state}",
            f"Mass state {state}",
            diagrams[state],
            np.array([mode.frequency.value for mode in result.modes[state]]),
        )
        for state in result.modal
        if state in diagrams
    ]
    if pictures:
        title = "Stabilisation: which poles recur when the rank is raised"
        caption = (
            "The State Variable Method alone, without a model of the car. Lines are the modes of "
            "the identified vehicle; poles of the structure lie above them in columns, poles of "
            "the noise are scattered."
        )
        blocks.append(Gallery(title, caption, tuple(pictures)))
    for state, model in result.sensed.items():
        frequencies = zip(model.frequencies_hz, model.frequency_std_hz, strict=True)
        dampings = zip(model.damping_ratios, model.damping_ratio_std, strict=True)
        rows = []
        for rank, estimates in enumerate(zip(frequencies, dampings, strict=True), start=1):
            texts = [with_half(float(value), float(std)) for value, std in estimates]
            (hz, _, hz_sigma), (ratio, _, ratio_sigma) = (text.partition(" ± ") for text in texts)
            rows.append((str(rank), hz, hz_sigma, ratio, ratio_sigma))
        title = f"Mass state {state} without a model of the car: State Variable Method"
        headings = ("#", "#Hz", "#sigma", "#damping ratio", "#sigma")
        note = "Found in the decays alone; sigma is the standard deviation."
        blocks.append(Table(title, headings, tuple(rows), note))
    return Section(
        "modes",
        "Modes of vibration",
        "Frequencies and damping ratios of the identified vehicle, with 95 % intervals, in each "
        "mass state.",
        tuple(blocks),
    )


def _modes_table(result: Identification, state: str) -> Table:
    """Return the table of the modes of a mass state, each with its rank in the first state."""
    first = next(iter(result.modal))
    pairs, note = result.pairings.get(state), ""
    rank_in_first: dict[int, int] = {}
    if pairs:
        rank_in_first = dict(zip(pairs.added.tolist(), pairs.baseline.tolist(), strict=True))
        if pairs.swapped:
            swapped = ", ".join(f"{i + 1} and {j + 1}" for i, j in pairs.swapped)
            note = (
                f"Modes {swapped} of state {first} change their order in state {state}: "
                "they are paired by shape (MAC), not by frequency."
            )
    first_heading, rows = (f"#in {first}",) if rank_in_first else (), []
    named = zip(result.mode_names[state], result.modes[state], strict=True)
    for i, (name, mode) in enumerate(named):
        partner = f"{rank_in_first[i] + 1}" if i in rank_in_first else ""
        texts = (*estimate_texts(mode.frequency)[:3], *estimate_texts(mode.damping_ratio)[:3])
        rows.append((f"{i + 1}", name, *([partner] if first_heading else []), *texts))
    return Table(
        f"Modes in mass state {state}",
        ("#", "mode", *first_heading, "#Hz", "#from", "#to", "#damping ratio", "#from", "#to"),
        tuple(rows),
        note,
    )


def moving_cars(result: Identification, state: str) -> MovingCars:
    """Return the mode shapes of one mass state as moving cars."""
    modes = zip(
        result.mode_names[state], result.modes[state], result.modal[state].shapes.T, strict=True
    )
    return MovingCars(
        f"shapes_{state}",
        f"Mode shapes in mass state {state}",
        "Enlarged, slowed down, and without their decay. Grey: the car at rest.",
        tuple(
            shape_of(f"{i} {name}", mode_text(mode), mode.frequency.value, shape, result.geometry)
            for i, (name, mode, shape) in enumerate(modes, start=1)
        ),
    )


def mode_text(mode: ModeEstimate, between: str = ", ") -> str:
    """Write frequency and damping ratio of a mode, with `between` them, as `1.23 Hz, 25.1 %`."""
    hz, ratio = mode.frequency, mode.damping_ratio
    if not (hz.determined and ratio.determined):
        return NOT_DETERMINED
    percent, *_ = rounded(*(100.0 * end for end in (ratio.value, ratio.low, ratio.high)))
    return f"{value_text(hz)} Hz{between}{percent} %"


def stabilisation_picture(
    key: str, title: str, diagram: StabilisationDiagram, modes_hz: Floats
) -> Picture:
    """Return the picture of poles by frequency and rank, with lines at the car's modes, (m,) Hz."""
    draw = partial(_draw_stabilisation, diagram, modes_hz)
    return Picture(key, title, "", HALF_IN, 2.7, draw)


def _draw_stabilisation(
    diagram: StabilisationDiagram, modes_hz: Floats, figure: FigureBase
) -> None:
    hz, rank = np.abs(diagram.poles) / (2.0 * np.pi), diagram.rank
    low, high = 0.6 * float(modes_hz.min(initial=1.0)), 1.35 * float(modes_hz.max(initial=1.0))
    axes = figure.add_axes((0.125, 0.155, 0.86, 0.75))
    for mode in modes_hz.tolist():
        axes.axvline(mode, color=PALETTE[2], lw=0.8, alpha=0.7)
    vibrating = (diagram.poles.imag > 0.0) & (hz < high)
    for is_of_kind, mark, colour, label in (
        (diagram.stable, "o", PALETTE[1], "recurs"),
        (~diagram.stable, "x", "#a8a8a8", "does not"),
    ):
        is_drawn = vibrating & is_of_kind
        axes.plot(hz[is_drawn], rank[is_drawn], mark, ms=2.5, mew=0.5, color=colour, label=label)
    axes.plot([], [], lw=1.0, color=PALETTE[2], label="identified mode")
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    ticks = [t for t in (0.5, 1, 2, 3, 5, 7, 10, 15, 20, 30) if low <= t <= high]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_ylim(0.0, float(np.max(rank, initial=1)) + 1.0)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("rank")
    axes.grid(axis="y", color=FAINT, lw=0.4)
    figure.legend(
        loc="upper right", ncols=3, frameon=False, fontsize=7.0, handlelength=1.2,
        borderaxespad=0.1, columnspacing=1.2, markerscale=1.6,
    )  # fmt: skip
