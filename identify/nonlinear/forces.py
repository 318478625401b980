"""Forces in the suspension from a fit: damper curves, friction, stops, mounts."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from daq.vehicle import parameter_unit
from dbc.frames import freeze_arrays

from ..fit.grey_box import SIGNED
from ..fit.uncertainty import COVERAGE_95, Estimate
from ..model.matrices import Real
from .car import F_C, FALL, GAP, KINDS, KNEE_M_S, KNEES, SURPLUS, C, Car
from .laws import knee, sliding_share, sliding_slopes

if TYPE_CHECKING:
    from .fit import Optimum

AXLES = ("front", "rear")
AS_PARAMETERS = frozenset({"anti_roll_bars", "cg_offset", "tyre_damping"})
"""Groups of elements that are also parameters of the linear model."""


def element_in_words(name: str) -> str:
    """Return the name of an element, not of a knee, in words: `front friction` for `F_cf`."""
    label = next(label for label, kind in KINDS.items() if kind == name[:-1])
    words = "mount compliance" if label == "mount" else label.replace("_", " ")
    return f"{AXLES[name[-1] == 'r']} {words}"


@dataclass(frozen=True, slots=True)
class DamperCurve:
    """Force of one damper over the speeds that occurred."""

    speed_m_s: Real
    """(n,), compression positive."""
    force_n: Real
    """(n,) force of the damper alone."""
    std_n: Real
    """(n,) standard deviation of `force_n`."""
    total_n: Real
    """(n,) force of damper and friction together: right whatever the law of the friction is."""
    total_std_n: Real
    """(n,) standard deviation of `total_n`."""

    def __post_init__(self) -> None:
        freeze_arrays(self, *self.__dataclass_fields__)

    @property
    def band_n(self) -> tuple[Real, Real]:
        """Lower and upper end of the 95 % band of `force_n`, (n,) each."""
        half = COVERAGE_95 * self.std_n
        return self.force_n - half, self.force_n + half

    @property
    def total_band_n(self) -> tuple[Real, Real]:
        """Lower and upper end of the 95 % band of `total_n`, (n,) each."""
        half = COVERAGE_95 * self.total_std_n
        return self.total_n - half, self.total_n + half


@dataclass(frozen=True, slots=True)
class AxleForces:
    """The elements of one axle, each for one corner."""

    axle: str
    """front or rear."""
    damper: DamperCurve
    values: dict[str, Estimate]
    """Elements that are in the structure, by name: `friction` [N], `pre_sliding_length` [m],
    `static_surplus` (share by which it is larger at rest), `stribeck_speed` [m/s],
    `bump_stop` [N/m] (force over compression at 10 mm of it), `bump_stop_gap` [m],
    `bump_stop_power` (of the compression), `mount` [N/m], `progressive` [N/m2], `cubic` [N/m3],
    `tyre_progressive` [1/m], `friction_left_right` [N] and `dampers_left_right` (half the
    difference left less right, the latter as a share), as are `springs_left_right`,
    `tyres_left_right` and `wheels_left_right`."""
    notes: tuple[str, ...]
    """Remarks on what is not determined: a mount that is rigid, a stop that was not reached."""


@dataclass(frozen=True, slots=True)
class ElementChoice:
    """One group of elements that was tried."""

    name: str
    """As in `[vehicle.structure]`."""
    gain: float
    """Fall of the cost with the group, in units of chi2/n."""
    threshold: float
    """Gain above which the group counts as present (Bayesian information criterion)."""
    kept: bool
    """True if the data, or `[vehicle.structure]`, keep it."""
    forced: bool
    """True if `[vehicle.structure]` decides it."""
    values: dict[str, Estimate]
    """Estimates of its unknowns."""


@dataclass(frozen=True, slots=True)
class Forces:
    """Forces of both axles, and the elements that were tried."""

    axles: tuple[AxleForces, ...]
    """Front and rear."""
    choices: tuple[ElementChoice, ...]
    """In the order in which they were released."""
    law: str = "dry friction that sticks and slides, damper curve of straight segments"


def element_estimates(best: Optimum, covariance: Real) -> dict[str, Estimate]:
    """Return each free element and parameter of the car with its interval; `covariance`: (F, F)."""
    problem = best.point.problem
    model, linear_eta = problem.model, best.eta[: problem.model.n_linear]
    box = model.box
    elements = {element.name: element for element in model.elements}
    slopes = dict(zip(box.parameters, box.parameter_slopes(linear_eta).tolist(), strict=True))
    parameters = dict(zip(box.names, box.values(linear_eta).tolist(), strict=True))
    result = {}
    for i, variance in zip(problem.free.tolist(), np.diag(covariance).tolist(), strict=True):
        name = model.names[i]
        if name in elements:
            element = elements[name]
            value, unit = element.value(float(best.eta[i])), element.unit
            size = 0.0 if element.logarithmic else element.scale
            slope = abs(value) if element.logarithmic else element.scale
        elif name in parameters:
            value, slope, size = parameters[name], slopes[name], SIGNED.get(name, 0.0)
            unit = parameter_unit(name)
        else:
            continue
        result[name] = Estimate.of(value, slope * float(np.sqrt(variance)), unit, size)
    return result


def axle_forces(
    best: Optimum, covariance: Real, values: dict[str, Estimate], axle: str
) -> AxleForces:
    """Return the forces of one axle at an optimum.

    `covariance`, (F, F): of the free unknowns.  `values`: those of `element_estimates`.  `axle`:
    front or rear.
    """
    left = 0 if axle == "front" else 2  # the axle's left corner
    corners = slice(left, left + 2)
    first_car, speeds, reached_m = best.point.cars[0], [], -inf
    for car, predicted in zip(best.point.cars, best.point.predicted, strict=True):
        states = predicted.path.states
        reached_m = max(reached_m, float(car.travels(states)[:, corners].max()))
        of_dampers = predicted.path.speeds if car.has_mount else car.travel_speeds(states)
        speeds.append(of_dampers[:, corners].ravel())
    low, high = np.quantile(np.concatenate(speeds), [0.01, 0.99])  # few samples are beyond
    grid_m_s = np.union1d(np.linspace(min(low, 0.0), max(high, 0.0), 61), [0.0])
    by_label = {label: values.get(f"{kind}{axle[0]}") for label, kind in KINDS.items()}
    mount = by_label.pop("mount")  # its compliance; what is reported is its stiffness
    reported = {label: estimate for label, estimate in by_label.items() if estimate is not None}
    notes = []
    if "bump_stop" in reported and reached_m < first_car.corner[left, GAP]:
        notes.append(
            f"bump stop not reached: the travel went to {1e3 * reached_m:.0f} mm in compression"
        )
        reported = {label: e for label, e in reported.items() if not label.startswith("bump_stop")}
    if mount is not None and mount.value < 2.0 * mount.std:
        notes.append(f"damper mount rigid: at least {1.0 / max(mount.high, 1e-12):.1e} N/m")
    elif mount is not None:
        stiffness = 1.0 / mount.value
        # The interval is the inverse of that of the compliance, so it is not symmetric.
        softest, hardest = 1.0 / mount.high, 1.0 / mount.low if mount.low > 0.0 else inf
        of_mount = Estimate(stiffness, mount.std * stiffness**2, softest, hardest, "N/m")
        reported["mount"] = of_mount
        if not of_mount.determined:
            notes.append(f"damper mount: at least {softest:.1e} N/m")
    curve = _curve(first_car, left, grid_m_s, covariance)
    return AxleForces(axle, curve, reported, tuple(notes))


def _curve(car: Car, left_corner: int, speed: Real, covariance: Real) -> DamperCurve:
    """Return the curve of an axle's dampers at some speeds, (n,) m/s, compression positive.

    The damper is that of the left corner, its friction the mean of both.  `covariance`: (F, F).
    """
    # Coefficients of the left corner, (n_coefficients,), and their slopes by the unknowns, (.., F).
    p, d = car.corner[left_corner], car.d_corner[left_corner]
    force, d_force = p[C] * speed, speed[:, None] * d[C]  # (n,), (n, F)
    for j, knot in enumerate(car.knots):
        beyond_knot = knee(speed, knot, KNEE_M_S)
        force = force + p[KNEES + j] * beyond_knot
        d_force = d_force + beyond_knot[:, None] * d[KNEES + j]
    of_axle = slice(left_corner, left_corner + 2)
    friction, d_friction = car.corner[of_axle, F_C].mean(), car.d_corner[of_axle, F_C].mean(axis=0)
    # The steady force of the friction over F_c, with its sign, and its slopes.
    sliding = np.sign(speed) * sliding_share(speed, p[SURPLUS], p[FALL])
    _, by_surplus, by_fall = np.sign(speed) * sliding_slopes(speed, p[SURPLUS], p[FALL])
    d_sliding = by_surplus[:, None] * d[SURPLUS] + by_fall[:, None] * d[FALL]
    d_total = d_force + sliding[:, None] * d_friction + friction * d_sliding
    std, total_std = (
        np.sqrt(np.maximum(np.einsum("nf,fg,ng->n", slopes, covariance, slopes), 0.0))
        for slopes in (d_force, d_total)
    )
    return DamperCurve(speed, force, std, force + sliding * friction, total_std)


# Reduces a damper curve to a few numbers: its force at standard speeds ----------------------------

STANDARD_SPEEDS_M_S = (-0.4, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.4)
"""Speeds of the wheel relative to the body at which tables of dampers state forces, compression
positive, m/s."""


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
    """Return a damper's force, without and with friction, at each standard speed it reached."""

    def force_at(speed_m_s: float, forces_n: Real, stds_n: Real) -> Estimate:
        force_n, std_n = (
            float(np.interp(speed_m_s, curve.speed_m_s, values)) for values in (forces_n, stds_n)
        )
        # A damper may have nearly no force at a low speed: 50 N are the smallest that matter.
        return Estimate.of(force_n, std_n, "N", 50.0)

    return tuple(
        SpeedForce(
            speed_m_s,
            force_at(speed_m_s, curve.force_n, curve.std_n),
            force_at(speed_m_s, curve.total_n, curve.total_std_n),
        )
        for speed_m_s in STANDARD_SPEEDS_M_S
        if curve.speed_m_s[0] <= speed_m_s <= curve.speed_m_s[-1]
    )


def force_quantities(forces: Forces) -> dict[str, Estimate]:
    """Return every element, and the force at each standard speed, by axle and name.

    Names are `front friction`, `rear damper +0.10 m/s`, and `rear corner +0.10 m/s` for damper and
    friction together.
    """
    quantities: dict[str, Estimate] = {}
    for axle in forces.axles:
        for name, estimate in axle.values.items():
            quantities[f"{axle.axle} {name.replace('_', ' ')}"] = estimate
        for of_speed in forces_at_speeds(axle.damper):
            quantities[f"{axle.axle} damper {of_speed.speed_m_s:+.2f} m/s"] = of_speed.damper
            quantities[f"{axle.axle} corner {of_speed.speed_m_s:+.2f} m/s"] = of_speed.total
    return quantities
