"""A step of the fit: the best one within its bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import AddedMass, MassState
from identify.decays.decay import ChannelGroup, FreeDecay, Recording
from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import (
    all_scaled,
    at_likely_scale,
    is_impossible,
    refined,
    scaled,
    scaled_to_vehicle,
    weak_priors,
)
from identify.nonlinear.car import KNOTS as KNOTS_OF_CAR
from identify.nonlinear.car import Model
from identify.nonlinear.fit import _step
from identify.nonlinear.laws import knee
from identify.nonlinear.path import POLISH, InitialState
from identify.nonlinear.problem import Block, Normal, Problem, point_at, run_of, slope_deficits

from ..bumps import GROUP, MASS_STATES, TRUTH
from .truth import BASELINE, NOISE, RICH, WEIGHTS, bent, channels, granada, model_of, moving, rich

N_OWN, N_SHARED = 18, 3
FREE = np.full(N_SHARED, np.inf)


def equations(pull: float) -> tuple[Normal, np.ndarray, np.ndarray]:
    """Return normal equations of one run that pull its first friction, and the whole of them."""
    rng = np.random.default_rng(4)
    root = rng.standard_normal((60, N_OWN + N_SHARED))
    H, g = root.T @ root, rng.standard_normal(N_OWN + N_SHARED)
    g[14] += pull
    block = Block(H[:N_OWN, :N_OWN], H[:N_OWN, N_OWN:], H[N_OWN:, N_OWN:], g[:N_OWN], g[N_OWN:], ())
    alone = np.zeros((N_SHARED, N_SHARED)), np.zeros(N_SHARED)
    return Normal((block,), *alone, np.zeros(0), np.zeros((0, N_SHARED))), H, g


def with_segments(given: Normal, deficits: np.ndarray, falls: np.ndarray) -> Normal:
    """Return equations with segments of damper curves, those that are flat now in force."""
    flat = deficits > 0.0
    return replace(
        given,
        deficits=deficits,
        falls=falls,
        matrix=falls[flat].T @ falls[flat],
        right=falls[flat].T @ deficits[flat],
    )


def at_rest(friction: float) -> InitialState:
    return InitialState(np.zeros(14), np.array([friction, 0.0, 0.0, 0.0]), np.zeros(4))


def test_a_free_step_is_that_of_the_whole_equations() -> None:
    given, H, g = equations(1.0)
    found = _step(given, (at_rest(0.0),), 0.0, -FREE, FREE)
    whole = np.linalg.solve(H, g)
    assert found.free == pytest.approx(whole[N_OWN:])
    assert found.own[0] == pytest.approx(whole[:N_OWN])
    assert found.fall == pytest.approx(float(g @ whole))


def test_friction_that_acts_in_full_stops_and_the_others_step_with_it() -> None:
    given, H, g = equations(40.0)
    found = _step(given, (at_rest(0.75),), 0.0, -FREE, FREE)
    rest = np.delete(np.arange(N_OWN + N_SHARED), 14)
    with_it = np.linalg.solve(H[np.ix_(rest, rest)], g[rest] - 0.25 * H[rest, 14])
    assert found.own[0][14] == pytest.approx(0.25)
    assert np.concatenate([np.delete(found.own[0], 14), found.free]) == pytest.approx(with_it)


def test_an_unknown_at_its_bound_does_not_hold_up_the_others() -> None:
    given, H, g = equations(1.0)
    whole = np.linalg.solve(H, g)
    high = FREE.copy()
    high[1] = whole[N_OWN + 1] - 0.5
    found = _step(given, (at_rest(0.0),), 0.0, -FREE, high)
    rest = np.delete(np.arange(N_OWN + N_SHARED), N_OWN + 1)
    with_it = np.linalg.solve(H[np.ix_(rest, rest)], g[rest] - high[1] * H[rest, N_OWN + 1])
    assert found.free[1] == pytest.approx(high[1])
    assert np.delete(found.free, 1) == pytest.approx(with_it[N_OWN:])


@pytest.mark.parametrize(("room", "held"), [(0.9, True), (1.1, False)])
def test_a_damper_curve_is_held_up_where_the_step_would_make_it_too_flat(
    room: float, held: bool
) -> None:
    """`room`: the segment's slope above the floor, over what the free step takes of it."""
    given, H, g = equations(1.0)
    whole = np.linalg.solve(H, g)
    falls = np.array([[0.0, 300.0, 0.0]]) * -np.sign(whole[N_OWN + 1])
    deficits = -room * np.abs(falls @ whole[N_OWN:])
    found = _step(with_segments(given, deficits, falls), (at_rest(0.0),), 0.0, -FREE, FREE)
    row = np.concatenate([np.zeros(N_OWN), falls[0]])
    with_it = np.linalg.solve(H + held * np.outer(row, row), g + held * row * deficits[0])
    assert found.free == pytest.approx(with_it[N_OWN:])
    cost = float(with_it @ H @ with_it - 2.0 * g @ with_it)
    cost += max(0.0, float(deficits[0] - row @ with_it)) ** 2
    assert found.fall == pytest.approx(-cost)


