"""Lists the wheels that may be struck together; gives the likeness of a motion to each bump."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..bumps import Wheels, kinds_of
from ..runs import Excitation
from ..vehicle import Corner

Corners = NDArray[np.float64]
"""Values of the four corners, (4,), in the order of `Corner`."""

PATTERNS: Mapping[str, Corners] = MappingProxyType(
    {
        "bounce": np.array([1.0, 1.0, 1.0, 1.0]) / 2,
        "pitch": np.array([1.0, 1.0, -1.0, -1.0]) / 2,
        "roll": np.array([1.0, -1.0, 1.0, -1.0]) / 2,
        "warp": np.array([1.0, -1.0, -1.0, 1.0]) / 2,
    }
)
"""Orthonormal patterns, of which any motion of four corners is a sum."""

_FL, _FR, _RL, _RR = Corner
TOGETHER: Mapping[Wheels, str] = MappingProxyType(
    {
        Wheels(Corner): "all four wheels",
        Wheels({_FL, _FR}): "front wheels only",
        Wheels({_RL, _RR}): "rear wheels only",
        Wheels({_FL, _RL}): "left wheels only",
        Wheels({_FR, _RR}): "right wheels only",
        Wheels({_FL, _RR}): "front left and rear right",
        Wheels({_FR, _RL}): "front right and rear left",
    }
)
"""Sets of wheels that boards or blocks may lift together, with names."""
STRIKES = tuple(Wheels(some) for n in (4, 2, 1, 3) for some in combinations(Corner, n))
"""All sets of wheels that may be struck together."""


class Pattern(NamedTuple):
    """The kind of bump that some of the sensors show."""

    shares: Mapping[str, float]
    """Shares of bounce, pitch, roll and warp in the motion, 0..1; empty if unknown."""
    likeness: Mapping[Excitation, float]
    """Likeness to each kind of bump, 0..1; equal for kinds that these sensors cannot separate, or
    the campaign does not distinguish."""
    words: str
    """The motion in words."""
    by: str
    """The sensors, in words."""
    limit: float
    """Least likeness to the kind that is due."""
    strikes: Mapping[Wheels, float] = MappingProxyType({})
    """Likeness to a strike of these wheels, 0..1."""


def in_words(wheels: Wheels) -> str:
    """Return struck wheels in words."""
    few = "one wheel only" if len(wheels) == 1 else "three wheels"
    return TOGETHER.get(wheels, few)


def shares_of(size: Corners) -> Mapping[str, float]:
    """Return the share of each pattern in the power of four corners."""
    power = {name: float(size @ row) ** 2 for name, row in PATTERNS.items()}
    total = max(sum(power.values()), 1e-24)
    return MappingProxyType({name: value / total for name, value in power.items()})


def likeness_of(
    like: Mapping[Wheels, float], planned: tuple[Excitation, ...]
) -> Mapping[Excitation, float]:
    """Return the likeness to each kind of bump, from the likeness to each strike.

    `like`: likeness to a strike of these wheels, 0..1.  `planned`: the kinds of the campaign.
    """
    result = dict.fromkeys(Excitation, 0.0)
    for wheels, share in like.items():
        for kind in kinds_of(wheels, planned):
            result[kind] = max(result[kind], share)
    return MappingProxyType(result)
