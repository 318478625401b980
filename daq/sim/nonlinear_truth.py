"""Lists the nonlinear elements of a simulated car, by the names used in the identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np

from .car import SimulatedCar
from .dampers import Array, DamperCurve, Straight, damper_law
from .imperfections import PerAxle, PerCorner

_SPEEDS_M_S = np.linspace(-1.0, 1.0, 401)


@dataclass(frozen=True, slots=True)
class TrueElements:
    """Elements of a car in addition to its linear parameters, with their true values."""

    groups: tuple[str, ...]
    """Names as in `[vehicle.structure]`; empty for a linear car."""
    values: Mapping[str, float]
    """Values, SI, with the axle at the end of the name: `F_cf` is the friction of a front
    corner."""
    curves: tuple[tuple[Array, Array], tuple[Array, Array]]
    """Speeds, m/s, compression positive, and forces, N, of a front and of a rear damper."""


def true_elements(car: SimulatedCar) -> TrueElements:
    """Return the nonlinear elements of a simulated car."""
    p, i = car.parameters, car.imperfections
    dampers = [
        Straight(i.compression * c_s, i.rebound * c_s) if curve is None else curve
        for curve, c_s in ((i.damper_front, p.c_sf), (i.damper_rear, p.c_sr))
    ]
    friction: PerAxle = (i.friction.front_n, i.friction.rear_n)
    slack_f, slack_r = (1.0 / k if isfinite(k) else 0.0 for k in i.mount_n_m)
    split = _half_differences(i.friction.sides)
    sized: dict[str, dict[str, PerAxle]] = {
        "friction": {"F_c": friction},
        "static_friction": {"r_c": (i.friction.static_ratio - 1.0,) * 2},
        "damper_mounts": {"s_m": (slack_f, slack_r)},
        "progressive_springs": {"k_2": i.quadratic_n_m2, "k_3": i.cubic_n_m3},
        "bump_stops": {"k_b": i.stop_n_m},
        "progressive_tyres": {"b_t": i.tyre_progression_per_m},
        "friction_left_right": {"dF_c": (friction[0] * split[0], friction[1] * split[1])},
        "dampers_left_right": {"s_c": _shares(i.damper)},
    }
    linear: dict[str, PerAxle] = {
        "anti_roll_bars": (i.bar_front_n_m, i.bar_rear_n_m),
        "tyre_damping": (i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
        "cg_offset": (i.cg_offset_m, 0.0),
    }
    groups = [name for name, both in linear.items() if any(both)]
    groups += [name for name, kinds in sized.items() if any(any(v) for v in kinds.values())]
    if not all(damper_law([d], [1.0]).straight for d in dampers):
        groups += ["one_sided_dampers", "damper_knees"]
    values = {"d_cf": i.friction.presliding_m, "d_cr": i.friction.presliding_m}
    values |= {"v_cf": i.friction.stribeck_m_s, "v_cr": i.friction.stribeck_m_s}
    for kinds in sized.values():
        for kind, both in kinds.items():
            values |= {f"{kind}{axle}": v for axle, v in zip("fr", both, strict=True)}
    gaps = zip("fr", i.stop_gap_m, strict=True)
    values |= {f"g_b{axle}": gap for axle, gap in gaps if isfinite(gap)}
    return TrueElements(tuple(groups), values, (_curve(dampers[0]), _curve(dampers[1])))


def _curve(damper: DamperCurve) -> tuple[Array, Array]:
    return _SPEEDS_M_S, damper_law([damper], [1.0]).force(_SPEEDS_M_S[None])[0]


def _half_differences(factors: PerCorner) -> PerAxle:
    """Return half of left minus right, front and rear."""
    return 0.5 * (factors[0] - factors[1]), 0.5 * (factors[2] - factors[3])


def _shares(factors: PerCorner) -> PerAxle:
    """Return half of left minus right relative to the mean, front and rear."""
    front, rear = _half_differences(factors)
    return front / (0.5 * (factors[0] + factors[1])), rear / (0.5 * (factors[2] + factors[3]))
