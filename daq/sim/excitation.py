"""Computes the road: half-sine bumps under chosen wheels (Eq. 34)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..bumps import BUMPS
from ..runs import Excitation

_SHARE = {excitation: np.array(bump.shares)[:, None] for excitation, bump in BUMPS.items()}
"""1 for each wheel that is lifted, else 0, (4, 1); stored, because the integration needs it
often."""


@dataclass(frozen=True, slots=True)
class Bump:
    """A half-sine bump that the chosen wheels pass at the same time."""

    excitation: Excitation
    """Kind of bump (`daq.bumps.BUMPS`)."""
    height_m: float
    """Height of the bump, m."""
    start_s: float
    """Time at which the wheels meet the bump, s."""
    duration_s: float
    """Time for which the wheels are on the bump, s."""

    @property
    def end_s(self) -> float:
        """Time at which the wheels have left the bump and the free decay starts, s."""
        return self.start_s + self.duration_s

    @property
    def crest_m(self) -> NDArray[np.float64]:
        """Height of the bump under each wheel, (4, 1), m, in the order of `Corner`."""
        return self.height_m * _SHARE[self.excitation]


def road_height(bump: Bump, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the height of the road under each wheel (Eq. 34).

    `t_s`, (n,) float64: time, s.  Returns (4, n) float64: m, zero before and after the bump.
    """
    # Limiting the phase to 0..1 makes the road flat outside the bump without a mask.
    phase = np.minimum(np.maximum((t_s - bump.start_s) / bump.duration_s, 0.0), 1.0)
    return np.asarray(bump.crest_m * np.sin(np.pi * phase), dtype=np.float64)


def road_speed(bump: Bump, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertical speed of the road under each wheel, (4, n), m/s; as `road_height`.

    It jumps where the bump begins and ends; those two instants count as on the bump.
    """
    phase = (t_s - bump.start_s) / bump.duration_s
    slope = np.cos(np.pi * phase) * ((phase >= 0.0) & (phase <= 1.0))
    return np.asarray(bump.crest_m * (np.pi / bump.duration_s) * slope, dtype=np.float64)
