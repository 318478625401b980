"""The modes of each mass state: table, moving cars, stabilisation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ..document import Document, SensedModeEntry
from ..fit.uncertainty import ModeEstimate
from ..identification import Identification
from ..modes.stabilisation import StabilisationDiagram
from ..numbers import NOT_DETERMINED, rounded, with_half
from .blocks import Block, Cell, Gallery, MovingCars, Picture, Section, Table, cited
from .panels import StabilisationPanel
from .shapes import shape_of


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


def _with_sigma(mode: SensedModeEntry) -> Iterator[str]:
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
        StabilisationPanel(
            np.where(diagram.poles.imag > 0.0, np.abs(diagram.poles) / (2.0 * np.pi), 0.0),
            diagram.rank.astype(float),
            diagram.stable,
            np.array([mode.frequency.value for mode in result.modes[state]]),
        ),
    )
