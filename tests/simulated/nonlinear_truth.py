"""Lists the nonlinear elements of a simulated car, by the names used in the identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

import numpy as np

from daq.sim.car import SimulatedCar
from daq.sim.elements import (
    Array,
    DamperCurve,
    Imperfections,
    PerAxle,
    half_differences,
    means,
)

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
    i = car.imperfections
    dampers = i.dampers(car.parameters)
    sized = nonlinear_sizes(i)
    linear: dict[str, PerAxle] = {
        "anti_roll_bars": (i.bar_front_n_m, i.bar_rear_n_m),
        "tyre_damping": (i.tyre_damping_front_ns_m, i.tyre_damping_rear_ns_m),
        "cg_offset": (i.cg_offset_m, 0.0),
    }
    groups = [name for name, both in linear.items() if any(both)]
    groups += [name for name, kinds in sized.items() if any(any(v) for v in kinds.values())]
    if not all(damper.is_linear for damper in dampers):
        groups += ["one_sided_dampers", "damper_knees"]
    values = {"d_cf": i.friction.presliding_m, "d_cr": i.friction.presliding_m}
    values |= {"v_cf": i.friction.stribeck_m_s, "v_cr": i.friction.stribeck_m_s}
    for kinds in sized.values():
        values |= with_axles(kinds)
    gaps = zip("fr", i.stop_gap_m, strict=True)
    values |= {f"g_b{axle}": gap for axle, gap in gaps if isfinite(gap)}
    return TrueElements(tuple(groups), values, (_curve(dampers[0]), _curve(dampers[1])))


def with_axles(kinds: Mapping[str, PerAxle]) -> dict[str, float]:
    """Return sizes by kind with the axle at the end of each name."""
    return {
        f"{kind}{axle}": size
        for kind, both in kinds.items()
        for axle, size in zip("fr", both, strict=True)
    }


def _curve(damper: DamperCurve) -> tuple[Array, Array]:
    return _SPEEDS_M_S, damper.force(_SPEEDS_M_S)


def nonlinear_sizes(i: Imperfections) -> dict[str, dict[str, PerAxle]]:
    """Return the sizes of all nonlinear elements except damper curves, SI, by element and kind.

    Kinds are the beginnings of the names under which an identification reports them, such as `F_c`.
    """
    friction: PerAxle = (i.friction.front_n, i.friction.rear_n)
    split = half_differences(i.friction.sides)
    split_c, mean_c = half_differences(i.damper), means(i.damper)
    return {
        "friction": {"F_c": friction},
        "static_friction": {"r_c": (i.friction.static_ratio - 1.0,) * 2},
        "damper_mounts": {"s_m": (1.0 / i.mount_n_m[0], 1.0 / i.mount_n_m[1])},
        "progressive_springs": {"k_2": i.quadratic_n_m2, "k_3": i.cubic_n_m3},
        "bump_stops": {"k_b": i.stop_n_m},
        "progressive_tyres": {"b_t": i.tyre_progression_per_m},
        "friction_left_right": {"dF_c": (friction[0] * split[0], friction[1] * split[1])},
        "dampers_left_right": {"s_c": (split_c[0] / mean_c[0], split_c[1] / mean_c[1])},
    }
