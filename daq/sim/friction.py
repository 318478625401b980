"""Computes dry friction that sticks: laws of Dahl, and of Canudas de Wit and others (LuGre).

The rubber and the seals of a corner yield before it slides.  Their deflection, as a share of the
deflection at which sliding begins, is the memory of the law::

    share' = (w - |w| share / s(w)) / d          F = F_c share
    s(w) = 1 + (static ratio - 1) exp(-(w / v_s)^2)

with the closing speed w, the pre-sliding length d and sliding friction F_c.  A static ratio of 1 is
Dahl's law.  The small damping of the bristles, which LuGre may have, is left out, because every
corner has a damper in parallel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ONE = np.ones((1, 1))


@dataclass(frozen=True, slots=True)
class FrictionLaw:
    """Friction of four corners."""

    force_n: Array
    """(4, 1) Sliding friction, N."""
    presliding_m: Array
    """(4, 1) Length over which friction builds up, m."""
    surplus: Array | None
    """(4, 1) Relative excess of static friction over sliding friction; None for Dahl's law."""
    stribeck_m_s: Array
    """(4, 1) Speed over which that excess decreases, m/s."""

    @property
    def present(self) -> bool:
        """True if any corner has friction."""
        return bool(np.any(self.force_n))

    def sliding_share(self, closing: Array) -> Array:
        """Return the share at which a corner slides steadily, (4, n); 1 for Dahl's law."""
        if self.surplus is None:
            return _ONE
        fall = np.exp(-((closing / self.stribeck_m_s) ** 2))
        return np.asarray(1.0 + self.surplus * fall, dtype=np.float64)

    def slid(self, share: Array, closing: Array, time_s: float) -> Array:
        """Return the shares after a time at constant speeds; the law is solved exactly.

        `share`, (4, n) float64: before.  `closing`, (4, n) float64: speed of each corner, m/s.
        `time_s`: duration, s.
        """
        limit = self.sliding_share(closing)
        travel = np.abs(closing) * time_s
        left = np.exp(-travel / (self.presliding_m * limit))
        target = np.copysign(limit, closing)
        return np.asarray(target + (share - target) * left, dtype=np.float64)
