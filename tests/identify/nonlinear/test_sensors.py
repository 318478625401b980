"""What sensors make of a path: late, filtered, on a level of their own; and its derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from identify.decays.decay import ChannelGroup, FreeDecay, Recording
from identify.fit.grey_box import GreyBox
from identify.nonlinear.car import KNOTS, Model
from identify.nonlinear.path import POLISH
from identify.nonlinear.problem import Point, Problem, normal, point, run_of

from .cars import RICH, bent, moving
from .truth import BASELINE

HUB = Channel(
    "hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT, delay_sigma_s=1e-3,
    low_pass_hz=30.0,
)  # fmt: skip
TRAVEL = Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.REAR_RIGHT)
GROUPS = ChannelGroup("h", (HUB,)), ChannelGroup("t", (TRAVEL,))
SIGMA = {"hub": 0.5, "travel": 1e-3}
MODEL = Model(GreyBox(GROUPS, (BASELINE,), None, RICH), KNOTS["K3"])
TIMES = np.arange(40) / 250.0
DECAY = FreeDecay(
    "run", "baseline", 0.0, tuple(Recording(group, TIMES, np.zeros((40, 1))) for group in GROUPS)
)
FREE = ("m_s", "k_sf", "c_sr", "delay of h", "F_cf", "k_2f")


def at(**changed: float) -> Point:
    """Return the run of a car without friction whose wheels stay on the road."""
    own = replace(moving(), motion=0.3 * moving().motion)
    eta = bent(MODEL, k_2f=0.4, y_s=0.1)
    for name, by in changed.items():
        eta[MODEL.names.index(name.replace("_of_", " of "))] += by
    free = np.array([MODEL.names.index(name) for name in FREE])
    none = np.full(len(eta), np.inf)
    problem = Problem(MODEL, (run_of(MODEL, DECAY, SIGMA),), np.zeros(len(eta)), none, free)
    found = point(problem, eta, (own,), POLISH)
    assert found is not None
    return found


def test_a_run_begins_early_for_sensors_that_may_be_late() -> None:
    """Four sigmas of 1 ms, and 0.4 ms for a derivative; each channel has a level of its own."""
    run = run_of(MODEL, DECAY, SIGMA)
    assert run.early_s == pytest.approx(4.4e-3)
    assert run.end_s == pytest.approx(39 / 250.0 + 2 * 4.4e-3 + 2e-3)
    assert [w.tolist() for w in run.weights] == [[2.0], [1000.0]]
    # The hub's filter of second order leaves two transients beside its level.
    assert [basis.shape for basis in run.bases] == [(40, 3), (40, 1)]
    assert run.freedom == 37 + 39
    punctual = Model(GreyBox(GROUPS[1:], (BASELINE,), None, RICH), KNOTS["K3"])
    assert run_of(punctual, DECAY, SIGMA).early_s == 0.0


def without(values: NDArray[np.float64], *own: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what least squares by a level and other functions leave of some values."""
    table = np.column_stack([np.ones(len(values)), *own])
    return np.asarray(values - table @ np.linalg.lstsq(table, values, rcond=None)[0])


@pytest.mark.parametrize("late_ms", [0.0, 2.0])
def test_sensors_see_the_path_at_their_own_times_through_their_filters(late_ms: float) -> None:
    """By SciPy's simulation of the filter; the hub's clock is late beyond its nominal."""
    found = at(delay_of_h=late_ms * 1e-3)
    path = found.predicted[0].path
    time = np.arange(len(path.states)) * path.step_s
    early = found.problem.runs[0].early_s
    hub, travel = found.predicted[0].left

    x = path.states[:, :7]
    body = x[:, 0] + 1.51 * x[:, 1] + (-0.74 - 0.01) * x[:, 2]
    # A CG that stands 10 mm to the left: the corner is 0.75 m from it.
    seen = np.interp(TIMES + early, time, x[:, 6] - body)
    assert travel[:, 0] == pytest.approx(-1000.0 * without(seen), abs=2e-3 * np.ptp(travel))

    from scipy import signal  # a second to import, in every process that collects

    b, a = signal.butter(2, 2.0 * np.pi * 30.0, analog=True)
    output = signal.lsim((b, a), path.slopes[:, 10], time)[1]
    poles = np.roots(a)
    wave = np.exp(np.outer(TIMES, poles[:1]))
    seen = np.interp(TIMES + early - late_ms * 1e-3, time, output)
    expected = -2.0 * without(seen, wave.real, wave.imag)
    assert hub[:, 0] == pytest.approx(expected, abs=5e-3 * float(np.ptp(hub)))
    cost = sum(float(np.sum(left**2)) for left in (hub, travel))
    assert found.predicted[0].cost == pytest.approx(cost)


@pytest.mark.parametrize("name", FREE)
def test_derivatives_of_what_sensors_see_are_the_differences(name: str) -> None:
    """Of late and filtered sensors too."""
    step = 2e-5 if name == "delay of h" else 1e-4
    key = name.replace(" of ", "_of_")
    up, down = at(**{key: step}), at(**{key: -step})
    (block,) = normal(at()).blocks
    column = len(block.A) + FREE.index(name)
    for J, after, before in zip(
        block.jacobian, up.predicted[0].left, down.predicted[0].left, strict=True
    ):
        change = -(after - before) / (2.0 * step)
        size = float(np.abs(change).max())
        np.testing.assert_allclose(J[:, :, column], change, atol=0.02 * size + 1e-6)
