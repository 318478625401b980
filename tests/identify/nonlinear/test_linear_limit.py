"""Without its elements the nonlinear fit is the linear one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daq.vehicle import Structure
from identify.decays.decay import FreeDecay
from identify.decays.onset import decay_start_s
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import fit as linear_fit
from identify.nonlinear.begin import initial_states_of, weak_priors
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.fit import fit, inverse
from identify.nonlinear.path import POLISH
from identify.nonlinear.problem import Problem, run_of
from identify.nonlinear.release import positions

from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records

_LOW = 0.25
"""Share of the paper's bump: its own lifts the wheels."""


def decays() -> tuple[FreeDecay, ...]:
    found = []
    for record in paper_records(200.0, 30.0, 3):
        decay = record.decay(decay_start_s(record))
        short = [r.between(0.0, 1.0) for r in decay.recordings]
        low = tuple(replace(r, values=_LOW * r.values) for r in short)
        found.append(replace(decay, recordings=low))
    return tuple(found)


def test_parameters_and_intervals_are_those_of_the_linear_fit() -> None:
    runs = decays()
    noise = noise_of(paper_records(200.0, 30.0, 3), 200.0)
    sigma = {name: _LOW * level for name, level in noise.items()}
    box = GreyBox((GROUP,), MASS_STATES, None, Structure())
    linear = linear_fit(box, runs, sigma, box.unknowns(TRUTH), tolerance=1e-7)
    model = Model(box, KNOTS["K1"])
    eta = model.unknowns(linear.eta)
    centre, prior = weak_priors(model, eta)
    problem = Problem(
        model, tuple(run_of(model, decay, sigma) for decay in runs), centre, prior,
        positions(model, (), True),
    )  # fmt: skip
    initials = initial_states_of(model, eta, runs, sigma)
    eta[: len(linear.eta)] += 0.01  # from a little beside
    found = fit(problem, eta, initials, grade=POLISH, tolerance=1e-9, max_iterations=8)
    assert found is not None
    std = np.sqrt(np.diag(linear.covariance))
    # The linear search is held weakly about its start, by less than 1 % of a standard deviation.
    assert np.all(np.abs(found.eta[: model.first] - linear.eta) < 0.01 * std)
    again = np.sqrt(np.diag(inverse(found.information)))
    assert np.allclose(again, std, rtol=1e-6)
