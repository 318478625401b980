"""One mass state of a car for the integrator: coefficients of its corners and its body.

All that a corner's forces depend on is a row of numbers (`COLUMNS`), so that the integrator needs
to know neither axles nor structures nor which of the numbers are unknown; their derivatives by the
unknowns come by a complex step through the grey box.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import Corner, MassState

from ..elements.damper import secant_share
from ..fit.grey_box import GreyBox
from ..model.complex_step import COMPLEX_STEP, stepped
from ..model.facts import corner_load, misfits_of
from ..model.matrices import delta_mass
from .unknowns import Element, elements

GRAVITY_M_S2 = 9.80665
KNEE_M_S = 0.0005
"""Rounding of the damper's knees on the path, m/s: invisible in the data, wide enough for the
step."""

(
    X, Y, K_S, K_2, K_3, K_B, GAP, K_A, F_C, LENGTH, SURPLUS, FALL, RATIO, C, MOUNT, K_T, BETA, C_T,
    STATIC, MASS, PULL, KNEES,
) = range(22)  # fmt: skip
"""Columns of the coefficients of a corner; the slopes at the knees begin at `KNEES`.

X, Y: place from the CG, m.  SURPLUS: of static over sliding friction, FALL: the speed over which it
falls off, m/s.  RATIO: this corner's damper over the axle's.  STATIC: load of the bare car, N.
MASS: of the wheel with its load, kg.  PULL: weight added to the wheel, N."""


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
    def first(self) -> int:
        """Position of the first unknown of the elements."""
        return len(self.box.prior_sigma)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every unknown."""
        known = (*self.box.parameters, *self.box.corrections)
        cross = ("cross weight",) * (self.first - len(known))
        return (*known, *cross, *(e.name for e in self.elements))

    def unknowns(self, linear: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return all unknowns, (P,), from those of the grey box, with elements at rest."""
        rest = [e.unknown(e.rest) for e in self.elements]
        return np.concatenate([linear, rest])

    def element_values(self, eta: NDArray[np.complex128]) -> dict[str, NDArray[np.complex128]]:
        """Return the value of each element, SI, at `eta`, (..., P)."""
        result = {}
        for i, e in enumerate(self.elements, start=self.first):
            x = eta[..., i]
            result[e.name] = np.exp(x) if e.logarithmic else e.scale * x
        return result

    def full(self, eta: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the full parameters, (..., 28), with the differences of each corner."""
        value = self.element_values(eta)
        full = self.box.full(eta).copy()
        for place in Corner:
            axle = "f" if place.front else "r"
            for first, kind in ((3, "dm_u"), (7, "dk_s"), (11, "dk_t")):
                full[..., first + place.position] *= 1.0 + place.side * value[f"{kind}{axle}"]
        return full

    def fact_misfits(
        self, eta: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return measured less predicted value of each fact in sigmas, and the latter's slopes.

        The differences of the corners are included: a wheel that is heavier than the other shows on
        the scales.
        """
        points = stepped(eta)
        return misfits_of(self.box.facts, self.full(points), self.box.cross_kg(points))


@dataclass(frozen=True, slots=True)
class Car:
    """A mass state at one point of the unknowns, with its derivatives by the free ones."""

    corner: NDArray[np.float64]
    """(4, n) coefficients of the corners."""
    d_corner: NDArray[np.float64]
    """(4, n, F)."""
    mass: NDArray[np.float64]
    """(3, 3) of the body with its load, kg and kg m2."""
    d_mass: NDArray[np.float64]
    """(F, 3, 3)."""
    pull: NDArray[np.float64]
    """(3,) force of the weights that are added to the body."""
    d_pull: NDArray[np.float64]
    """(F, 3)."""
    knots: tuple[float, ...]

    @property
    def has_mount(self) -> bool:
        """True if a damper has a compliant mount, or may have one."""
        return bool(self.corner[:, MOUNT].any() or self.d_corner[:, MOUNT].any())


def car(model: Model, eta: NDArray[np.float64], state: MassState, free: NDArray[np.intp]) -> Car:
    """Return a mass state at `eta`, (P,), and its derivatives by the unknowns at `free`, (F,)."""
    points = stepped(eta)[np.concatenate([[0], 1 + free])]
    corner, mass, pull = _coefficients(model, points, state)
    slope = 1.0 / COMPLEX_STEP
    return Car(
        np.ascontiguousarray(corner[0].real),
        np.ascontiguousarray(np.moveaxis(corner[1:].imag, 0, -1) * slope),
        np.ascontiguousarray(mass[0].real),
        np.ascontiguousarray(mass[1:].imag * slope),
        np.ascontiguousarray(pull[0].real),
        np.ascontiguousarray(pull[1:].imag * slope),
        model.knots,
    )


def _coefficients(
    model: Model, eta: NDArray[np.complex128], state: MassState
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128]]:
    """Return corners, (n, 4, columns), body mass, (n, 3, 3), and gravity, (n, 3)."""
    box = model.box
    full = model.full(eta)
    value = model.element_values(eta)
    added = delta_mass(state.added, full[:, 19], full[:, 27], box.off_weights(eta, state))
    pull = -GRAVITY_M_S2 * (added[:, :, 0] + added[:, :, 3:].sum(axis=-1))
    corner = np.zeros((len(eta), 4, KNEES + len(model.knots)), dtype=complex)
    cross = box.cross_kg(eta)
    for place in Corner:
        i, axle = place.position, "f" if place.front else "r"
        one = corner[:, i]
        one[:, X] = full[:, 19] if place.front else -full[:, 20]
        one[:, Y] = place.side * full[:, 21 if place.front else 22] - full[:, 27]
        one[:, K_S] = full[:, 7 + i]
        one[:, K_2] = value[f"k_2{axle}"]
        one[:, K_3] = value[f"k_3{axle}"]
        one[:, K_B] = value[f"k_b{axle}"]
        one[:, GAP] = value[f"g_b{axle}"]
        one[:, K_A] = full[:, 23 if place.front else 24]
        one[:, F_C] = value[f"F_c{axle}"] + place.side * value[f"dF_c{axle}"]
        one[:, LENGTH] = value[f"d_c{axle}"]
        one[:, SURPLUS] = value[f"r_c{axle}"]
        one[:, FALL] = value[f"v_c{axle}"]
        one[:, RATIO] = 1.0 + place.side * value[f"s_c{axle}"]
        one[:, C] = full[:, 15 + i]
        one[:, MOUNT] = value[f"s_m{axle}"]
        one[:, K_T] = full[:, 11 + i]
        one[:, BETA] = value[f"b_t{axle}"]
        one[:, C_T] = full[:, 25 if place.front else 26]
        one[:, STATIC] = GRAVITY_M_S2 * corner_load(place, full, cross)
        one[:, MASS] = full[:, 3 + i] + added[:, 3 + i, 3 + i]
        one[:, PULL] = pull[:, 3 + i]
        for j, knot in enumerate(model.knots):
            h = value[f"h_{axle}{j + 1}"]
            one[:, KNEES + j] = h
            one[:, C] -= h * secant_share(knot, KNEE_M_S)
    mass = added[:, :3, :3].copy()
    for k in range(3):
        mass[:, k, k] += full[:, k]
    return corner, mass, pull[:, :3]
