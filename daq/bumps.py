"""Defines every kind of bump in one table: which wheels it lifts, and how a person makes it.

Bench, simulated car, verdict and identification read this table.  A new kind needs only a member of
`daq.runs.Excitation` and a row of `BUMPS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from .runs import Excitation
from .vehicle import Corner

Wheels = frozenset[Corner]

_FL, _FR, _RL, _RR = Corner
_FRONT, _REAR, _LEFT = Wheels({_FL, _FR}), Wheels({_RL, _RR}), Wheels({_FL, _RL})


@dataclass(frozen=True, slots=True)
class BumpKind:
    """One kind of bump; `{mm}` in an instruction is replaced by its height."""

    wheels: Wheels
    """Wheels that board or block lifts."""
    roll_over: str
    """The operator's instruction where the car rolls over boards."""
    drop: str
    """The operator's instruction where its wheels drop off blocks."""
    push: str
    """The operator's instruction where its body is pushed down by hand."""
    hand: tuple[int, int] | None
    """Position of the hands: forward (1, 0, -1) and to the left (1, 0, -1) of the body's middle;
    None if a push cannot make this bump."""

    @property
    def height_ratios(self) -> tuple[float, float, float, float]:
        """Height under each wheel to that of the bump, 1 or 0, in the order of `Corner`."""
        fl, fr, rl, rr = (float(corner in self.wheels) for corner in Corner)
        return fl, fr, rl, rr


BUMPS: Mapping[Excitation, BumpKind] = {
    Excitation.BOUNCE: BumpKind(
        Wheels(Corner),
        "Boards of {mm} mm before all four wheels: roll over them at walking pace and stop.",
        "All four wheels on blocks of {mm} mm: pull all blocks away at once.",
        "Push the body {mm} mm down in its middle, from both sides, and let go at once.",
        (0, 0),
    ),
    Excitation.PITCH: BumpKind(
        _FRONT,
        "Boards of {mm} mm before both front wheels: roll over them at walking pace and stop "
        "before the rear wheels meet them.",
        "Both front wheels on blocks of {mm} mm: pull both blocks away at once.",
        "Push the nose {mm} mm down in the middle of the bonnet and let go at once.",
        (1, 0),
    ),
    Excitation.ROLL: BumpKind(
        _LEFT,
        "Boards of {mm} mm before both left wheels: roll over them at walking pace and stop.",
        "Both left wheels on blocks of {mm} mm: pull both blocks away at once.",
        "Push the left sill {mm} mm down in its middle and let go at once.",
        (0, 1),
    ),
    Excitation.WARP: BumpKind(
        Wheels({_FL, _RR}),
        "Boards of {mm} mm before the front left and the rear right wheel: roll over them at "
        "walking pace and stop.",
        "Front left and rear right wheel on blocks of {mm} mm: pull both blocks away at once.",
        "A push cannot warp the wheels: put front left and rear right on blocks and drop them.",
        None,
    ),
    Excitation.REAR_PITCH: BumpKind(
        _REAR,
        "Boards of {mm} mm before both rear wheels, the front ones beyond them: roll over them "
        "at walking pace and stop.",
        "Both rear wheels on blocks of {mm} mm: pull both blocks away at once.",
        "Push the tail {mm} mm down in the middle of the boot lid and let go at once.",
        (-1, 0),
    ),
}
"""The kinds of bump, in the order of `Excitation`."""


@cache
def kinds_of(wheels: Wheels, planned: tuple[Excitation, ...]) -> tuple[Excitation, ...]:
    """Return the kinds of bump as which a campaign accepts the struck wheels; may be empty.

    Either side, axle or diagonal is accepted, because the identification finds which one was
    struck: a mirror image counts as the same kind, unless the campaign plans it as a separate kind.

    `wheels`: the wheels that were struck.  `planned`: the kinds of the campaign.
    """
    corner_at = {(corner.front, corner.side): corner for corner in Corner}
    mirror_images = {  # `is not` exchanges the axles where `swaps_axles` is true
        Wheels(corner_at[c.front is not swaps_axles, c.side * side_sign] for c in wheels)
        for swaps_axles in (False, True)
        for side_sign in (1, -1)
    }
    exact = tuple(kind for kind in planned if BUMPS[kind].wheels == wheels)
    return exact or tuple(kind for kind, bump in BUMPS.items() if bump.wheels in mirror_images)
