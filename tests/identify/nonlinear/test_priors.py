"""Weak priors of the elements, coefficients of a corner, and which unknowns a group has."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.vehicle import AddedMass, BodyWeight, Corner, HubWeight, MassState, Structure
from identify.decays.decay import ChannelGroup, FreeDecay, Recording, decay_start_s
from identify.fit.grey_box import GreyBox
from identify.nonlinear.begin import position_at_rest
from identify.nonlinear.car import (
    BETA,
    C_T,
    F_C,
    FALL,
    GAP,
    GRAVITY,
    K_2,
    K_3,
    K_A,
    K_B,
    KNEES,
    KNOTS,
    LENGTH,
    MASS,
    MOUNT,
    RATIO,
    STATIC,
    SURPLUS,
    C,
    Model,
    X,
    Y,
    car,
)
from identify.nonlinear.fit import Clock, Optimum
from identify.nonlinear.path import POLISH
from identify.nonlinear.problem import Point, Problem, point_at, run_of
from identify.nonlinear.release import Attempt, moved_by_beginnings, release
from identify.pipeline import identify
from identify.trust.finding import Verdict
from tests.simulated.fleet import fleet_car

from ...simulated.elements import true_parameters
from ..bumps import GROUP, MASS_STATES, TRUTH, noise_of, paper_records
from .truth import BASELINE, RICH, bent, model_of, moving

MODEL = model_of(knots="K5")
NONE = np.zeros(0, dtype=np.intp)
K_S = np.sqrt(17e3 * 22e3)
"""Geometric mean of the springs; all dampers have 1500 N s/m."""


def test_a_corner_has_the_elements_of_its_axle_and_half_the_difference_of_its_side() -> None:
    eta = bent(
        MODEL, F_cf=1.2, F_cr=0.4, dF_cf=0.2, s_cr=0.3, r_cf=0.5, k_2f=0.3, k_3r=0.2, k_bf=1.5,
        s_mf=2.0, b_tr=0.3, c_tf=1.5, y_s=0.2, d_cr=float(np.log(1e-3)), v_cf=float(np.log(0.02)),
        g_br=float(np.log(0.03)), h_f3=0.4, h_r5=-0.3,
    )  # fmt: skip
    one = car(MODEL, eta, BASELINE, NONE)
    expected = {
        X: [1.25, 1.25, -1.51, -1.51],
        Y: [0.72, -0.76, 0.72, -0.76],  # from a CG that stands 20 mm to the left
        K_2: [3e4, 3e4, 0.0, 0.0],
        K_3: [0.0, 0.0, 2e5, 2e5],
        K_B: [1.5e5, 1.5e5, 0.0, 0.0],
        GAP: [0.025, 0.025, 0.03, 0.03],
        K_A: [8e3, 8e3, 5e3, 5e3],
        F_C: [70.0, 50.0, 20.0, 20.0],
        LENGTH: [0.5e-3, 0.5e-3, 1e-3, 1e-3],
        SURPLUS: [0.5, 0.5, 0.0, 0.0],
        FALL: [0.02, 0.02, 0.01, 0.01],
        RATIO: [1.0, 1.0, 1.3, 0.7],
        MOUNT: [2e-6, 2e-6, 0.0, 0.0],
        BETA: [0.0, 0.0, 3.0, 3.0],
        C_T: [150.0, 150.0, 0.0, 0.0],
        MASS: [40.5, 40.5, 45.4, 45.4],
        GRAVITY: [0.0, 0.0, 0.0, 0.0],
        KNEES + 2: [400.0, 400.0, 0.0, 0.0],
        KNEES + 4: [0.0, 0.0, -300.0, -300.0],
        # The secant within 0.1 m/s stays: half of a knee at rest goes off, none of one at 0.3.
        C: [1300.0, 1300.0, 1500.0, 1500.0],
    }
    for column, values in expected.items():
        assert one.corner[:, column] == pytest.approx(values, rel=1e-9, abs=1.0 * (column == C))
    assert one.has_mount
    assert not car(MODEL, bent(MODEL), BASELINE, NONE).has_mount
    free = np.array([MODEL.names.index("s_mr")])
    assert car(MODEL, bent(MODEL), BASELINE, free).has_mount  # or may have one


def test_static_loads_are_those_of_scales() -> None:
    """9.80665 N/kg of 1380 kg by the lever of the other axle, half on each side, and a wheel."""
    one = car(MODEL, bent(MODEL), BASELINE, NONE)
    front = 9.80665 * (1380.0 * 1.51 / 2.76 / 2.0 + 40.5)
    rear = 9.80665 * (1380.0 * 1.25 / 2.76 / 2.0 + 45.4)
    assert one.corner[:, STATIC] == pytest.approx([front, front, rear, rear])
    assert one.mass == pytest.approx(np.diag([1380.0, 2500.0, 400.0]), rel=0.3)


LOADED = MassState(
    "added", AddedMass((BodyWeight(80.0, x_m=-1.25, y_m=0.0), HubWeight(5.0, Corner.REAR_LEFT)))
)


def test_what_is_added_pulls_the_car_down_and_moves_with_it() -> None:
    """80 kg at the CG and 5 kg on a hub: the body sinks by the force over all four springs."""
    bare, one = (car(MODEL, bent(MODEL), state, NONE) for state in (BASELINE, LOADED))
    assert one.gravity == pytest.approx([-80.0 * 9.80665, 0.0, 0.0], abs=1e-9)
    assert one.corner[:, GRAVITY] == pytest.approx([0.0, 0.0, -5.0 * 9.80665, 0.0])
    assert one.corner[:, MASS] == pytest.approx([40.5, 40.5, 50.4, 45.4])
    assert one.mass[0, 0] - bare.mass[0, 0] == pytest.approx(80.0)
    rest = position_at_rest(MODEL, bent(MODEL), one)
    # Each tyre carries what the ground gives: together all that was added.
    assert rest[3:] @ np.full(4, 192e3) == pytest.approx(-85.0 * 9.80665)
    assert rest[0] < rest[3:].max()


# Where the search begins: a second start is tried where the first leads nowhere -------------------

BOX = GreyBox((GROUP,), MASS_STATES, None, Structure())
_LOW = 0.25
"""Share of the paper's bump: its own lifts the wheels."""


