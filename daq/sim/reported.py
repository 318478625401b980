"""Returns the values that an identification of a simulated car should report, by its names."""

from __future__ import annotations

from dataclasses import asdict

from ..vehicle import PARAMETER_NAMES
from .car import SimulatedCar
from .dampers import secant_ns_m
from .imperfections import means


def true_parameters(car: SimulatedCar) -> dict[str, float]:
    """Return the true parameters; for an axle with unequal corners, the mean of both.

    The 15 first; c_s is the secant of the damper's curve between minus and plus 0.1 m/s.  Then
    `k_af k_ar` anti-roll bars, `c_tf c_tr` tyre damping, `y_s` the CG off the middle, `F_cf F_cr`
    sliding friction of a corner.
    """
    p, i = car.parameters, car.imperfections
    truth = asdict(p)
    both = 0.5 * (i.compression + i.rebound)
    curves = (i.damper_front, i.damper_rear)
    straight = (both * p.c_sf, both * p.c_sr)
    secants = [
        line if c is None else secant_ns_m(c) for c, line in zip(curves, straight, strict=True)
    ]
    truth["c_sf"], truth["c_sr"] = secants
    for kind, factors in (
        ("m_u", i.wheel),
        ("k_s", i.suspension),
        ("k_t", i.tyre),
        ("c_s", i.damper),
    ):
        for axle, mean in zip("fr", means(factors), strict=True):
            truth[f"{kind}{axle}"] *= mean
    rubbing = means(i.friction.sides)
    return truth | {
        "k_af": i.bar_front_n_m,
        "k_ar": i.bar_rear_n_m,
        "c_tf": i.tyre_damping_front_ns_m,
        "c_tr": i.tyre_damping_rear_ns_m,
        "y_s": i.cg_offset_m,
        "F_cf": i.friction.front_n * rubbing[0],
        "F_cr": i.friction.rear_n * rubbing[1],
    }


def present_parameters(car: SimulatedCar) -> dict[str, float]:
    """Return the true parameters, without those beyond the 15 that the car does not have."""
    truth = true_parameters(car)
    return {name: truth[name] for name in truth if name in PARAMETER_NAMES or truth[name] != 0.0}
