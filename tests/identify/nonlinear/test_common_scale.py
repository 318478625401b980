"""One factor of all masses and forces leaves the motion as it is; weights as stated know it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import AddedMass, MassState
from identify.decays.decay import ChannelGroup, FreeDecay, Recording
from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import all_scaled, at_likely_scale, scaled, weak_priors
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.path import USUAL, InitialState
from identify.nonlinear.problem import Problem, point, run_of

from .cars import RICH, moving, rich
from .truth import BASELINE, NOISE, WEIGHTS, channels

GROUP = ChannelGroup("hubs", tuple(channels()[1]))
TIME_S = np.arange(0.0, 0.4, 0.005)
DECAY = FreeDecay("run", "added", 0.0, (Recording(GROUP, TIME_S, np.zeros((len(TIME_S), 4))),))


def problem(sigma_kg: float = 0.1, free_weights: bool = True) -> Problem:
    """Return a run with weights, each known to `sigma_kg`, but the first always to 0.1 kg."""
    weights = tuple(replace(w, sigma_kg=sigma_kg if i else 0.1) for i, w in enumerate(WEIGHTS))
    states = (BASELINE, MassState("added", AddedMass(weights)))
    model = Model(GreyBox((GROUP,), states, None, RICH, lifts=True), KNOTS["K3"])
    centre, prior = weak_priors(model, rich_car(model))
    run = run_of(model, DECAY, {c.name: NOISE[c.quantity] for c in GROUP.channels})
    free = np.arange(len(centre))
    held = list(model.box.weight_masses)[:1]
    return Problem(model, (run,), centre, prior, free if free_weights else np.delete(free, held))


def rich_car(model: Model) -> NDArray[np.float64]:
    """Return a car with everything there is, and a cross weight."""
    eta = rich(model, True)
    eta[model.names.index("cross weight")] = 0.4
    return eta


def cost_of_motion(given: Problem, eta: NDArray[np.float64]) -> float:
    at = point(
        given, eta, (InitialState(0.3 * moving().motion, np.full(4, 0.2), np.zeros(4)),), USUAL
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
    first = given.model.first
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
