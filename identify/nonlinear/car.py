"""One mass state of a car for the integration: coefficients of its corners and its body.

All that a corner's forces depend on is a row of coefficients (columns `X` to `KNEES`), so that the
path needs to know neither axles nor structures nor which of the numbers are unknown; their
derivatives by the unknowns come by a complex step through the grey box.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import Corner, MassState

from ..fit.grey_box import GreyBox
from ..model.matrices import (
    COMPLEX_STEP,
    Complex,
    Full,
    Real,
    corner_load,
    delta_mass,
    misfits_of,
    stepped,
)
from .laws import secant_share

# The unknowns of the nonlinear elements, in addition to those of the grey box ---------------------

_KNEES_M_S = {
    "K3": (0.15,),
    "K21": (0.015, 0.03, 0.045, 0.065, 0.085, 0.11, 0.15, 0.21, 0.3, 0.45),
    "K37": (0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.095, 0.11, 0.13, 0.155, 0.19, 0.23,
            0.3, 0.4, 0.55, 0.75),
}  # fmt: skip
KNOTS = {k: (*(-v for v in reversed(speeds)), 0.0, *speeds) for k, speeds in _KNEES_M_S.items()}
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
    absent: float
    """Value of the element where it is not in the structure."""
    low: float
    high: float
    """Bounds of the value."""
    prior: float = np.inf
    """Standard deviation, in units of the unknown, of the weak prior about `absent`."""
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


_LOG = np.nan
_ROWS: tuple[tuple[Any, ...], ...] = (
    # kind, reported name, and the fields of `Element` from `unit` on
    ("F_c", "friction", "N", 50.0, 0.0, -100.0, 1000.0),
    ("d_c", "pre_sliding_length", "m", _LOG, 0.5e-3, 0.01e-3, 5e-3, 1.0),
    ("r_c", "static_surplus", "1", 1.0, 0.0, -0.5, 2.0, 0.5),
    ("v_c", "stribeck_speed", "m/s", _LOG, 0.01, 1e-3, 0.1, 0.7),
    ("dF_c", "friction_left_right", "N", 50.0, 0.0, -300.0, 300.0),
    ("s_c", "dampers_left_right", "1", 1.0, 0.0, -0.9, 0.9),
    ("k_2", "progressive", "N/m2", 1e5, 0.0, -1e6, 1e6),
    ("k_3", "cubic", "N/m3", 1e6, 0.0, -1e8, 1e8),
    ("k_b", "bump_stop", "N/m", 1e5, 0.0, -1e6, 1e6),
    ("g_b", "bump_stop_gap", "m", _LOG, 25e-3, 5e-3, 100e-3, 0.7, 0.05),
    ("p_b", "bump_stop_power", "1", _LOG, 2.0, 1.0, 4.0, 0.5, 0.2),
    ("s_m", "mount", "m/N", 1e-6, 0.0, 0.0, 2e-5),
    ("dk_s", "springs_left_right", "1", 0.1, 0.0, -0.5, 0.5),
    ("dk_t", "tyres_left_right", "1", 0.1, 0.0, -0.5, 0.5),
    ("dm_u", "wheels_left_right", "1", 0.1, 0.0, -0.5, 0.5),
    ("b_t", "tyre_progressive", "1/m", 10.0, 0.0, -50.0, 50.0),
)
KINDS = {label: kind for kind, label, *_ in _ROWS}
"""Unknown, without its axle, by its reported name."""


@cache
def elements(knots: tuple[float, ...]) -> tuple[Element, ...]:
    """Return the unknowns of all elements of both axles, for damper knees at `knots`, m/s."""
    of_kinds = [Element(f"{kind}{axle}", *row) for kind, _, *row in _ROWS for axle in "fr"]
    slopes = [
        Element(f"h_{axle}{j + 1}", "N s/m", 1000.0, 0.0, -2e4, 2e4)
        for axle in "fr"
        for j in range(len(knots))
    ]
    return (*of_kinds, *slopes)


# The car ------------------------------------------------------------------------------------------

GRAVITY_M_S2 = 9.80665
KNEE_M_S = 0.0005
"""Rounding of the damper's knees on the path, m/s: invisible in the data, wide enough for the
step."""

(
    X, Y, K_S, K_2, K_3, K_B, GAP, POWER, K_A, F_C, LENGTH, SURPLUS, FALL, RATIO, C, MOUNT, K_T,
    BETA, C_T, STATIC, MASS, GRAVITY, KNEES,
) = range(23)  # fmt: skip
"""Columns of the coefficients of a corner; the slopes at the knees begin at `KNEES`.

