"""The modes of each mass state: table, moving cars, stabilisation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..estimate_text import Document
from ..fit.uncertainty import ModeEstimate
from ..modes.state_variable_method import StabilisationDiagram
from ..numbers import NOT_DETERMINED, rounded, with_half
from ..result import Identification
from .blocks import Block, Cell, Gallery, MovingCars, Picture, Section, Table, cited
from .cars import shape_of
from .figure import FAINT, HALF_IN, PALETTE, Drawing

if TYPE_CHECKING:
    from matplotlib.figure import FigureBase


def modes_section(
    result: Identification, document: Document, diagrams: Mapping[str, StabilisationDiagram]
) -> Section:
    """Return the modes of every mass state."""
    blocks: list[Block] = []
    for state in result.modal:
        blocks.append(_table(result, document, state))
    for state in result.modal:
        blocks.append(_cars(result, state))
    if diagrams:
        blocks.append(
            Gallery(
                "Stabilisation: which poles recur when the rank is raised",
                "The State Variable Method alone, without a model of the car. Lines are the "
                "modes of the identified vehicle; poles of the structure lie above them in "
                "columns, poles of the noise are scattered.",
                tuple(_picture(diagrams[s], result, s) for s in result.modal if s in diagrams),
            )
        )
    for state in result.sensed:
        blocks.append(_sensed(document, state))
    return Section(
        "modes",
        "Modes of vibration",
        "Frequencies and damping ratios of the identified vehicle, with 95 % intervals, in each "
        "mass state.",
        tuple(blocks),
    )


def _table(result: Identification, document: Document, state: str) -> Table:
    first = next(iter(result.modal))
    partner: dict[int, int] = {}
    note = ""
    if state in result.pairings:
        pairing = result.pairings[state]
        pairs = zip(pairing.baseline.tolist(), pairing.added.tolist(), strict=True)
        partner = {added: baseline for baseline, added in pairs}
        swaps = [f"{i + 1} and {j + 1}" for i, j in pairing.swapped]
        if swaps:
            note = (
                f"Modes {', '.join(swaps)} of state {first} change their order in state {state}: "
                "they are paired by shape (MAC), not by frequency."
            )
    rows = []
    for i in range(len(document["modes"][state])):
        rows.append(
            (
                Cell(f"{i + 1}"),
                cited(document, "modes", state, i, "name", form=str),
                *((Cell(f"{partner[i] + 1}" if i in partner else ""),) if partner else ()),
                *_mode_cells(document, state, i),
            )
        )
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
    hertz, *_ = rounded(hz.value, hz.low, hz.high)
    percent, *_ = rounded(*(100.0 * end for end in (ratio.value, ratio.low, ratio.high)))
    return f"{hertz} Hz, {percent} %"


def _mode_cells(document: Document, state: str, i: int) -> tuple[Cell, ...]:
    """Return frequency and damping ratio, each with the ends of its interval."""
    mode = document["modes"][state][i]
    texts = (
        *rounded(mode["frequency_hz"], mode["frequency_low_hz"], mode["frequency_high_hz"]),
        *rounded(mode["damping_ratio"], mode["damping_ratio_low"], mode["damping_ratio_high"]),
    )
    return tuple(Cell(text, f"modes/{state}/{i}") for text in texts)


def _sensed(document: Document, state: str) -> Table:
    rows = [
        (Cell(f"{i + 1}"), *(Cell(text, f"sensed_modes/{state}/{i}") for text in _with_sigma(mode)))
        for i, mode in enumerate(document["sensed_modes"][state])
    ]
    return Table(
        f"Mass state {state} without a model of the car: State Variable Method",
        ("#", "#Hz", "#sigma", "#damping ratio", "#sigma"),
        tuple(rows),
        "Found in the decays alone; sigma is the standard deviation.",
    )


def _with_sigma(mode: Mapping[str, float]) -> Iterator[str]:
    """Yield frequency and damping ratio, each with its standard deviation and fitting digits."""
    for value, sigma in (
        (mode["frequency_hz"], mode["frequency_std_hz"]),
        (mode["damping_ratio"], mode["damping_ratio_std"]),
    ):
        text, _, width = with_half(value, sigma).partition(" ± ")
        yield from (text, width)


def _cars(result: Identification, state: str) -> MovingCars:
    shapes = tuple(
        shape_of(f"{i + 1} {name}", mode_text(mode), mode.frequency.value, shape, result.geometry)
        for i, (name, mode, shape) in enumerate(
            zip(
                result.mode_names[state],
                result.modes[state],
                result.modal[state].shapes.T,
                strict=True,
            )
        )
    )
    return MovingCars(
        f"shapes_{state}",
        f"Mode shapes in mass state {state}",
        "Enlarged, slowed down, and without their decay. Grey: the car at rest.",
        shapes,
    )


def _picture(diagram: StabilisationDiagram, result: Identification, state: str) -> Picture:
    return Picture(
        f"stabilisation_{state}",
        f"Mass state {state}",
        "",
        stabilisation_drawing(
            diagram, np.array([mode.frequency.value for mode in result.modes[state]])
        ),
    )


def stabilisation_drawing(diagram: StabilisationDiagram, modes_hz: NDArray[np.float64]) -> Drawing:
    """Return a drawing of frequency across and rank upwards, with lines at the modes, (m,) Hz."""
    return Drawing(HALF_IN, 2.7, partial(_draw_stabilisation, diagram, modes_hz))


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
