"""Start of a nonlinear fit: a linear fit with bars, and the motion that it gives each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.vehicle import MassState

from ..decays.decay import FreeDecay
from ..fit.grey_box import CROSS_SCALE_KG, SIGNED, GreyBox
from ..fit.likelihood import linearised
from ..model.matrices import SYMMETRIC, Full, full_matrices
from .car import PULL, Model, car
from .laws import knee
from .path import InitialState
from .problem import Problem

# Finds the common factor of all masses and forces, which the motion does not show -----------------
#
# If all masses, inertias, springs, dampers and friction of a car and of the weights on it are
# larger by one factor, it moves as before: only stated weights and facts determine the factor.  A
# search creeps along this curved valley; because it is known, its lowest point is found at once.

LENGTHS = ("a", "b", "t_f", "t_r", "y_s")
"""Parameters that a common factor of masses and forces does not change."""
_LARGEST_LOG = 1.5
"""Logarithm of the largest factor that is tried."""
_GOLDEN_SECTION = (np.sqrt(5.0) - 1.0) / 2.0


def scaled(box: GreyBox, linear: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return unknowns of a grey box, (P,), with its masses and forces times a factor."""
    result = linear.copy()
    for i, name in enumerate(box.parameters):
        if name in SIGNED and name not in LENGTHS:
            result[i] *= factor
        elif name not in LENGTHS:
            result[i] += np.log(factor)
    return result


def all_scaled(problem: Problem, eta: NDArray[np.float64], factor: float) -> NDArray[np.float64]:
    """Return all unknowns, (P,), with car and weights times a factor: the motion stays the same."""
    model = problem.model
    box = model.box
    result = eta.copy()
    result[: model.n_linear] = scaled(box, eta[: model.n_linear], factor)
    for i, kg in box.weight_masses.items():
        result[i] = factor * (kg + eta[i]) - kg
    if model.names[model.n_linear - 1] == "cross weight":
        result[model.n_linear - 1] *= factor
    for i, element in enumerate(model.elements, start=model.n_linear):
        if element.unit.startswith("N"):
            result[i] *= factor
        elif element.unit.endswith("/N"):
            result[i] /= factor
    return result


