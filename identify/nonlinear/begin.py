"""Start of a nonlinear fit: a linear fit with bars, and the motion that it gives each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import MassState

from ..decays.decay import FreeDecay
from ..fit.grey_box import GreyBox
from ..fit.varpro import evaluate as linear_point
from ..fit.varpro import linear_part
from ..model.matrices import SYMMETRIC, full_matrices
from .car import PULL, Model, car
from .common_scale import scaled
from .path import InitialState, travel_speeds

_BEYOND = 2.0
"""Factor by which a car may be lighter or heavier than all generic vehicles, whose range is
wide."""
_MISSHAPEN = 4.0
"""Factor beyond all generic vehicles above which a parameter is impossible for a vehicle."""
_SLIDES_M_S = 0.02
"""Speed at which most of the friction acts in the direction of the motion."""


def scaled_to_vehicle(
    box: GreyBox, eta: NDArray[np.float64], vehicles: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return linear unknowns with all masses and forces scaled by one factor, or unchanged.

    Without scales their size rests on the effect of the weights, which friction hides: a linear fit
    of an suv had a mass of 22 t, with lengths and frequencies nearly right.  `eta`, (P,): of `box`.
    `vehicles`: generic ones, (15,) each, the usual one first.
    """
    masses = [float(vehicle[0]) for vehicle in vehicles]
    found = float(np.exp(eta[box.parameters.index("m_s")]))
    if min(masses) / _BEYOND <= found <= max(masses) * _BEYOND:
        return eta
    return scaled(box, eta, masses[0] / found)


def is_impossible(
    box: GreyBox, eta: NDArray[np.float64], vehicles: Sequence[NDArray[np.float64]]
) -> bool:
    """Return whether linear unknowns, (P,) of `box`, are impossible for a vehicle.

    With friction as large as the rear wheels' load, a linear fit of a city car put its CG 4 mm
    behind the front axle: no search from there found the optimum, one from the usual vehicle did.
    """
    usual = np.array([SYMMETRIC @ vehicle for vehicle in vehicles])
    common = usual.all(axis=0)  # bars, tyre damping and offsets may be zero
    found = box.full(eta.astype(complex)).real[common]
    least, most = usual[:, common].min(axis=0), usual[:, common].max(axis=0)
    return bool(((found < least / _MISSHAPEN) | (found > most * _MISSHAPEN)).any())


def position_at_rest(
    model: Model, eta: NDArray[np.float64], state: MassState
) -> NDArray[np.float64]:
    """Return the displacement of the car under its added weights, (7,), by its linear springs."""
    one = car(model, eta, state, np.zeros(0, dtype=np.intp))
    full = model.box.full(eta[: model.first].astype(complex))
    _, _, K = full_matrices(full)
    pull = np.concatenate([one.pull, one.corner[:, PULL]])
    return np.asarray(np.linalg.solve(K.real, pull))


def initial_states_of(
    model: Model,
    eta: NDArray[np.float64],
    decays: tuple[FreeDecay, ...],
    sigma: Mapping[str, float],
) -> tuple[InitialState, ...]:
    """Return the initial state of each run by the linear model at `eta`, (P,)."""
    box = model.box
    states = {s.name: s for s in box.mass_states}
    present = {decay.mass_state for decay in decays}
    linear = eta[: model.first]
    points = {name: linear_point(box, linear, name, sigma) for name in present}
    rests = {name: position_at_rest(model, eta, states[name]) for name in present}
    none = np.zeros(0, dtype=np.intp)
    cars = {name: car(model, eta, states[name], none) for name in present}
    result = []
    for decay in decays:
        motion = linear_part(points[decay.mass_state], decay).solution[:14].copy()
        motion[:7] += rests[decay.mass_state]
        speed = travel_speeds(cars[decay.mass_state], motion)
        result.append(InitialState(motion, np.tanh(speed / _SLIDES_M_S), np.zeros(4)))
    return tuple(result)
