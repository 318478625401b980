"""Start of a nonlinear fit: a linear fit with bars, and the motion that it gives each run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..decays.decay import FreeDecay
from ..fit.grey_box import CROSS_SCALE_KG, SIGNED, GreyBox
from ..fit.likelihood import linearised
from ..model.matrices import SYMMETRIC, Full, Real, full_matrices
from .car import GRAVITY, Car, Model, car
from .laws import knee
from .path import InitialState
from .problem import Problem

# Finds the common factor of all masses and forces, which the motion does not show -----------------
#
# If all masses, inertias, springs, dampers and friction of a car and of the weights on it are
# larger by one factor, it moves as before: only stated weights and facts determine the factor.  A
# search creeps along this curved valley, so its lowest point is found first.

LENGTHS = ("a", "b", "t_f", "t_r", "y_s")
"""Parameters that a common factor of masses and forces does not change."""


def scaled(box: GreyBox, linear: Real, factor: float) -> Real:
    """Return unknowns of a grey box, (P,), with its masses and forces times a factor."""
    result = linear.copy()
    for i, name in enumerate(box.parameters):
        if name in SIGNED and name not in LENGTHS:
            result[i] *= factor
        elif name not in LENGTHS:
            result[i] += np.log(factor)
    return result


def all_scaled(problem: Problem, eta: Real, factor: float) -> Real:
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


def at_likely_scale(problem: Problem, eta: Real) -> Real:
    """Return the unknowns, (P,), times the factor that weights, facts and priors make most likely.

    They are unchanged where a weight is held at its stated value: it holds the factor, too.
    """
    box = problem.model.box
    n_weights = sum(len(state.added.weights) for state in box.mass_states)
    if len(np.intersect1d(list(box.weight_masses), problem.free)) < n_weights:
        return eta

    def cost(log_factor: float) -> float:
        scaled_eta = all_scaled(problem, eta, float(np.exp(log_factor)))
        terms = (problem.fact_terms(scaled_eta)[0], problem.prior_terms(scaled_eta)[0])
        return sum(float(misfits @ misfits) for misfits in terms)

    low, high = -1.5, 1.5  # logarithms of the factor: from a fifth to five times
    golden_section = (np.sqrt(5.0) - 1.0) / 2.0
    while high - low > 1e-5:  # finer than any known scale
        inner = high - golden_section * (high - low), low + golden_section * (high - low)
        if cost(inner[0]) < cost(inner[1]):
            high = inner[1]
        else:
            low = inner[0]
    best_log = 0.5 * (low + high)
    return all_scaled(problem, eta, float(np.exp(best_log))) if cost(best_log) < cost(0.0) else eta


# The start ----------------------------------------------------------------------------------------

_MASS_FACTOR = 2.0
"""Factor by which a car may be lighter or heavier than all generic vehicles."""
_SHAPE_FACTOR = 4.0
"""Factor beyond all generic vehicles above which a parameter is impossible for a vehicle."""


def scaled_to_vehicle(box: GreyBox, eta: Real, vehicles: Sequence[Real]) -> Real:
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


def is_impossible(box: GreyBox, eta: Real, vehicles: Sequence[Real]) -> bool:
    """Return whether linear unknowns, (P,) of `box`, are impossible for a vehicle.

    With friction as large as the rear wheels' load, a linear fit of a city car put its CG 4 mm
    behind the front axle: no search from there found the optimum, one from the usual vehicle did.
    """
    generic = np.array([SYMMETRIC @ vehicle for vehicle in vehicles])
    in_all = generic.all(axis=0)  # bars, tyre damping and offsets may be zero
    values = box.full(eta.astype(complex)).real[in_all]
    least, most = generic[:, in_all].min(axis=0), generic[:, in_all].max(axis=0)
    return bool(((values < least / _SHAPE_FACTOR) | (values > most * _SHAPE_FACTOR)).any())


def position_at_rest(model: Model, eta: Real, loaded: Car) -> Real:
    """Return the displacement, (7,), of a linear car at `eta`, (P,), under its added weights."""
    full = model.box.full(eta[: model.n_linear].astype(complex))
    _, _, K = full_matrices(full)
    force_n = np.concatenate([loaded.gravity, loaded.corner[:, GRAVITY]])
    return np.asarray(np.linalg.solve(K.real, force_n))


def initial_states_of(
    model: Model, eta: Real, decays: tuple[FreeDecay, ...], sigma: Mapping[str, float]
) -> tuple[InitialState, ...]:
    """Return the state in which each decay begins, by the linear model at `eta`, (P,).

    `sigma`: standard deviation of each channel's noise, SI.
    """
    states = {s.name: s for s in model.box.mass_states}
    linear_parts = linearised(model.box, decays, sigma, eta[: model.n_linear]).linear
    no_unknowns = np.zeros(0, dtype=np.intp)
    present = {decay.mass_state for decay in decays}
    cars = {name: car(model, eta, states[name], no_unknowns) for name in present}
    rest_positions = {name: position_at_rest(model, eta, loaded) for name, loaded in cars.items()}
    result = []
    for decay, linear_part in zip(decays, linear_parts, strict=True):
        motion = linear_part.solution[:14].copy()  # 7 displacements, 7 speeds
        # Displacements of the linear model count from the loaded car at rest, these from the bare.
        motion[:7] += rest_positions[decay.mass_state]
        speeds_m_s = cars[decay.mass_state].travel_speeds(motion)
        # At 0.02 m/s most of the friction acts in the direction of the motion.
        friction, mounts = np.tanh(speeds_m_s / 0.02), np.zeros(4)
        result.append(InitialState(motion, friction, mounts))
    return tuple(result)


# Weak priors of the elements, which keep them near zero where a test is poor: no car exceeds them.
# They replace the choice of terms: a term that is dropped because it does not show yet biases the
# others, whereas a term under a weak prior only widens their intervals.


def weak_priors(model: Model, eta: Real) -> tuple[Real, Real]:
    """Return mean and deviation of each unknown's prior, (P,), for a car about as at `eta`.

    A damper whose force falls as the speed grows feeds energy into the car, and has no finite path
    on a mount: where few samples are that fast, the priors of fast knees keep it from falling.
    """
    full = model.box.full(eta[: model.n_linear].astype(complex)).real
    k_s, c_s = (  # geometric mean of the four corners
        float(np.exp(np.mean(np.log(full[i : i + 4])))) for i in (Full.K_S, Full.C_S)
    )
    sigmas = {  # standard deviation, SI, by the first three letters of the unknown's name
        "k_2": 2.5 * k_s,  # 25 % more stiffness after 5 cm
        "k_3": 60.0 * k_s,  # 45 % more stiffness after 5 cm
        "b_t": 2.5,  # 25 % more stiffness after 5 cm
        "s_c": 0.3,  # half the difference of an axle's dampers, over their mean
        "dF_": 30.0,
        "dk_": 0.03,  # half the difference of an axle's springs, or tyres, over their mean
        "dm_": 0.03,
        "s_m": 3e-6,  # the softest mounts of cars have 3e5 N/m
        "k_b": 6.0 * k_s,
        "c_t": 0.2 * c_s,
        "y_s": 0.03,
        "cro": 0.1 * full[Full.M_S] / 4.0,  # cross weight, over a wheel's mean part of the body
    }
    scales = SIGNED | {"cross weight": CROSS_SCALE_KG} | {e.name: e.scale for e in model.elements}
    for axle in "fr":
        for j, knot in enumerate(model.knots, start=1):
            # Change of the damper's slope over its coefficient: at rest, up to 0.2 m/s, beyond it.
            relative = 2.0 if knot == 0.0 else 0.7 if abs(knot) < 0.2 else 0.25
            sigmas[f"h_{axle}{j}"] = relative * c_s
    sigma = np.concatenate([model.box.prior_sigma, [e.prior for e in model.elements]])
    for i, name in enumerate(model.names):
        if name in sigmas or name[:3] in sigmas:
            sigma[i] = (sigmas[name] if name in sigmas else sigmas[name[:3]]) / scales[name]
    return model.unknowns(np.zeros(model.n_linear)), sigma


# Describes the same damper curves by more knees, which only the last steps of a fit need ----------


def refined(problem: Problem, eta: Real, knots: tuple[float, ...]) -> tuple[Problem, Real]:
    """Return the problem with knees at `knots`, m/s, and `eta` with nearly the same curves.

    They pass through the points of the old curves at the new knees, so that no curve falls where
    the old one does not: on a mount, tangents would grow until they are useless.
    """
    coarse = problem.model
    model = Model(coarse.box, knots)
    speeds_m_s = np.array([-1.0, *knots, 1.0])  # no damper moves faster than 1 m/s
    # Hardly rounded, so that a knee that both curves have does not change.
    forces = np.stack([knee(speeds_m_s, knot, 1e-9) for knot in coarse.knots], axis=1)
    chord_slopes = np.diff(forces, axis=0) / np.diff(speeds_m_s)[:, None]
    # A knee in rebound, at a negative speed, counts the change from zero speed outwards.
    outwards = np.where(np.array(knots) < 0.0, -1.0, 1.0)[:, None]
    by_old_knees = outwards * np.diff(chord_slopes, axis=0)  # (new knees, old knees)
    # The slopes at the knees come last among the unknowns, those of the front axle first.
    n_before = len(coarse.names) - 2 * len(coarse.knots)
    front, rear = np.split(eta[n_before:], 2)
    refined_eta = np.concatenate([eta[:n_before], by_old_knees @ front, by_old_knees @ rear])
    mean, sigma = weak_priors(model, refined_eta)
    # The priors of unknowns that both problems have stay the same.
    mean[:n_before], sigma[:n_before] = problem.centre[:n_before], problem.prior[:n_before]
    return replace(problem, model=model, centre=mean, prior=sigma), refined_eta