# No damper's force falls as the speed grows -------------------------------------------------------

MODEL = model_of(knots="K3")
START = bent(MODEL)


def _flat(eta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the terms of the curves, one for each segment, front first; steep ones are free."""
    return np.maximum(slope_deficits(MODEL, eta)[0], 0.0)


def _slopes_beside_the_coefficient(h: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the slope in each segment over the secant within 0.1 m/s, of a curve drawn by hand."""

    def force(v: float) -> float:
        bends = sum(1000.0 * x * knee(v, at, 1e-9) for x, at in zip(h, KNOTS, strict=True))
        return float(2000.0 * v + bends)

    secant = (force(0.1) - force(-0.1)) / 0.2
    middles = (-0.5, -0.05, 0.05, 0.5)
    return np.array([(force(v + 1e-4) - force(v - 1e-4)) / 2e-4 / secant for v in middles])


KNOTS = (-0.15, 0.0, 0.15)


@pytest.mark.parametrize("h", [(-1.4, 0.3, -1.0), (0.0, -0.6, -1.3), (-1.9, 0.0, -2.2)])
def test_a_segment_counts_by_what_it_lacks_of_two_per_cent(h: tuple[float, float, float]) -> None:
    shares = _slopes_beside_the_coefficient(h)
    # The same curve about the Granada's 1,500 N s/m.
    secant = 2000.0 + 1000.0 * 0.5 * h[1]
    scale = 1500.0 / secant
    eta = bent(MODEL, **{f"h_f{j}": x * scale for j, x in enumerate(h, start=1)})
    expected = np.maximum(0.02 - shares, 0.0) / 0.01
    np.testing.assert_allclose(_flat(eta)[:4], expected, rtol=0.03, atol=0.03)
    assert not _flat(eta)[4:].any()


@pytest.mark.parametrize(("share", "counts"), [(0.021, False), (0.019, True)])
def test_the_limit_is_two_per_cent_of_the_coefficient(share: float, counts: bool) -> None:
    eta = bent(MODEL, h_r3=-1.5 * (1.0 - share))
    assert bool(_flat(eta).any()) is counts


# Where a nonlinear fit begins: at a linear fit, if it is that of a vehicle ------------------------

BOX = GreyBox((GROUP,), MASS_STATES, None, RICH)
VEHICLES = tuple(TRUTH * np.where(np.arange(15) == 0, kg / TRUTH[0], 1.0) for kg in (1e3, 5e2, 4e3))
"""Vehicles of 1000, 500 and 4000 kg: 250 to 8000 kg are within a factor of two of them."""


@pytest.mark.parametrize(
    ("body_kg", "kept_kg"),
    [(240.0, 1000.0), (260.0, 260.0), (7900.0, 7900.0), (8100.0, 1000.0), (3e4, 1000.0)],
)
def test_masses_and_forces_of_no_vehicle_scale_together(body_kg: float, kept_kg: float) -> None:
    full = granada()
    full[0] = body_kg
    eta = BOX.unknowns_of(full)
    before = dict(zip(BOX.names, BOX.values(eta), strict=True))
    after = dict(zip(BOX.names, BOX.values(scaled_to_vehicle(BOX, eta, VEHICLES)), strict=True))
    factor = kept_kg / before["m_s"]
    for name in ("m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_tr", "c_sf", "k_af", "k_ar"):
        assert after[name] == pytest.approx(factor * before[name], rel=1e-12), name
    for name in ("a", "b", "t_f", "t_r", "y_s"):
        assert after[name] == before[name]


@pytest.mark.parametrize(
    ("index", "factor", "no_vehicle"),
    [(11, 0.26, False), (11, 0.24, True), (8, 3.9, False), (8, 4.1, True), (0, 0.13, False),
     (0, 0.12, True), (0, 15.9, False), (0, 16.1, True)],
)  # fmt: skip
def test_a_parameter_four_times_beyond_all_vehicles_is_that_of_none(
    index: int, factor: float, no_vehicle: bool
) -> None:
    wide = tuple(TRUTH * np.where(np.arange(15) == 0, share, 1.0) for share in (1.0, 0.5, 4.0))
    theta = TRUTH.copy()
    theta[index] *= factor
    assert is_impossible(BOX, BOX.unknowns(theta), wide) is no_vehicle


# One factor of all masses and forces leaves the motion as it is; weights as stated know it --------

HUBS = ChannelGroup("hubs", tuple(channels()[1]))
TIME_S = np.arange(0.0, 0.4, 0.005)
DECAY = FreeDecay("run", "added", 0.0, (Recording(HUBS, TIME_S, np.zeros((len(TIME_S), 4))),))


def problem(sigma_kg: float = 0.1, free_weights: bool = True) -> Problem:
    """Return a run with weights, each known to `sigma_kg`, but the first always to 0.1 kg."""
    weights = tuple(replace(w, sigma_kg=sigma_kg if i else 0.1) for i, w in enumerate(WEIGHTS))
    states = (BASELINE, MassState("added", AddedMass(weights)))
    model = Model(GreyBox((HUBS,), states, None, RICH, may_lift=True), KNOTS_OF_CAR["K3"])
    centre, prior = weak_priors(model, rich_car(model))
    run = run_of(model, DECAY, {c.name: NOISE[c.quantity] for c in HUBS.channels})
    free = np.arange(len(centre))
    held = list(model.box.weight_masses)[:1]
    return Problem(model, (run,), centre, prior, free if free_weights else np.delete(free, held))


def rich_car(model: Model) -> NDArray[np.float64]:
    """Return a car with everything there is, and a cross weight."""
    eta = rich(model, True)
    eta[model.names.index("cross weight")] = 0.4
    return eta


def cost_of_motion(given: Problem, eta: NDArray[np.float64]) -> float:
    at = point_at(
        given, eta, (InitialState(0.3 * moving().motion, np.full(4, 0.2), np.zeros(4)),), POLISH
    )
    assert at is not None
    return at.predicted[0].cost


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_car_and_weights_times_a_factor_move_as_before(factor: float) -> None:
    given = problem()
    eta = rich_car(given.model)
    before = cost_of_motion(given, eta)
    assert cost_of_motion(given, all_scaled(given, eta, factor)) == pytest.approx(before, rel=1e-4)
    alone = eta.copy()
    first = given.model.n_linear
    alone[:first] = scaled(given.model.box, eta[:first], factor)
    assert cost_of_motion(given, alone) != pytest.approx(before, rel=0.01)


@pytest.mark.parametrize("factor", [0.25, 0.6, 0.9, 1.7, 4.0])
def test_the_weights_bring_the_factor_back(factor: float) -> None:
    given = problem()
    eta = rich_car(given.model)
    found = at_likely_scale(given, all_scaled(given, eta, factor))
    weights = list(given.model.box.weight_masses)
    assert len(weights) == 8
    np.testing.assert_allclose(found[weights], 0.0, atol=0.02)  # kg
    np.testing.assert_allclose(found[:11], eta[:11], atol=1e-3)


@pytest.mark.parametrize("given", [problem(sigma_kg=0.0), problem(free_weights=False)])
def test_a_weight_that_is_held_holds_the_factor(given: Problem) -> None:
    eta = all_scaled(given, rich_car(given.model), 0.9)
    np.testing.assert_array_equal(at_likely_scale(given, eta), eta)


# The same damper curves on more knees -------------------------------------------------------------


def _force(speed: np.ndarray, h: np.ndarray, knots: tuple[float, ...]) -> np.ndarray:
    """Return a curve of sharp knees by hand, level between +-0.1 m/s."""

    def bends(v: np.ndarray) -> np.ndarray:
        one = [1000.0 * x * knee(v, at, 1e-9) for x, at in zip(h, knots, strict=True)]
        return np.asarray(np.sum(one, axis=0))

    at = bends(np.array([0.1, -0.1]))
    return np.asarray(bends(speed) - (at[0] - at[1]) / 0.2 * speed)


def _problem(seed: int) -> tuple[Problem, np.ndarray]:
    """Return a car whose curves bend up and down at 21 knees and rise nearly nowhere by less."""
    model = model_of(knots="K21")
    rng = np.random.default_rng(seed)
    bends = {f"h_{axle}{j}": float(rng.normal(0.0, 0.8)) for axle in "fr" for j in range(1, 22)}
    eta = bent(model, **bends)
    centre, prior = weak_priors(model, eta)
    return Problem(model, (), centre, prior, np.arange(len(eta))), eta


@pytest.mark.parametrize("seed", range(8))
def test_no_segment_is_flatter_than_the_flattest_before(seed: int) -> None:
    """A curve fitted by least squares overshot and fell: on a mount no step was of use then."""
    problem, eta = _problem(seed)
    before = slope_deficits(problem.model, eta)[0]
    finer, moved = refined(problem, eta, KNOTS_OF_CAR["K37"])
    after = slope_deficits(finer.model, moved)[0]
    for old, new in zip(np.split(before, 2), np.split(after, 2), strict=True):
        assert new.max() < old.max() + 1.0  # 1 % of the coefficient, for rounded knees


def test_the_new_curve_runs_through_the_old_one_at_the_new_knees() -> None:
    problem, eta = _problem(1)
    _, moved = refined(problem, eta, KNOTS_OF_CAR["K37"])
    at = np.array(KNOTS_OF_CAR["K37"])
    for old, new in ((eta[-42:-21], moved[-74:-37]), (eta[-21:], moved[-37:])):
        before = _force(at, old, KNOTS_OF_CAR["K21"])
        after = _force(at, new, KNOTS_OF_CAR["K37"])
        # 0.1 m/s is no new knee, so that the secant about which both turn is not the same.
        lean = (after - before)[at != 0.0] / at[at != 0.0]
        assert np.ptp(lean) < 1e-4