@pytest.fixture(scope="module")
def model() -> Model:
    return Model(BOX, KNOTS["K3"])


def attempt(model: Model, lost: bool, late_s: float = 0.0, disturbed: int = 0) -> Attempt:
    """Return a start, led astray or near; the first runs given have a knock at 0.05 s."""
    records = paper_records(200.0, 30.0, 3)
    sigma = {name: _LOW * level for name, level in noise_of(records, 200.0).items()}
    decays = []
    for i, record in enumerate(records):
        decay = record.decay(decay_start_s(record) + late_s)
        short = [r.between(0.0, 0.6) for r in decay.recordings]
        knock = [30.0 * (i < disturbed) * (abs(r.time_s + late_s - 0.05) < 0.02) for r in short]
        low = tuple(
            replace(r, values=_LOW * r.values + added[:, None] * _noise(r, sigma))
            for r, added in zip(short, knock, strict=True)
        )
        decays.append(replace(decay, recordings=low))
    runs = tuple(run_of(model, decay, sigma) for decay in decays)
    theta = TRUTH.copy()
    theta[[0, 2, 6, 8]] *= (6.0, 7.0, 20.0, 30.0) if lost else 1.1
    return Attempt(runs, runs, model.unknowns(BOX.unknowns(theta)), sigma, late_s)


def _noise(recording: Recording, sigma: Mapping[str, float]) -> NDArray[np.float64]:
    return np.array([sigma[channel.name] for channel in recording.group.channels])


def test_the_next_start_is_asked_for_where_one_leads_nowhere(model: Model) -> None:
    """Which one is followed else: `test_release`."""
    attempts = (attempt(model, lost) for lost in (True, False))
    found = release(model, attempts, lambda _: False, lambda _: None, Clock())
    assert found is not None
    best, chosen = found
    assert chosen == ()
    assert np.max(np.abs(np.exp(best.eta[:15]) / TRUTH - 1.0)) < 0.05


def test_beginnings_that_were_left_out_come_back_where_the_car_explains_them(model: Model) -> None:
    """All but those of two runs with a knock."""
    first, late = attempt(model, True, 0.0, 2), attempt(model, False, 0.1)
    found = release(model, iter((first, late)), lambda _: False, lambda _: None, Clock())
    assert found is not None
    fitted = found[0].point.problem.runs
    assert fitted == (*late.runs[:2], *first.runs[2:])
    assert np.max(np.abs(np.exp(found[0].eta[:15]) / TRUTH - 1.0)) < 0.05


@pytest.fixture(scope="module")
def found_late(model: Model) -> Optimum:
    """Return the car that was found from 0.1 s after the beginnings on."""
    attempts = iter((attempt(model, False, 0.1),))
    found = release(model, attempts, lambda _: False, lambda _: None, Clock())
    assert found is not None
    return found[0]