def at_likely_scale(problem: Problem, eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unknowns, (P,), times the factor that weights, facts and priors make most likely.

    They are unchanged where a weight is held at its stated value, because it then holds the factor,
    too.
    """
    box = problem.model.box
    n_weights = sum(len(state.added.weights) for state in box.mass_states)
    if len(np.intersect1d(list(box.weight_masses), problem.free)) < n_weights:
        return eta

    def cost(log_factor: float) -> float:
        scaled_eta = all_scaled(problem, eta, float(np.exp(log_factor)))
        terms = (problem.fact_terms(scaled_eta)[0], problem.prior_terms(scaled_eta)[0])
        return sum(float(misfits @ misfits) for misfits in terms)

    low, high = -_LARGEST_LOG, _LARGEST_LOG
    while high - low > 1e-5:  # golden section, finer than any known scale
        inner = high - _GOLDEN_SECTION * (high - low), low + _GOLDEN_SECTION * (high - low)
        if cost(inner[0]) < cost(inner[1]):
            high = inner[1]
        else:
            low = inner[0]
    best_log = 0.5 * (low + high)
    return all_scaled(problem, eta, float(np.exp(best_log))) if cost(best_log) < cost(0.0) else eta


# The start ----------------------------------------------------------------------------------------

_MASS_FACTOR = 2.0
"""Factor by which a car may be lighter or heavier than all generic vehicles, whose range is
wide."""
_SHAPE_FACTOR = 4.0
"""Factor beyond all generic vehicles above which a parameter is impossible for a vehicle."""


def scaled_to_vehicle(
    box: GreyBox, eta: NDArray[np.float64], vehicles: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return linear unknowns with all masses and forces scaled by one factor, or unchanged.

    Without scales their size rests on the effect of the weights, which friction hides: a linear fit
    of an suv had a mass of 22 t, with lengths and frequencies nearly right.  `eta`, (P,): of `box`.
    `vehicles`: generic ones, (15,) each, the usual one first.
    """
    masses = [float(vehicle[0]) for vehicle in vehicles]
    mass = float(np.exp(eta[box.parameters.index("m_s")]))
    if min(masses) / _MASS_FACTOR <= mass <= max(masses) * _MASS_FACTOR:
        return eta
    return scaled(box, eta, masses[0] / mass)


def is_impossible(
    box: GreyBox, eta: NDArray[np.float64], vehicles: Sequence[NDArray[np.float64]]
) -> bool:
    """Return whether linear unknowns, (P,) of `box`, are impossible for a vehicle.

    With friction as large as the rear wheels' load, a linear fit of a city car put its CG 4 mm
    behind the front axle: no search from there found the optimum, one from the usual vehicle did.
    """
    generic = np.array([SYMMETRIC @ vehicle for vehicle in vehicles])
    in_all = generic.all(axis=0)  # bars, tyre damping and offsets may be zero
    values = box.full(eta.astype(complex)).real[in_all]
    least, most = generic[:, in_all].min(axis=0), generic[:, in_all].max(axis=0)
    return bool(((values < least / _SHAPE_FACTOR) | (values > most * _SHAPE_FACTOR)).any())


def position_at_rest(
    model: Model, eta: NDArray[np.float64], state: MassState
) -> NDArray[np.float64]:
    """Return the displacement of the car under its added weights, (7,), by its linear springs."""
    no_unknowns = np.zeros(0, dtype=np.intp)
    loaded = car(model, eta, state, no_unknowns)
    full = model.box.full(eta[: model.n_linear].astype(complex))
    _, _, K = full_matrices(full)
    force_n = np.concatenate([loaded.pull, loaded.corner[:, PULL]])
    return np.asarray(np.linalg.solve(K.real, force_n))


def initial_states_of(
    model: Model,
    eta: NDArray[np.float64],
    decays: tuple[FreeDecay, ...],
    sigma: Mapping[str, float],
) -> tuple[InitialState, ...]:
    """Return the state in which each decay begins, by the linear model at `eta`, (P,).

    `sigma`: standard deviation of each channel's noise, SI.
    """
    box = model.box
    state_of = {s.name: s for s in box.mass_states}
    present = {decay.mass_state for decay in decays}
    linear_parts = linearised(box, decays, sigma, eta[: model.n_linear]).linear
    rest_positions = {name: position_at_rest(model, eta, state_of[name]) for name in present}
    no_unknowns = np.zeros(0, dtype=np.intp)
    cars = {name: car(model, eta, state_of[name], no_unknowns) for name in present}
    result = []
    for decay, linear_part in zip(decays, linear_parts, strict=True):
        motion = linear_part.solution[:14].copy()  # 7 displacements, 7 speeds
        # Those of the linear model are about the loaded car at rest, these about the bare one.
        motion[:7] += rest_positions[decay.mass_state]
        speeds_m_s = cars[decay.mass_state].travel_speeds(motion)
        # At 0.02 m/s most of the friction acts in the direction of the motion.
        friction, mounts = np.tanh(speeds_m_s / 0.02), np.zeros(4)
        result.append(InitialState(motion, friction, mounts))
    return tuple(result)


# Weak priors of the elements, which keep them near zero where a test is poor: no car exceeds them.
# They replace the choice of terms: a term that is dropped because it does not show yet biases the
# others, whereas a term under a weak prior only widens their intervals.

_PROGRESSION_1_M = 2.5
"""Standard deviation of k_2/k_s and of the tyre's beta, 1/m: 25 % more stiffness after 5 and 10
cm."""
_SIDES, _KNEE, _FAST_KNEE = 2.0, 0.7, 0.25
"""Standard deviation of a damper's change of slope over its coefficient: at rest, up to
`_FAST_M_S`, beyond it.

A curve that falls as the speed grows feeds energy into the car and has no finite path on a mount:
where few samples are that fast, these priors keep it from falling."""
_FAST_M_S = 0.2
_STOP = 6.0
"""Standard deviation of the rate of a bump stop, over k_s."""
_FRICTION_SPLIT_N = 30.0
_CORNER_SPLIT = 0.03
"""Standard deviation of half the difference of an axle's springs, tyres and wheels, over their
mean."""
_CG_M = 0.03
_CROSS = 0.1
"""Standard deviation of the cross weight, over a wheel's mean share of the body."""


def weak_priors(
    model: Model, eta: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and deviation of each unknown's prior, (P,), for a car about as at `eta`."""
    full = model.box.full(eta[: model.n_linear].astype(complex)).real
    k_s, c_s = (  # geometric mean of the four corners
        float(np.exp(np.mean(np.log(full[i : i + 4])))) for i in (Full.K_S, Full.C_S)
    )
    sigmas = {  # standard deviation, SI, by the beginning of the element's name
        "k_2": _PROGRESSION_1_M * k_s,
        "k_3": 60.0 * k_s,  # 45 % more stiffness after 5 cm
        "b_t": _PROGRESSION_1_M,
        "s_c": 0.3,  # relative difference of the dampers of an axle
        "dF_": _FRICTION_SPLIT_N,
        "dk_": _CORNER_SPLIT,
        "dm_": _CORNER_SPLIT,
        "s_m": 3e-6,  # the softest mounts of cars have 3e5 N/m
        "k_b": _STOP * k_s,
    }
    of_elements = [e.prior for e in model.elements]
    for i, e in enumerate(model.elements):
        prefix = next((p for p in sigmas if e.name.startswith(p)), None)
        if prefix is not None:
            of_elements[i] = sigmas[prefix] / e.scale
    for axle in "fr":
        for j, knot in enumerate(model.knots, start=1):
            relative = _SIDES if knot == 0.0 else _KNEE if abs(knot) < _FAST_M_S else _FAST_KNEE
            i = model.names.index(f"h_{axle}{j}") - model.n_linear
            of_elements[i] = relative * c_s / model.elements[i].scale
    of_box = model.box.prior_sigma.copy()
    for i, name in enumerate(model.box.parameters):
        if name.startswith("c_t"):
            of_box[i] = 0.2 * c_s / SIGNED[name]  # a fifth of the damper's coefficient
        elif name == "y_s":
            of_box[i] = _CG_M / SIGNED[name]
    if "cross weight" in model.names:
        wheel_share_kg = full[Full.M_S] / 4.0
        of_box[-1] = _CROSS * wheel_share_kg / CROSS_SCALE_KG
    mean = np.concatenate([np.zeros(model.n_linear), [e.unknown(e.rest) for e in model.elements]])
    return mean, np.concatenate([of_box, of_elements])


# Describes the same damper curves by more knees, which only the last steps of a fit need ----------

_FASTEST_M_S = 1.0
_SHARP_M_S = 1e-9
"""Rounding of knees where chords are drawn: a knee that is kept does not change then."""


def refined(
    problem: Problem, eta: NDArray[np.float64], knots: tuple[float, ...]
) -> tuple[Problem, NDArray[np.float64]]:
    """Return the problem with knees at `knots`, m/s, and `eta` with nearly the same curves.

    They pass through the points of the old curves at the new knees, so that no curve falls where
    the old one does not: on a mount, tangents would grow until they are useless.
    """
    coarse = problem.model
    model = Model(coarse.box, knots)
    bends = _bends(knots, coarse.knots)
    # The slopes at the knees come last among the unknowns, those of the front axle first.
    n_common = len(coarse.names) - 2 * len(coarse.knots)
    front, rear = np.split(eta[n_common:], 2)
    refined_eta = np.concatenate([eta[:n_common], bends @ front, bends @ rear])
    mean, prior = weak_priors(model, refined_eta)
    # The priors of unknowns that both problems have stay the same.
    mean[:n_common], prior[:n_common] = problem.centre[:n_common], problem.prior[:n_common]
    return replace(problem, model=model, centre=mean, prior=prior), refined_eta


def _bends(knots: tuple[float, ...], old_knots: tuple[float, ...]) -> NDArray[np.float64]:
    """Return the change of slope of the old curve's chords at each knot by each old knee.

    A knee in rebound, at a negative speed, counts the change from zero speed outwards.  Returns
    (len(knots), len(old_knots)).
    """
    speeds = np.array([-_FASTEST_M_S, *knots, _FASTEST_M_S])
    forces = np.stack([knee(speeds, knot, _SHARP_M_S) for knot in old_knots], axis=1)
    slopes = np.diff(forces, axis=0) / np.diff(speeds)[:, None]
    outwards = np.where(np.array(knots) < 0.0, -1.0, 1.0)[:, None]
    return outwards * np.diff(slopes, axis=0)
