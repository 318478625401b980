"""Reduces a damper curve to a few numbers: its force at standard speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..fit.uncertainty import COVERAGE_95, Estimate
from .forces import DamperCurve, Forces

STANDARD_SPEEDS_M_S = (-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4)
"""Speeds of the wheel relative to the body at which tables of dampers state forces, compression
positive, m/s."""
_SIZE_N = 50.0
"""Smallest force that matters, N: a damper may have nearly none at a low speed."""


@dataclass(frozen=True, slots=True)
class SpeedForce:
    """Force of one corner at one speed."""

    speed_m_s: float
    """Speed, compression positive, m/s."""
    damper: Estimate
    """Force of the damper alone, N."""
    total: Estimate
    """Force with friction, N: right whatever the law of the friction is."""


def forces_at_speeds(curve: DamperCurve) -> tuple[SpeedForce, ...]:
    """Return the force at each standard speed that occurred."""
    speed = curve.speed_m_s
    return tuple(
        SpeedForce(
            v,
            _at(v, speed, curve.force_n, curve.std_n),
            _at(v, speed, curve.total_n, curve.total_std_n),
        )
        for v in STANDARD_SPEEDS_M_S
        if speed[0] <= v <= speed[-1]
    )


def force_quantities(forces: Forces) -> dict[str, Estimate]:
    """Return every element, and the force at each standard speed, by axle and name.

    Names are `front friction`, `rear damper +0.10 m/s`, and `rear corner +0.10 m/s` for damper and
    friction together.
    """
    found: dict[str, Estimate] = {}
    for one in forces.axles:
        for name, e in one.values.items():
            found[f"{one.axle} {name.replace('_', ' ')}"] = e
        for at in forces_at_speeds(one.damper):
            found[f"{one.axle} damper {at.speed_m_s:+.2f} m/s"] = at.damper
            found[f"{one.axle} corner {at.speed_m_s:+.2f} m/s"] = at.total
    return found


def _at(
    v: float, speed: NDArray[np.float64], force: NDArray[np.float64], std: NDArray[np.float64]
) -> Estimate:
    value, sigma = float(np.interp(v, speed, force)), float(np.interp(v, speed, std))
    half = COVERAGE_95 * sigma
    return Estimate(value, sigma, value - half, value + half, "N", _SIZE_N)