X, Y: place from the CG, m.  SURPLUS: of static over sliding friction, FALL: the speed over which it
falls off, m/s.  RATIO: this corner's damper over the axle's.  STATIC: load of the bare car, N.
MASS: of the wheel with its load, kg.  GRAVITY: on what is added to the wheel, N."""
OF_FRICTION, OF_WHEEL = (LENGTH, SURPLUS, FALL), (K_T, BETA, C_T, STATIC, MASS, GRAVITY)
"""Columns that act on the rate of friction alone, and on the wheel beside the corner's force."""
_COLUMN_OF = {
    K_2: "k_2", K_3: "k_3", K_B: "k_b", GAP: "g_b", POWER: "p_b", F_C: "F_c", LENGTH: "d_c",
    SURPLUS: "r_c", FALL: "v_c", MOUNT: "s_m", BETA: "b_t",
}  # fmt: skip
"""Columns that are an element's value."""


@dataclass(frozen=True, slots=True)
class Model:
    """The unknowns, and how a car is made from them."""

    box: GreyBox
    """Linear part: parameters, places, lateness, weights, facts."""
    knots: tuple[float, ...]
    """Speeds of the dampers' knees, m/s."""

    @property
    def elements(self) -> tuple[Element, ...]:
        """The unknowns of the nonlinear elements; they follow those of the grey box."""
        return elements(self.knots)

    @property
    def n_linear(self) -> int:
        """Number of unknowns of the grey box, which come before those of the elements."""
        return len(self.box.prior_sigma)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every unknown."""
        known = (*self.box.parameters, *self.box.corrections)
        cross = ("cross weight",) * (self.n_linear - len(known))
        return (*known, *cross, *(e.name for e in self.elements))

    def unknowns(self, linear: Real) -> Real:
        """Return all unknowns, (P,), from those of the grey box, with elements that are absent."""
        return np.concatenate([linear, [e.unknown(e.absent) for e in self.elements]])

    def element_values(self, eta: Complex) -> dict[str, Complex]:
        """Return the value of each element, SI, at `eta`, (..., P)."""
        result = {}
        for i, e in enumerate(self.elements, start=self.n_linear):
            unknown = eta[..., i]
            result[e.name] = np.exp(unknown) if e.logarithmic else e.scale * unknown
        return result

    def full(self, eta: Complex) -> Complex:
        """Return the full parameters, (..., 28), with the differences of each corner."""
        element = self.element_values(eta)
        full = self.box.full(eta).copy()
        for corner in Corner:
            axle = "f" if corner.front else "r"
            for front_left, kind in ((Full.M_U, "dm_u"), (Full.K_S, "dk_s"), (Full.K_T, "dk_t")):
                full[..., front_left + corner.position] *= (
                    1.0 + corner.side * element[f"{kind}{axle}"]
                )
        return full

    def fact_misfits(self, eta: Real) -> tuple[Real, Real]:
        """Return measured less predicted value of each fact in sigmas, and the latter's slopes.

        The differences of the corners are included: a wheel that is heavier than the other shows on
        the scales.
        """
        points = stepped(eta)
        return misfits_of(self.box.facts, self.full(points), self.box.cross_kg(points))


@dataclass(frozen=True, slots=True)
class Car:
    """A mass state at one point of the unknowns, with its derivatives by the free ones."""

    corner: Real
    """(4, n) coefficients of the corners."""
    d_corner: Real
    """(4, n, F) their derivatives."""
    mass: Real
    """(3, 3) of the body with its load, kg and kg m2."""
    d_mass: Real
    """(F, 3, 3)."""
    gravity: Real
    """(3,) force and moments, N and N m, on the weights that are added to the body."""
    d_gravity: Real
    """(F, 3)."""
    knots: tuple[float, ...]

    @property
    def has_mount(self) -> bool:
        """True if a damper has a compliant mount, or may have one."""
        return bool(self.corner[:, MOUNT].any() or self.d_corner[:, MOUNT].any())

    def travels(self, states: Real) -> Real:
        """Return the travels of the four suspensions, (..., 4) m, compression positive.

        `states`, (..., 7 or more): seven displacements, then perhaps their speeds and all else.
        """
        heave, pitch, roll = states[..., 0:1], states[..., 1:2], states[..., 2:3]
        body = heave - pitch * self.corner[:, X] + roll * self.corner[:, Y]
        return np.asarray(states[..., 3:7] - body)

    def travel_speeds(self, states: Real) -> Real:
        """Return the speeds of the suspensions, (..., 4) m/s, from `states`, (..., 14 or more)."""
        return self.travels(states[..., 7:14])


def car(model: Model, eta: Real, state: MassState, free: NDArray[np.intp]) -> Car:
    """Return the car of a mass state at `eta`, (P,), its derivatives by the unknowns at `free`."""
    # `eta` itself, then with a complex step in each free unknown.
    points = stepped(eta)[np.concatenate([[0], 1 + free])]
    corner, mass, gravity = _coefficients(model, points, state)
    per_step = 1.0 / COMPLEX_STEP
    return Car(
        np.ascontiguousarray(corner[0].real),
        np.ascontiguousarray(np.moveaxis(corner[1:].imag, 0, -1) * per_step),
        np.ascontiguousarray(mass[0].real),
        np.ascontiguousarray(mass[1:].imag * per_step),
        np.ascontiguousarray(gravity[0].real),
        np.ascontiguousarray(gravity[1:].imag * per_step),
        model.knots,
    )


def _coefficients(model: Model, eta: Complex, state: MassState) -> tuple[Complex, Complex, Complex]:
    """Return corners, (n, 4, columns), body mass, (n, 3, 3), and gravity on its weights, (n, 3).

    `eta`: unknowns, (n, P).
    """
    box = model.box
    full = model.full(eta)
    element = model.element_values(eta)
    weight_errors = box.off_weights(eta, state)  # kg, m, m
    added = delta_mass(state.added, full[:, Full.A], full[:, Full.Y_S], weight_errors)
    # Gravity accelerates body and wheels downwards alike: on (1, 0, 0, 1, 1, 1, 1).
    gravity = -GRAVITY_M_S2 * (added[:, :, 0] + added[:, :, 3:].sum(axis=-1))
    corners = np.zeros((len(eta), 4, KNEES + len(model.knots)), dtype=complex)
    cross_kg = box.cross_kg(eta)
    for corner in Corner:
        i, front = corner.position, corner.front
        axle = "f" if front else "r"
        row = corners[:, i]  # (n, columns)
        for column, kind in _COLUMN_OF.items():
            row[:, column] = element[f"{kind}{axle}"]
        row[:, X] = full[:, Full.A] if front else -full[:, Full.B]
        half_width = full[:, Full.T_F if front else Full.T_R]
        row[:, Y] = corner.side * half_width - full[:, Full.Y_S]
        row[:, K_S], row[:, K_T] = full[:, Full.K_S + i], full[:, Full.K_T + i]
        row[:, C] = full[:, Full.C_S + i]
        row[:, K_A] = full[:, Full.K_AF if front else Full.K_AR]
        row[:, C_T] = full[:, Full.C_TF if front else Full.C_TR]
        row[:, F_C] += corner.side * element[f"dF_c{axle}"]
        row[:, RATIO] = 1.0 + corner.side * element[f"s_c{axle}"]
        row[:, STATIC] = GRAVITY_M_S2 * corner_load(corner, full, cross_kg)
        row[:, MASS] = full[:, Full.M_U + i] + added[:, 3 + i, 3 + i]
        row[:, GRAVITY] = gravity[:, 3 + i]
        for j, knot in enumerate(model.knots):
            slope_change = element[f"h_{axle}{j + 1}"]
            row[:, KNEES + j] = slope_change
            row[:, C] -= slope_change * secant_share(knot, KNEE_M_S)  # `c_s` is that of the secant
    mass = added[:, :3, :3].copy()
    for k in (Full.M_S, Full.I_YY, Full.I_XX):
        mass[:, k, k] += full[:, k]
    return corners, mass, gravity[:, :3]