@pytest.mark.parametrize(
    ("slower", "disturbed", "moves"),
    [
        (1.0, 0, False),  # the same car in the beginnings: noise moves it by 1.4 deviations
        (1.1, 0, True),  # springs that are 17 % softer with them
        (1.1, 3, False),  # knocks of 30 times the noise: no car moves like that
    ],
)
def test_what_the_beginnings_would_move_counts_beyond_chance_where_the_fit_of_all_holds(
    model: Model, found_late: Optimum, slower: float, disturbed: int, moves: bool
) -> None:
    first = attempt(model, False, 0.0, disturbed)
    runs = []
    for run in first.runs:
        stretched = tuple(replace(r, time_s=slower * r.time_s) for r in run.decay.recordings)
        runs.append(replace(run, decay=replace(run.decay, recordings=stretched)))
    begun = first.initials(model, found_late.eta)
    moved = moved_by_beginnings(found_late, tuple(runs), begun, Clock())
    assert moved.any() == moves
    if moves:
        spring = list(found_late.point.problem.free).index(model.names.index("k_sf"))
        assert moved[spring] == pytest.approx(-0.19, abs=0.06)


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "seed", "weighed", "verdict"),
    [
        (8, 1, True, Verdict.OK),
        (8, 3, True, Verdict.OK),
        (12, 2, True, Verdict.OK),
        (10, 2, True, Verdict.OK),  # steps that made a damper's curve fall found no path
        (23, 2, True, Verdict.DOUBTFUL),  # some runs only from 0.15 s on
        (0, 3, False, Verdict.OK),  # a linear fit with the CG at the front axle
        (61, 3, False, Verdict.OK),  # the first start ends at chi2/n 3
        (36, 3, False, Verdict.OK),  # the start that ends lower leaves the beginnings out
        (3, 3, False, Verdict.OK),  # a mount would join too early
        (6, 2, False, Verdict.OK),  # a linear fit of 22 t
        (13, 3, False, Verdict.OK),
        (45, 1, False, Verdict.OK),  # mounts that join before the stops lead astray
        (56, 3, False, Verdict.OK),
        (65, 3, False, Verdict.OK),
        (53, 2, False, Verdict.OK),  # mounts that shrink to nothing and hold up the rest
        (3, 2, False, Verdict.OK),  # a step that moved the gap of a stop too far found no path
        (30, 3, False, Verdict.OK),
    ],
)
def test_cars_whose_linear_start_or_first_stage_is_far_off_are_found(
    number: int, seed: int, weighed: bool, verdict: Verdict
) -> None:
    """Light ones that leave the ground; a van and a small car with mounts and a stop."""
    drawn = fleet_car(number, seed, facts=weighed)
    found = identify(drawn.simulate().session)
    assert found.quality.verdict is verdict
    truth = true_parameters(drawn.car)
    for name in ("m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "a", "b"):
        assert found.parameters[name].value == pytest.approx(truth[name], rel=0.03), name


# What sensors make of a path: late, filtered, on a level of their own; and its derivatives --------

HUB = Channel(
    "hub", Quantity.HUB_ACCELERATION, "m/s2", corner=Corner.FRONT_LEFT, delay_sigma_s=1e-3,
    low_pass_hz=30.0,
)  # fmt: skip
TRAVEL = Channel("travel", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.REAR_RIGHT)
GROUPS = ChannelGroup("h", (HUB,)), ChannelGroup("t", (TRAVEL,))
SIGMA = {"hub": 0.5, "travel": 1e-3}
MODEL_OF_SENSORS = Model(GreyBox(GROUPS, (BASELINE,), None, RICH), KNOTS["K3"])
TIMES = np.arange(40) / 250.0
DECAY = FreeDecay(
    "run", "baseline", 0.0, tuple(Recording(group, TIMES, np.zeros((40, 1))) for group in GROUPS)
)
FREE = ("m_s", "k_sf", "c_sr", "delay of h", "F_cf", "k_2f")


def at(**changed: float) -> Point:
    """Return the run of a car without friction whose wheels stay on the road."""
    own = replace(moving(), motion=0.3 * moving().motion)
    eta = bent(MODEL_OF_SENSORS, k_2f=0.4, y_s=0.1)
    for name, by in changed.items():
        eta[MODEL_OF_SENSORS.names.index(name.replace("_of_", " of "))] += by
    free = np.array([MODEL_OF_SENSORS.names.index(name) for name in FREE])
    none = np.full(len(eta), np.inf)
    problem = Problem(
        MODEL_OF_SENSORS, (run_of(MODEL_OF_SENSORS, DECAY, SIGMA),), np.zeros(len(eta)), none, free
    )
    found = point_at(problem, eta, (own,), POLISH)
    assert found is not None
    return found


def test_a_run_begins_early_for_sensors_that_may_be_late() -> None:
    """Four sigmas of 1 ms, and 0.4 ms for a derivative; each channel has a level of its own."""
    run = run_of(MODEL_OF_SENSORS, DECAY, SIGMA)
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
    hub, travel = found.predicted[0].residuals

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
    (block,) = at().normal.blocks
    column = len(block.A) + FREE.index(name)
    for J, after, before in zip(
        block.jacobian, up.predicted[0].residuals, down.predicted[0].residuals, strict=True
    ):
        change = -(after - before) / (2.0 * step)
        size = float(np.abs(change).max())
        np.testing.assert_allclose(J[:, :, column], change, atol=0.02 * size + 1e-6)
