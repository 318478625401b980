"""Defines faults of one bump of the simulated bench, on request."""

from __future__ import annotations

from enum import StrEnum

from ..runs import Excitation


class Fault(StrEnum):
    """Kinds of spoilt runs."""

    DOUBLE_BUMP = "double-bump"
    OVERLOAD = "overload"
    """A sensor saturates at half of its true reading."""
    FROZEN = "frozen"
    """A sensor shows one value during the bump."""
    LOST_FRAMES = "lost-frames"
    """For a short time no frame arrives."""
    WEAK = "weak"
    """The bump only just triggers."""
    WRONG_MODE = "wrong-mode"
    """Another kind of bump than the one that is due."""
    UNPLUG = "unplug"
    """The adapter is unplugged for some seconds."""


SPOILT_BUMP = 2
"""Number of the spoilt bump of the campaign: one good run comes first."""
SECOND_BUMP_S = 0.84
LOST_S = (0.3, 0.42)
"""Begin and end of the time without frames, s since the bump: more frames than the few that are
harmless, and shorter than the silence of a sensor that stopped."""
WEAK_LEVELS = 1.4
"""Ratio of the peak to the trigger's level: above 1 in spite of noise, below that of a good
bump."""
UNPLUGGED_S = 3.0
"""Time without the adapter, s of the host's time."""
UNPLUG_AFTER_S = 0.5
"""Time from the bump to the unplugging, s."""


def mixed_up(due: Excitation) -> Excitation:
    """Return another kind of bump than the one that is due."""
    return {Excitation.BOUNCE: Excitation.PITCH, Excitation.ROLL: Excitation.BOUNCE}.get(
        due, Excitation.ROLL
    )
