"""Shares and residuals of a nonlinear fit, which without its elements is the linear one."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.vehicle import Fact, FactQuantity, Structure
from identify.decays.decay import ChannelGroup, FreeDecay, Recording, decay_start_s
from identify.fit.grey_box import GreyBox
from identify.fit.likelihood import FACTS, PRIORS
from identify.fit.likelihood import fit as linear_fit
from identify.nonlinear import path as threads
from identify.nonlinear.begin import initial_states_of, weak_priors
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.fit import fit, inverse, reduced
from identify.nonlinear.path import POLISH, InitialState
from identify.nonlinear.problem import Point, Problem, normal, point, run_of
from identify.nonlinear.real_car import NonlinearEngine, residuals_of
from identify.nonlinear.release import positions

from ..bumps import GROUP as PAPER_GROUP
from ..bumps import MASS_STATES, TRUTH, noise_of, paper_records
from .cars import RICH, bent, moving
from .truth import BASELINE, NOISE, channels

GROUP = ChannelGroup("hubs", tuple(channels()[1]))
SIGMA = {c.name: NOISE[c.quantity] for c in GROUP.channels}
FACT = Fact(FactQuantity.TOTAL_MASS, 1560.0, 2.0)
MODEL = Model(GreyBox((GROUP,), (BASELINE,), None, RICH, (FACT,)), KNOTS["K1"])
TIMES = np.arange(0.0, 0.3, 0.005)
FREE = tuple(MODEL.names.index(name) for name in ("m_s", "k_sf", "c_sr", "F_cf"))
SHOWN = tuple(sorted({*range(MODEL.first), *FREE}))


def start() -> InitialState:
    """Return a car in motion, wheels on the ground, half of the friction acting."""
    return InitialState(0.3 * moving().motion, np.full(4, 0.5), np.zeros(4))


def problem(values: NDArray[np.float64]) -> Problem:
    decay = FreeDecay("run", "baseline", 0.0, (Recording(GROUP, TIMES, values),))
    centre = np.zeros(len(MODEL.names))
    prior = np.full(len(centre), np.inf)
    prior[MODEL.names.index("F_cf")] = 5.0
    return Problem(MODEL, (run_of(MODEL, decay, SIGMA),), centre, prior, np.array(sorted(FREE)))


def car() -> NDArray[np.float64]:
    return bent(MODEL, F_cf=1.0, F_cr=0.6, k_2f=0.3)


@cache
def measured() -> Problem:
    """Return the samples of that motion, half a sigma high and low by turns."""
    still = problem(np.zeros((len(TIMES), 4)))
    at = point(still, car(), (start(),), POLISH)
    assert at is not None
    clean = -at.predicted[0].left[0] * np.array([SIGMA[c.name] for c in GROUP.channels])
    turns = 0.5 * np.where(np.arange(len(TIMES)) % 2, 1.0, -1.0)
    return problem(clean + turns[:, None] * np.array(list(SIGMA.values())))


def engine(own: InitialState) -> NonlinearEngine:
    return NonlinearEngine(measured(), car(), {"run": own}, np.array(SHOWN))


def decays() -> tuple[FreeDecay, ...]:
    return (measured().runs[0].decay,)


def at_start() -> Point:
    at = point(measured(), car(), (start(),), POLISH)
    assert at is not None
    return at


def test_only_elements_with_a_size_have_a_place_among_what_a_fit_shows() -> None:
    assert dict(engine(start()).elements) == {"F_cf": len(SHOWN) - 1}


def test_the_parts_together_are_the_reduced_equations() -> None:
    at = at_start()
    equations = normal(at)
    parts = engine(start()).parts(at)
    assert list(parts) == [FACTS, PRIORS, "run"]
    matrix, right, _ = reduced(equations, 0.0)
    place = np.searchsorted(SHOWN, measured().free)
    total = np.sum([part.information for part in parts.values()], axis=0)
    assert total[np.ix_(place, place)] == pytest.approx(matrix, rel=1e-9)
    gradient = np.sum([part.gradient for part in parts.values()], axis=0)
    assert gradient[place] == pytest.approx(right, rel=1e-9)
    held = np.setdiff1d(np.arange(len(SHOWN)), place)
    assert not total[held].any()
    assert not gradient[held].any()


def test_a_fact_and_a_prior_cost_their_squared_misfit() -> None:
    """1380 and twice 40.5 and 45.4 kg beside 1560 +- 2 kg; a friction of 50 N, 0.2 of a prior."""
    parts = engine(start()).parts(at_start())
    assert parts[FACTS].cost == pytest.approx((8.2 / 2.0) ** 2)
    assert parts[PRIORS].cost == pytest.approx(0.2**2)
    at = len(SHOWN) - 1
    assert parts[PRIORS].information[at, at] == pytest.approx(0.04)
    assert parts[PRIORS].gradient[at] == pytest.approx(-0.04)
    mass = SHOWN.index(MODEL.names.index("m_s"))
    slope = 1380.0 / 2.0  # of a logarithm, in sigmas
    assert parts[FACTS].information[mass, mass] == pytest.approx(slope**2)
    assert parts[FACTS].gradient[mass] == pytest.approx(slope * 8.2 / 2.0)


@pytest.mark.parametrize("off", [0.0, 0.03])
def test_at_other_unknowns_each_run_begins_where_it_fits_best(off: float) -> None:
    """The stored first state may belong to other unknowns: of 30 mm/s more in each direction."""
    own = start()
    own = replace(own, motion=own.motion + off * np.repeat([0.0, 1.0], 7))
    found = engine(own).normal_blocks(decays(), SIGMA, car()[list(SHOWN)])
    best = engine(start()).normal_blocks(decays(), SIGMA, car()[list(SHOWN)])
    # Half a sigma by turns is 60 of 240 samples; a little of it is taken for motion.
    assert 30.0 < best["run"].cost < 60.0
    assert found["run"].cost == pytest.approx(best["run"].cost, abs=0.1)
    by_size = np.sqrt(np.abs(best["run"].information).max())
    assert found["run"].gradient == pytest.approx(best["run"].gradient, abs=0.1 * by_size)


def test_the_shares_are_those_at_the_unknowns_that_are_asked_for() -> None:
    eta = car()[list(SHOWN)]
    eta[SHOWN.index(MODEL.names.index("m_s"))] += 0.01
    found = engine(start()).normal_blocks(decays(), SIGMA, eta)
    misfit = (1560.0 - 171.8 - 1380.0 * np.exp(0.01)) / 2.0
    assert found[FACTS].cost == pytest.approx(misfit**2)
    misfits, slopes = engine(start()).fact_misfits(eta)
    assert misfits == pytest.approx([misfit])
    assert slopes.shape == (1, len(SHOWN))


def test_residuals_are_in_si_and_each_channel_knows_its_freedom() -> None:
    """60 samples of 4 hubs, each less a level, and all less what 18 first values have taken."""
    at = at_start()
    equations = normal(at)
    (one,) = residuals_of(at)
    assert one.label == "run"
    turns = 0.5 * np.where(np.arange(len(TIMES)) % 2, 1.0, -1.0)
    for channel in GROUP.channels:
        assert one.values[channel.name] == pytest.approx(turns * SIGMA[channel.name], abs=1e-9)
    # The weak prior of the friction's first shares, 10 about zero, does not come from samples.
    taken = 18.0 - float(np.trace(inverse(equations.blocks[0].A)[14:, 14:])) / 100.0
    assert sum(one.freedom.values()) == pytest.approx(4 * 59 - taken, abs=1e-6)
    assert 14.0 < taken < 18.0
    (again,) = engine(start()).residuals(decays(), SIGMA, car()[list(SHOWN)])
    assert sum(again.freedom.values()) == pytest.approx(sum(one.freedom.values()), abs=0.1)


def test_unknowns_without_a_finite_path_are_an_error() -> None:
    far = replace(start(), motion=np.full(14, 99.0))
    with pytest.raises(FloatingPointError, match="finite"):
        engine(far).normal_blocks(decays(), SIGMA, car()[list(SHOWN)])


# Runs side by side in threads ---------------------------------------------------------------------


def test_runs_are_evaluated_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call waits for the other."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    threads._threads.cache_clear()
    meet = Barrier(2, timeout=60.0)

    def call(number: int, factor: float) -> float:
        meet.wait()
        return number * factor

    assert threads.for_each_run(call, (1, 2), (10.0, 100.0)) == (10.0, 200.0)


FORKS = """
import os, threading, time
os.cpu_count = lambda: 2
from identify.nonlinear.path import for_each_run
meet = threading.Barrier(2)
for_each_run(lambda _: meet.wait(), (1, 2))  # both threads exist
time.sleep(0.2)  # and have nothing to do
child = os.fork()
if child == 0:
    os._exit(for_each_run(abs, (-3, -4))[1])
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def test_a_forked_process_has_its_own() -> None:
    """Threads do not survive a fork: it would wait for ever."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORKS],
        cwd=Path(__file__).parents[3],
        timeout=60.0,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "4\n"


# Unknowns of the elements: where damper curves bend, and within which bounds a fit stays ----------


_LOW = 0.25
"""Share of the paper's bump: its own lifts the wheels."""


def low_decays() -> tuple[FreeDecay, ...]:
    found = []
    for record in paper_records(200.0, 30.0, 3):
        decay = record.decay(decay_start_s(record))
        short = [r.between(0.0, 1.0) for r in decay.recordings]
        low = tuple(replace(r, values=_LOW * r.values) for r in short)
        found.append(replace(decay, recordings=low))
    return tuple(found)


def test_parameters_and_intervals_are_those_of_the_linear_fit() -> None:
    runs = low_decays()
    noise = noise_of(paper_records(200.0, 30.0, 3), 200.0)
    sigma = {name: _LOW * level for name, level in noise.items()}
    box = GreyBox((PAPER_GROUP,), MASS_STATES, None, Structure())
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
