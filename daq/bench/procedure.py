"""How the car is bumped, as data of the campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

from ..runs import Excitation


class Method(StrEnum):
    """How a bump is made."""

    ROLL_OVER = "roll_over"
    """The car rolls over a board: the chosen wheels rise and fall within a fraction of a second."""
    DROP = "drop"
    """The chosen wheels stand on blocks and drop off them."""
    PUSH = "push"
    """The body is pushed down by hand and let go."""


def _no_instructions() -> Mapping[Excitation, str]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Procedure:
    """How the bumps of a campaign are made."""

    method: Method = Method.ROLL_OVER
    """The way of bumping."""
    bump_height_m: float = 0.04
    """Height of board or block, or depth of the push."""
    accept_after_s: float = 3.0
    """The operator's time to reject a run before the next is armed."""
    instructions: Mapping[Excitation, str] = field(default_factory=_no_instructions)
    """The operator's instructions, for the bumps whose usual ones do not fit."""


def _usual_instructions() -> Mapping[tuple[Method, Excitation], str]:
    roll, drop, push = Method.ROLL_OVER, Method.DROP, Method.PUSH
    return {
        (roll, Excitation.BOUNCE): (
            "Boards of {mm} mm before all four wheels: roll over them at walking pace and stop."
        ),
        (roll, Excitation.PITCH): (
            "Boards of {mm} mm before both front wheels: roll over them at walking pace and stop "
            "before the rear wheels meet them."
        ),
        (roll, Excitation.ROLL): (
            "Boards of {mm} mm before both left wheels: roll over them at walking pace and stop."
        ),
        (roll, Excitation.WARP): (
            "Boards of {mm} mm before the front left and the rear right wheel: roll over them at "
            "walking pace and stop."
        ),
        (drop, Excitation.BOUNCE): (
            "All four wheels on blocks of {mm} mm: pull all blocks away at once."
        ),
        (drop, Excitation.PITCH): (
            "Both front wheels on blocks of {mm} mm: pull both blocks away at once."
        ),
        (drop, Excitation.ROLL): (
            "Both left wheels on blocks of {mm} mm: pull both blocks away at once."
        ),
        (drop, Excitation.WARP): (
            "Front left and rear right wheel on blocks of {mm} mm: pull both blocks away at once."
        ),
        (push, Excitation.BOUNCE): (
            "Push the body {mm} mm down in its middle, from both sides, and let go at once."
        ),
        (push, Excitation.PITCH): (
            "Push the nose {mm} mm down in the middle of the bonnet and let go at once."
        ),
        (push, Excitation.ROLL): (
            "Push the left sill {mm} mm down in its middle and let go at once."
        ),
        (push, Excitation.WARP): (
            "A push cannot warp the wheels: put front left and rear right on blocks and drop them."
        ),
    }


_USUAL_INSTRUCTIONS = _usual_instructions()
_FRONT, _REAR, _LEFT = (0, 1), (2, 3), (0, 2)
_STRUCK: Mapping[Excitation, tuple[int, ...]] = {
    Excitation.BOUNCE: (*_FRONT, *_REAR),
    Excitation.PITCH: _FRONT,
    Excitation.ROLL: _LEFT,
    Excitation.WARP: (0, 3),
}
"""Wheels that the bump is under, by their position in `daq.vehicle.Corner`."""


def instruction(procedure: Procedure, excitation: Excitation) -> str:
    """Return the operator's instruction for a bump."""
    own = procedure.instructions.get(excitation, "")
    usual = _USUAL_INSTRUCTIONS[procedure.method, excitation]
    return own or usual.format(mm=f"{procedure.bump_height_m * 1e3:g}")


def sketch(procedure: Procedure, excitation: Excitation) -> tuple[str, ...]:
    """Return a top view of the car, front on top, with what the operator has to place or push.

    Returns
    -------
    tuple of str
        At most 8 lines of at most 30 plain ASCII characters.
    """
    height = f"{procedure.bump_height_m * 1e3:g} mm"
    struck = _STRUCK[excitation]
    if procedure.method is Method.PUSH and excitation is not Excitation.WARP:
        row, column = {
            Excitation.BOUNCE: (3, 13),
            Excitation.PITCH: (1, 13),
            Excitation.ROLL: (3, 7),
        }[excitation]
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
        boards = [" === " if corner in struck else "     " for corner in range(4)]
        wheels, legend = ["[ ]"] * 4, f"  === board, {height}"
    else:
        boards = ["     "] * 4
        wheels = ["[#]" if corner in struck else "[ ]" for corner in range(4)]
        legend = f"  [#] wheel on a block, {height}"
    lines = ["            front"]
    for left, right in (_FRONT, _REAR):
        lines.append(f"    {boards[left]}       {boards[right]}".rstrip())
        lines.append(f"     {wheels[left]}---------{wheels[right]}")
        lines.append("      |           |")
    return (*lines[:-1], legend)
