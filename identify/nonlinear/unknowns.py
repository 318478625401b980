"""The unknowns of the nonlinear elements, in addition to those of the grey box."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

_SPEEDS_M_S = (0.015, 0.03, 0.045, 0.065, 0.085, 0.11, 0.15, 0.21, 0.3, 0.45)
_CLOSE_M_S = (
    0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.095, 0.11, 0.13, 0.155, 0.19, 0.23, 0.3, 0.4,
    0.55, 0.75,
)  # fmt: skip
KNOTS: dict[str, tuple[float, ...]] = {
    "K1": (0.0,),
    "K3": (-0.15, 0.0, 0.15),
    "K5": (-0.3, -0.1, 0.0, 0.1, 0.3),
    "K7": (-0.4, -0.2, -0.08, 0.0, 0.08, 0.2, 0.4),
    "K21": (*(-speed for speed in reversed(_SPEEDS_M_S)), 0.0, *_SPEEDS_M_S),
    "K37": (*(-speed for speed in reversed(_CLOSE_M_S)), 0.0, *_CLOSE_M_S),
}
"""Speeds of the knees of a damper curve, m/s; negative in rebound."""

REACH = 0.5
"""Largest change of an unknown in one step of a fit, unless it has its own reach."""


@dataclass(frozen=True, slots=True)
class Element:
    """One unknown of a nonlinear element, of one axle."""

    name: str
    """With the axle at its end: `F_cf` is the friction of a front corner."""
    unit: str
    """SI."""
    scale: float
    """Value of one unit of the unknown, SI; NaN where the unknown is the logarithm of the value."""
    rest: float
    """Value of the element where it is not in the structure."""
    low: float
    high: float
    """Bounds of the value."""
    prior: float = np.inf
    """Standard deviation, in units of the unknown, of the weak prior about `rest`."""
    reach: float = REACH
    """Largest change of the unknown in one step of a fit."""

    @property
    def logarithmic(self) -> bool:
        """True if the unknown is the logarithm of the value."""
        return bool(np.isnan(self.scale))

    def value(self, unknown: float) -> float:
        """Return the value, SI, of an unknown."""
        return float(np.exp(unknown)) if self.logarithmic else unknown * self.scale

    def unknown(self, value: float) -> float:
        """Return the unknown of a value, SI."""
        return float(np.log(value)) if self.logarithmic else value / self.scale


_INF = np.inf
_LOG = np.nan
_KINDS = (
    # name, unit, scale, rest, low, high, prior, reach
    ("F_c", "N", 50.0, 0.0, -100.0, 1000.0, _INF),
    ("d_c", "m", _LOG, 0.5e-3, 0.05e-3, 5e-3, 1.0),
    ("r_c", "1", 1.0, 0.0, -0.5, 2.0, 0.5),
    ("v_c", "m/s", _LOG, 0.01, 1e-3, 0.1, 0.7),
    ("dF_c", "N", 50.0, 0.0, -300.0, 300.0, _INF),
    ("s_c", "1", 1.0, 0.0, -0.9, 0.9, _INF),
    ("k_2", "N/m2", 1e5, 0.0, -1e6, 1e6, _INF),
    ("k_3", "N/m3", 1e6, 0.0, -1e8, 1e8, _INF),
    ("k_b", "N/m", 1e5, 0.0, -1e6, 1e6, _INF),
    ("g_b", "m", _LOG, 25e-3, 5e-3, 100e-3, 0.7, 0.05),
    ("s_m", "m/N", 1e-6, 0.0, 0.0, 2e-5, _INF),
    ("dk_s", "1", 0.1, 0.0, -0.5, 0.5, _INF),
    ("dk_t", "1", 0.1, 0.0, -0.5, 0.5, _INF),
    ("dm_u", "1", 0.1, 0.0, -0.5, 0.5, _INF),
    ("b_t", "1/m", 10.0, 0.0, -50.0, 50.0, _INF),
)


@cache
def elements(knots: tuple[float, ...]) -> tuple[Element, ...]:
    """Return the unknowns of all elements of both axles, for damper knees at `knots`, m/s."""
    named = [Element(f"{kind[0]}{axle}", *kind[1:]) for kind in _KINDS for axle in "fr"]
    slopes = [
        Element(f"h_{axle}{j + 1}", "N s/m", 1000.0, 0.0, -2e4, 2e4)
        for axle in "fr"
        for j in range(len(knots))
    ]
    return (*named, *slopes)
