"""Samples without noise: the fit stays at the car that made them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.sim.car import Spread
from daq.vehicle import FORD_GRANADA
from identify.decays.decay import ChannelGroup, FreeDecay, Recording
from identify.decays.onset import decay_start_s
from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import initial_states_of, weak_priors
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.fit import _Step, fit, inverse
from identify.nonlinear.path import USUAL, InitialState
from identify.nonlinear.problem import Normal, Problem, point, run_of
from identify.nonlinear.release import positions
from identify.pipeline import identify
from tests.simulated.fleet import fleet_car

from .cars import RICH, bent, model_of, moving
from .truth import BASELINE, NOISE, Truth, campaign, channels, drive, records

FRICTION_N, LENGTH_M = 70.0, 0.9e-3


@pytest.mark.long
def test_friction_that_acts_in_full_moves_no_parameter() -> None:
    """Each suspension moves as its decay begins: a share pulled towards zero would move wheels."""
    straight = ((FORD_GRANADA.c_sf,) * 4, (FORD_GRANADA.c_sr,) * 4)
    car = Truth(friction=(FRICTION_N,) * 4, length=(LENGTH_M,) * 2, slopes=straight)
    bumps = campaign((0.05,), ("pitch", "roll"))
    found = records(car, bumps, drive(car, bumps, 1.1), seed=5, rate_hz=100.0, noise=0.0)
    decays = tuple(record.decay(decay_start_s(record)) for record in found)
    sigma = {c.name: NOISE[c.quantity] for r in found[0].recordings for c in r.group.channels}
    model = model_of(found, "K1")
    length = float(np.log(LENGTH_M))
    truth = bent(model, F_cf=1.4, F_cr=1.4, d_cf=length, d_cr=length)
    centre, prior = weak_priors(model, truth)
    problem = Problem(
        model, tuple(run_of(model, decay, sigma) for decay in decays), centre, prior,
        positions(model, ("anti_roll_bars", "friction"), True),
    )  # fmt: skip
    best = fit(
        problem, truth, initial_states_of(model, truth, decays, sigma), USUAL, tolerance=0.01
    )
    assert best is not None
    off = (best.eta - truth)[problem.free] / np.sqrt(np.diag(inverse(best.information)))
    assert np.abs(off).max() < 0.06


@pytest.mark.long
def test_curves_between_knees_leave_little_at_a_tenth_of_the_noise() -> None:
    """A front damper printed with a kink at 0.054 m/s, a rear one of soft knees: 21 left 1.126."""
    drawn = fleet_car(8, 1, facts=True)
    noise = Spread(*(0.1 * sigma for sigma in astuple(drawn.car.noise)))
    quiet = replace(drawn, car=replace(drawn.car, noise=noise))
    assert identify(quiet.simulate().session).quality.chi2_per_n < 1.05


@pytest.mark.parametrize("share", [-1.0, 1.0])
def test_friction_that_acts_in_full_costs_nothing(share: float) -> None:
    group = ChannelGroup("hubs", tuple(channels()[1]))
    time_s = np.arange(0.0, 0.1, 0.01)
    decay = FreeDecay("run", "baseline", 0.0, (Recording(group, time_s, np.zeros((10, 4))),))
    model = Model(GreyBox((group,), (BASELINE,), None, RICH), KNOTS["K1"])
    car = bent(model, F_cf=1.0, F_cr=1.0)
    centre, prior = weak_priors(model, car)
    run = run_of(model, decay, {c.name: NOISE[c.quantity] for c in group.channels})
    problem = Problem(model, (run,), centre, prior, positions(model, ("friction",), True))
    at = point(
        problem, car, (InitialState(moving().motion, np.full(4, share), np.zeros(4)),), USUAL
    )
    assert at is not None
    misfits, _ = problem.prior_terms(car)
    assert at.cost - at.predicted[0].cost - float(misfits @ misfits) < 0.05


def stop_off(gap_m: float, start_m: float) -> tuple[Problem, NDArray[np.float64]]:
    """Return samples of a car with a stop, whose gap is the only unknown, and a start."""
    group = ChannelGroup("hubs", tuple(channels()[1]))
    recording = Recording(group, np.arange(0.0, 0.4, 0.01), np.zeros((40, 4)))
    decay = FreeDecay("run", "baseline", 0.0, (recording,))
    model = Model(GreyBox((group,), (BASELINE,), None, RICH), KNOTS["K1"])
    sigma = {c.name: 0.01 * NOISE[c.quantity] for c in group.channels}
    true, start = (bent(model, k_bf=1.0, g_bf=float(np.log(gap))) for gap in (gap_m, start_m))
    free = np.array([model.names.index("g_bf")])
    still = Problem(model, (run_of(model, decay, sigma),), *weak_priors(model, start), free)
    at = point(still, true, (moving(),), USUAL)
    assert at is not None
    values = -at.predicted[0].left[0] / still.runs[0].weights[0]
    moved = replace(decay, recordings=(replace(recording, values=values),))
    return replace(still, runs=(run_of(model, moved, sigma),)), start


def test_a_step_moves_the_gap_of_a_stop_by_five_percent_at_most() -> None:
    """Further off other samples meet the stop: a step that goes by the tangents goes astray."""
    problem, start = stop_off(0.015, 0.018)
    once = fit(problem, start, (moving(),), USUAL, max_iterations=1)
    assert once is not None
    assert float(np.exp(once.eta[problem.free][0])) == pytest.approx(0.018 * np.exp(-0.05))


@pytest.mark.parametrize(("fall", "converged"), [(0.01, True), (-5.0, False)])
def test_a_full_step_that_would_raise_the_cost_is_no_optimum(
    fall: float, converged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tangents that grew beyond use promise anything: a polish ended with -391 as converged."""
    problem, start = stop_off(0.015, 0.015)

    def step(equations: Normal, initials: Sequence[InitialState], *_: object) -> _Step:
        own = tuple(np.zeros(len(block.A)) for block in equations.blocks)
        return _Step(np.zeros(len(equations.right)), own, fall)

    monkeypatch.setattr("identify.nonlinear.fit._step", step)
    found = fit(problem, start, (moving(),), USUAL)
    assert found is not None
    assert found.converged is converged
