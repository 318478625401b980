"""The modes of each mass state: table, moving cars, stabilisation."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..fit.uncertainty import ModeEstimate
from ..modes.modal_model import ModalModel
from ..modes.state_variable_method import StabilisationDiagram
from ..numbers import NOT_DETERMINED, rounded, with_half
from ..result import Identification
from ..words import value_text
from .cars import shape_of
from .figure import FAINT, HALF_IN, PALETTE
from .page import Block, Gallery, MovingCars, Picture, Section, Table
from .parameters import estimate_texts

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase


def modes_section(result: Identification, diagrams: Mapping[str, StabilisationDiagram]) -> Section:
    """Return the modes of every mass state."""
    blocks: list[Block] = [_table(result, state) for state in result.modal]
    blocks += [moving_cars(result, state) for state in result.modal]
    if diagrams:
        pictures = []
        for state in result.modal:
            if state in diagrams:
                modes_hz = np.array([mode.frequency.value for mode in result.modes[state]])
                key, title = f"stabilisation_{state}", f"Mass state {state}"
                pictures.append(stabilisation_picture(key, title, diagrams[state], modes_hz))
        blocks.append(
            Gallery(
                "Stabilisation: which poles recur when the rank is raised",
                "The State Variable Method alone, without a model of the car. Lines are the "
                "modes of the identified vehicle; poles of the structure lie above them in "
                "columns, poles of the noise are scattered.",
                tuple(pictures),
            )
        )
    blocks += [_sensed(state, model) for state, model in result.sensed.items()]
    return Section(
        "modes",
        "Modes of vibration",
        "Frequencies and damping ratios of the identified vehicle, with 95 % intervals, in each "
        "mass state.",
        tuple(blocks),
    )


def _table(result: Identification, state: str) -> Table:
    first = next(iter(result.modal))
    partner: dict[int, int] = {}
    note = ""
    if state in result.pairings:
        pairs = result.pairings[state]
        partner = dict(zip(pairs.added.tolist(), pairs.baseline.tolist(), strict=True))
        if pairs.swapped:
            swaps = ", ".join(f"{i + 1} and {j + 1}" for i, j in pairs.swapped)
            note = (
                f"Modes {swaps} of state {first} change their order in state {state}: "
                "they are paired by shape (MAC), not by frequency."
            )
    rows = []
    named = zip(result.mode_names[state], result.modes[state], strict=True)
    for i, (name, mode) in enumerate(named):
        texts = (estimate_texts(e)[:3] for e in (mode.frequency, mode.damping_ratio))
        paired = ((f"{partner[i] + 1}" if i in partner else ""),) if partner else ()
        rows.append((f"{i + 1}", name, *paired, *(text for three in texts for text in three)))
    partners = (f"#in {first}",) if partner else ()
    return Table(
        f"Modes in mass state {state}",
        ("#", "mode", *partners, "#Hz", "#from", "#to", "#damping ratio", "#from", "#to"),
        tuple(rows),
        note,
    )


def mode_text(mode: ModeEstimate) -> str:
    """Write frequency and damping ratio of a mode in a few characters."""
    hz, ratio = mode.frequency, mode.damping_ratio
    if not (hz.determined and ratio.determined):
        return NOT_DETERMINED
    percent, *_ = rounded(*(100.0 * end for end in (ratio.value, ratio.low, ratio.high)))
    return f"{value_text(hz)} Hz, {percent} %"


def _sensed(state: str, model: ModalModel) -> Table:
    columns = (
        (model.frequencies_hz, model.frequency_std_hz),
        (model.damping_ratios, model.damping_ratio_std),
    )
    rows = []
    for i in range(len(model)):
        texts = [with_half(float(v[i]), float(std[i])).partition(" ± ") for v, std in columns]
        rows.append((f"{i + 1}", *(part for text in texts for part in text[::2])))
    return Table(
        f"Mass state {state} without a model of the car: State Variable Method",
        ("#", "#Hz", "#sigma", "#damping ratio", "#sigma"),
        tuple(rows),
        "Found in the decays alone; sigma is the standard deviation.",
    )


def moving_cars(result: Identification, state: str) -> MovingCars:
    """Return the mode shapes of one mass state."""
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


def stabilisation_picture(
    key: str, title: str, diagram: StabilisationDiagram, modes_hz: NDArray[np.float64]
) -> Picture:
    """Return frequency across and rank upwards, with lines at the modes, (m,) Hz."""
    draw = partial(_draw_stabilisation, diagram, modes_hz)
    return Picture(key, title, "", HALF_IN, 2.7, draw)


def _draw_stabilisation(
    diagram: StabilisationDiagram, modes_hz: NDArray[np.float64], figure: FigureBase
) -> None:
    hz, rank = np.abs(diagram.poles) / (2.0 * np.pi), diagram.rank
    axes = figure.add_axes((0.125, 0.155, 0.86, 0.75))
    for mode in modes_hz:
        axes.axvline(float(mode), color=PALETTE[2], lw=0.8, alpha=0.7)
    top = 1.35 * float(modes_hz.max(initial=1.0))
    shown = (diagram.poles.imag > 0.0) & (hz < top)
    loose, stable = shown & ~diagram.stable, shown & diagram.stable
    axes.plot(hz[loose], rank[loose], "x", ms=2.6, mew=0.5, color="#a8a8a8")
    axes.plot(hz[stable], rank[stable], "o", ms=2.4, mew=0, color=PALETTE[1])
    axes.set_xscale("log")
    low = 0.6 * float(modes_hz.min(initial=1.0))
    axes.set_xlim(low, top)
    ticks = [t for t in (0.5, 1, 2, 3, 5, 7, 10, 15, 20, 30) if low <= t <= top]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.set_ylim(0.0, float(np.max(rank, initial=1)) + 1.0)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("rank")
    axes.grid(axis="y", color=FAINT, lw=0.4)
    handles = [
        axes.plot([], [], "o", ms=4.0, mew=0, color=PALETTE[1], label="recurs")[0],
        axes.plot([], [], "x", ms=4.0, color="#a8a8a8", label="does not")[0],
        axes.plot([], [], "-", lw=1.0, color=PALETTE[2], label="identified mode")[0],
    ]
    figure.legend(
        handles=handles, loc="upper right", ncols=3, frameon=False, fontsize=7.0, handlelength=1.2,
        borderaxespad=0.1, columnspacing=1.2,
    )  # fmt: skip
