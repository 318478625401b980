"""How the car is bumped, as data of the campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType

from .runs import Excitation


class Method(StrEnum):
    """How a bump is made."""

    ROLL_OVER = "roll_over"
    """The car rolls over a board: the chosen wheels rise and fall within a fraction of a second."""
    DROP = "drop"
    """The chosen wheels stand on blocks and drop off them."""
    PUSH = "push"
    """The body is pushed down by hand and let go."""


def _usual() -> Mapping[Excitation, str]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Procedure:
    """How the bumps of a campaign are made.

    Parameters
    ----------
    method : Method
        The way of bumping.
    bump_height_m : float
        Height of board or block, or depth of the push.
    accept_after_s : float
        The operator's time to reject a run before the next is armed.
    instructions : mapping of Excitation to str
        What the operator is told, where it is not the usual.
    """

    method: Method = Method.ROLL_OVER
    bump_height_m: float = 0.04
    accept_after_s: float = 3.0
    instructions: Mapping[Excitation, str] = field(default_factory=_usual)
