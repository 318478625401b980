"""Faults of one bump of the simulated bench, on request."""

from __future__ import annotations

from enum import StrEnum

from ..runs import Excitation


class Fault(StrEnum):
    """Kinds of spoilt runs."""

    DOUBLE_BUMP = "double-bump"
    OVERLOAD = "overload"
    """A sensor saturates at half of what it should show."""
    LOST_FRAMES = "lost-frames"
    """For a moment no frame arrives."""
    WEAK = "weak"
    """The bump just triggers."""
    WRONG_MODE = "wrong-mode"
    """Another kind of bump than the one that is due."""
    UNPLUG = "unplug"
    """The adapter is gone for some seconds."""


SPOILT_BUMP = 2
"""Which bump of the campaign it is: one good run comes first."""
SECOND_BUMP_S = 0.84
LOST_S = (0.3, 0.42)
"""When no frame arrives, since the bump: more than the few that cost nothing, and shorter than the
silence of a sensor that stopped."""
WEAK_LEVELS = 1.4
"""Peak over the trigger's level: above it in spite of noise, below what a good bump shows."""
UNPLUGGED_S = 3.0
"""Time without the adapter, s of the host's time."""
UNPLUG_AFTER_S = 0.5
"""Time from the bump to the unplugging, s."""


def mixed_up(due: Excitation) -> Excitation:
    """Return another kind of bump than the one that is due."""
    return {Excitation.BOUNCE: Excitation.PITCH, Excitation.ROLL: Excitation.BOUNCE}.get(
        due, Excitation.ROLL
    )
