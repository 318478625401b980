"""Defines the campaign as data: the mass states, the kinds of bump and the number of repeats."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

from ..bumps import BUMPS
from ..runs import ADDED, BASELINE, Excitation, run_label


@dataclass(frozen=True, slots=True)
class Step:
    """One run of the campaign."""

    mass_state: str
    excitation: Excitation
    repeat: int

    @property
    def label(self) -> str:
        """`baseline_bounce_1` and the like."""
        return run_label(self.mass_state, self.excitation, self.repeat)


@dataclass(frozen=True, slots=True)
class Campaign:
    """All combinations of mass states, excitations and repeats, in the order of the runs."""

    excitations: tuple[Excitation, ...] = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    """The kinds of bump."""
    repeats: int = 2
    """Number of runs of each kind of bump in each mass state."""
    mass_states: tuple[str, ...] = (BASELINE, ADDED)
    """The states of loading; the runs are ordered so that masses are changed as seldom as
    possible."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """Every run, in order."""
        return tuple(
            Step(mass_state, excitation, repeat)
            for mass_state in self.mass_states
            for excitation in self.excitations
            for repeat in range(1, self.repeats + 1)
        )


# Describes how the car is bumped, as data of the campaign -----------------------------------------


class Method(StrEnum):
    """The way in which a bump is made."""

    ROLL_OVER = "roll_over"
    """The car rolls over a board: the chosen wheels rise and fall within a fraction of a second."""
    DROP = "drop"
    """The chosen wheels drop off blocks."""
    PUSH = "push"
    """The body is pushed down by hand and let go."""


@dataclass(frozen=True, slots=True)
class Procedure:
    """The way in which the bumps of a campaign are made."""

    method: Method = Method.ROLL_OVER
    """The method of bumping."""
    bump_height_m: float = 0.04
    """Height of board or block, or depth of the push, m."""
    accept_after_s: float = 3.0
    """Time that the operator has to reject a run before the next is armed, s."""
    instructions: Mapping[Excitation, str] = field(default_factory=lambda: MappingProxyType({}))
    """The operator's instructions for the bumps whose usual instructions do not fit."""


_FRONT, _REAR = (0, 1), (2, 3)


def instruction(procedure: Procedure, excitation: Excitation) -> str:
    """Return the operator's instruction for a bump."""
    stated = procedure.instructions.get(excitation, "")
    bump = BUMPS[excitation]
    usual = {
        Method.ROLL_OVER: bump.roll_over,
        Method.DROP: bump.drop,
        Method.PUSH: bump.push,
    }[procedure.method]
    return stated or usual.format(mm=f"{procedure.bump_height_m * 1e3:g}")


def sketch(procedure: Procedure, excitation: Excitation) -> tuple[str, ...]:
    """Return a top view of the car, front on top, with what the operator has to place or push.

    At most 8 lines of at most 30 plain ASCII characters.
    """
    height = f"{procedure.bump_height_m * 1e3:g} mm"
    bump = BUMPS[excitation]
    if procedure.method is Method.PUSH and bump.hand is not None:
        forward, left = bump.hand
        row, column = 3 - 2 * forward, 13 - 6 * left
        lines = [
            "            front",
            "      +-------------+",
            "     [|             |]",
            "      |             |",
            "     [|             |]",
            "      +-------------+",
        ]
        lines[row] = lines[row][: column - 1] + "(V)" + lines[row][column + 2 :]
        return (*lines, f"  (V) push {height} down here")
    if procedure.method is Method.ROLL_OVER:
        boards = [" === " if bump.shares[corner] else "     " for corner in range(4)]
        wheels, legend = ["[ ]"] * 4, f"  === board, {height}"
    else:
        boards = ["     "] * 4
        wheels = ["[#]" if bump.shares[corner] else "[ ]" for corner in range(4)]
        legend = f"  [#] wheel on a block, {height}"
    lines = ["            front"]
    for left, right in (_FRONT, _REAR):
        lines.append(f"    {boards[left]}       {boards[right]}".rstrip())
        lines.append(f"     {wheels[left]}---------{wheels[right]}")
        lines.append("      |           |")
    return (*lines[:-1], legend)


# Defines the origin of the frames of a recording --------------------------------------------------


class Origin(StrEnum):
    """Marks data as a measurement or a demonstration wherever they are shown or stored."""

    REAL = "real"
    """A bus; nothing more is known."""
    SIMULATED = "simulated"
    """The simulated car, within the recorder's own process."""
    REPLAYED = "replayed"
    """An earlier recording, played to a recorder."""
