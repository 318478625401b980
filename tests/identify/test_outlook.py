"""Steps that the planner offers, and what a plan is expected to leave."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
)
from identify.fit.grey_box import GreyBox
from identify.fit.uncertainty import Estimate
from identify.model.response import Bump
from identify.plan.design import Plan, Runs, Sensor, campaigns, candidates, sensor
from identify.plan.outlook import Fisher, KnownRuns, Outlook, expected, vague

from .nonlinear.truth import BASELINE as BARE_STATE
from .nonlinear.truth import granada

BARE = MassState(BASELINE)
A, B = FORD_GRANADA.a, FORD_GRANADA.b
ROLL, PITCH, BOUNCE = Excitation.ROLL, Excitation.PITCH, Excitation.BOUNCE
IMU = (
    Channel("z", Quantity.BODY_ACCELERATION, at_cg=True),
    Channel("p", Quantity.PITCH_RATE),
    Channel("r", Quantity.ROLL_RATE),
)


def sensors_of(channels: Iterable[Channel], rate_hz: float) -> tuple[Sensor, ...]:
    return tuple(sensor(channel, rate_hz) for channel in channels)


def plan(*states: MassState, runs: tuple[Runs, ...] = (), **others: Any) -> Plan:
    every = states or (BARE,)
    done = runs or tuple(Runs(s.name, k) for s in every for k in (ROLL, PITCH))
    made = Plan(FORD_GRANADA.to_array(), sensors_of(IMU, 200.0), every, done)
    return replace(made, **others)


def offered(given: Plan) -> dict[str, Plan]:
    found = candidates(given)
    assert len({one.action for one in found}) == len(found)
    return {one.action: one.plan for one in found}


def loaded(*weights: BodyWeight | HubWeight) -> MassState:
    return MassState(ADDED, AddedMass(weights))


def test_one_run_of_each_kind_is_offered_in_each_state() -> None:
    given = plan(BARE, loaded(HubWeight(1.0, Corner.FRONT_LEFT)), runs=(Runs(BASELINE, ROLL),))
    found = offered(given)
    assert [a for a in found if " run in mass state " in a] == [
        f"one {kind} run in mass state {state}"
        for state, kinds in (
            ("baseline", ("bounce", "pitch", "more roll", "warp", "rear pitch")),
            ("added", ("bounce", "pitch", "roll", "warp", "rear pitch")),
        )
        for kind in kinds
    ]
    more = found["one rear pitch run in mass state added"]
    assert more.runs == (Runs(BASELINE, ROLL), Runs(ADDED, Excitation.REAR_PITCH))


@pytest.mark.parametrize(
    ("rates_hz", "action", "after_hz"),
    [
        ((100.0, 300.0, 2000.0), "200", (200.0, 600.0, 2000.0)),
        ((600.0, 600.0, 600.0), "1000", (1000.0, 1000.0, 1000.0)),
        ((999.0, 1000.0, 1000.0), "1000", (1000.0, 1000.0, 1000.0)),
        ((1000.0, 1000.0, 1000.0), None, ()),
    ],
)
def test_slow_sensors_are_offered_twice_their_rate_up_to_1000_hz(
    rates_hz: tuple[float, ...], action: str | None, after_hz: tuple[float, ...]
) -> None:
    sensors = zip(plan().sensors, rates_hz, strict=True)
    given = plan(sensors=tuple(replace(s, rate_hz=rate) for s, rate in sensors))
    found = [(a, p) for a, p in offered(given).items() if " Hz " in a]
    if action is None:
        assert found == []
    else:
        ((words, after),) = found
        assert words == f"sample at {action} Hz or more, if a sample is then no noisier"
        assert tuple(s.rate_hz for s in after.sensors) == after_hz


def test_missing_sensors_are_offered_where_they_are_missing() -> None:
    hub = Channel("h", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_RIGHT, gain_sigma=0.02)
    given = plan(sensors=(*sensors_of((hub, IMU[0]), 100.0), *sensors_of(IMU[1:2], 400.0)))
    found = {a: p.sensors[3:] for a, p in offered(given).items() if len(p.sensors) > 3}
    assert list(found) == [
        "an accelerometer on the hub at FL, RL, RR",
        "a travel sensor on the suspension at FL, FR, RL, RR",
        "accelerometers on the body above the four wheels",
        "a gyro for the roll rate of the body",
    ]
    new = found["an accelerometer on the hub at FL, RL, RR"]
    assert [(s.channel.corner, s.rate_hz, s.noise) for s in new] == [
        (Corner.FRONT_LEFT, 400.0, 0.15), (Corner.REAR_LEFT, 400.0, 0.15),
        (Corner.REAR_RIGHT, 400.0, 0.15),
    ]  # fmt: skip
    body = found["accelerometers on the body above the four wheels"]
    assert [s.channel.x_m for s in body] == pytest.approx([0.0, 0.0, -A - B, -A - B])
    t_f, t_r = FORD_GRANADA.t_f, FORD_GRANADA.t_r
    assert [s.channel.y_m for s in body] == pytest.approx([t_f, -t_f, t_r, -t_r])
    assert {s.channel.gain_sigma for more in found.values() for s in more} == {0.02}
    (gyro,) = found["a gyro for the roll rate of the body"]
    assert gyro.channel.quantity is Quantity.ROLL_RATE
    assert gyro.noise == pytest.approx(0.001745, rel=1e-3)  # a tenth of a degree


def weights(given: Plan, action: str) -> tuple[BodyWeight | HubWeight, ...]:
    after = offered(given)[action]
    assert after.runs[: len(given.runs)] == given.runs
    (state,) = (one for one in after.mass_states if one.name == ADDED)
    return state.added.weights


HUBS = tuple(HubWeight(5.0, corner) for corner in Corner)
FLOOR = (
    BodyWeight(30.0, 0.0, FORD_GRANADA.t_f), BodyWeight(30.0, 0.0, -FORD_GRANADA.t_f),
    BodyWeight(30.0, -A - B, FORD_GRANADA.t_r), BodyWeight(30.0, -A - B, -FORD_GRANADA.t_r),
)  # fmt: skip


@pytest.mark.parametrize(
    "state",
    [
        loaded(BodyWeight(50.0, -1.0, -0.5, 0.1, 0.2), HubWeight(2.0, Corner.FRONT_LEFT)),
        MassState(ADDED, AddedMass((), np.eye(7))),
    ],
)
def test_more_weights_are_offered_on_hubs_and_floor(state: MassState) -> None:
    given, already = plan(BARE, state), state.added.weights
    where = " in mass state added"
    assert weights(given, f"5 kg more on every hub{where}") == (*already, *HUBS)
    floor = f"30 kg more on the floor near each wheel{where}"
    assert weights(given, floor) == (*already, *FLOOR)
    after = offered(given)[floor].mass_states[1].added.matrix
    np.testing.assert_array_equal(after, state.added.matrix)
    # Weights without a run: the run comes first.
    bare_runs = replace(given, runs=(Runs(BASELINE, ROLL),))
    assert not any(" more on " in action for action in offered(bare_runs))


TOTAL, FRONT, REAR = FactQuantity.TOTAL_MASS, FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE
CORNERS = (FactQuantity.CORNER_FL, FactQuantity.CORNER_FR, FactQuantity.CORNER_RL)
VEHICLE = ("weigh the vehicle to 1 kg", [TOTAL])
EACH_AXLE = ("weigh each axle to 1 kg", [FRONT, REAR])


@pytest.mark.parametrize(
    ("known", "offers"),
    [
        ((), [VEHICLE, EACH_AXLE]),
        ((TOTAL,), [EACH_AXLE]),
        ((FRONT,), [VEHICLE, EACH_AXLE]),
        ((FRONT, REAR), []),
        ((TOTAL, REAR), []),
        ((*CORNERS, FactQuantity.CORNER_RR), []),
        (CORNERS, [VEHICLE, EACH_AXLE]),
    ],
)
def test_scales_are_offered_until_both_axles_are_known(
    known: tuple[FactQuantity, ...], offers: list[tuple[str, list[FactQuantity]]]
) -> None:
    given = plan(facts=tuple(Fact(quantity, 1.0, 2.0) for quantity in known))
    found = {a: p.facts[len(known) :] for a, p in offered(given).items() if a.startswith("weigh ")}
    assert [(a, [f.quantity for f in facts]) for a, facts in found.items()] == offers
    assert all(fact.sigma == 1.0 for facts in found.values() for fact in facts)


def test_a_tape_is_offered_for_the_lengths_that_are_not_known() -> None:
    base, front, rear = FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK
    after = offered(plan())["measure wheelbase, front track, rear track by tape to 3 mm"]
    assert [(f.quantity, f.sigma) for f in after.facts] == [(q, 0.003) for q in (base, front, rear)]
    given = plan(facts=(Fact(front, 1.5, 0.01),))
    assert "measure wheelbase, rear track by tape to 3 mm" in offered(given)
    measured = plan(geometry=FORD_GRANADA.geometry)
    assert not any("tape" in action for action in offered(measured))


def test_whole_campaigns_hold_each_kind_once() -> None:
    weight = loaded(HubWeight(2.0, Corner.REAR_LEFT))
    scales = Fact(TOTAL, 1700.0, 0.5)
    given = plan(
        weight, BARE, facts=(scales,),
        runs=(Runs(BASELINE, ROLL, 3), Runs(ADDED, ROLL), Runs(BASELINE, Excitation.WARP)),
    )  # fmt: skip
    found = {one.action: one.plan for one in campaigns(given)}
    assert list(found) == [
        "roll, warp once, no weights, axles weighed to 1 kg",
        "roll, warp once, no weights, axles weighed to 1 kg, wheelbase and tracks by tape",
        "roll, warp once in each mass state, bumps of 50 mm",
    ]
    bare, taped, both = found.values()
    assert bare.mass_states == (BARE,)
    assert [(r.mass_state, r.excitation, r.repeats) for r in bare.runs] == [
        (BASELINE, ROLL, 1), (BASELINE, Excitation.WARP, 1),
    ]  # fmt: skip
    assert [(f.quantity, f.sigma) for f in bare.facts] == [(TOTAL, 0.5), (FRONT, 1.0), (REAR, 1.0)]
    assert [f.sigma for f in taped.facts[3:]] == [0.003] * 3
    assert [r.mass_state for r in both.runs] == [BASELINE, BASELINE, ADDED, ADDED]
    assert {one.bump.height_m for one in found.values()} == {0.05}
    assert both.facts == (scales,)


# What a plan is expected to leave, from information that was made up ------------------------------

BOX = GreyBox((), (BARE_STATE,), None)
N = len(BOX.parameters)
TRUTH = FORD_GRANADA.to_array()


def fisher(information: NDArray[np.float64], box: GreyBox = BOX) -> Fisher:
    return Fisher(box, box.unknowns_of(granada(box.structure)), information)


def looked(std: NDArray[np.float64]) -> Outlook:
    """Return what is expected of independent parameters of these relative deviations."""
    return expected(fisher(np.diag(std**-2.0)))


def test_an_interval_has_196_standard_deviations_on_either_side() -> None:
    std = np.linspace(0.01, 0.024, N)
    found = looked(std)
    for name, relative, truth in zip(BOX.parameters, std, TRUTH, strict=True):
        e = found.parameters[name]
        assert [e.value, e.std] == pytest.approx([truth, relative * truth])
        assert e.high - e.low == pytest.approx(2 * 1.96 * relative * truth, rel=1e-4)
        assert e.low + e.high == pytest.approx(2 * truth)
        assert found.relative[name] == pytest.approx(1.96 * relative, rel=1e-4)
    assert found.worst == pytest.approx(1.96 * 0.024, rel=1e-4)
    assert found.mean == pytest.approx(1.96 * 0.017, rel=1e-4)
    assert (found.undetermined, found.reasons, found.open_directions) == ((), (), 0)
    assert found.parameters["m_s"].unit == "kg"


@pytest.mark.parametrize(("std", "lost"), [(0.249, False), (0.251, True)])
def test_a_quarter_is_not_determined_and_does_not_count_in_the_mean(std: float, lost: bool) -> None:
    each = np.full(N, 0.02)
    each[BOX.parameters.index("I_xx")] = std
    found = looked(each)
    assert found.undetermined == (("I_xx",) if lost else ())
    assert np.isinf(found.parameters["I_xx"].std) == lost
    assert np.isinf(found.relative["I_xx"]) == lost
    assert found.worst == pytest.approx(1.96 * (0.02 if lost else std), rel=1e-4)
    assert found.mean == pytest.approx(1.96 * (0.02 if lost else 0.02 + (std - 0.02) / N), rel=1e-4)
    assert ("depends noticeably on I_xx" in " ".join(found.reasons)) == lost
    assert found.open_directions == 0


def scaled() -> NDArray[np.float64]:
    """Return the direction of all masses, springs and dampers larger by one factor."""
    return np.array([1.0 if name[0] in "mIkc" else 0.0 for name in BOX.parameters])


@pytest.mark.parametrize(("information", "known"), [(17.0, True), (15.0, False)])
def test_a_scale_that_nothing_fixes_is_said_once(information: float, known: bool) -> None:
    """Ratios to a per mille; the common factor to 1 / sqrt(information): a quarter is 16."""
    v = scaled()
    away = np.eye(N) - np.outer(v, v) / (v @ v)
    found = expected(fisher(1e6 * away + information / (v @ v) ** 2 * np.outer(v, v)))
    assert found.undetermined == (() if known else tuple(np.array(BOX.parameters)[v > 0.0]))
    assert [text for text in found.reasons if "fixes the scale" in text] == list(found.reasons)
    assert len(found.reasons) == (0 if known else 1)


def test_parameters_that_only_trade_with_each_other_are_named_as_such() -> None:
    """The sum of two is known to a per mille, their difference to a half."""
    H = np.diag(np.full(N, 1e6))
    i, j = BOX.parameters.index("a"), BOX.parameters.index("t_f")
    H[i, i] = H[j, j] = (1e6 + 4.0) / 2.0
    H[i, j] = H[j, i] = (1e6 - 4.0) / 2.0
    found = expected(fisher(H))
    assert found.undetermined == ("a", "t_f")
    (text,) = found.reasons
    assert "does not separate a, t_f" in text


def test_what_may_be_zero_is_determined_to_its_unit() -> None:
    """Bars count in units of 10 kN/m."""
    box = GreyBox((), (BARE_STATE,), None, Structure(anti_roll_bars=True))
    n = len(box.parameters)
    for std, lost in ((0.99, ()), (1.01, ("k_af",))):
        each = np.full(n, 0.02)
        each[box.parameters.index("k_af")] = std
        found = expected(fisher(np.diag(each**-2.0), box))
        assert found.undetermined == lost
        assert "k_af" not in found.relative
        assert found.parameters["k_ar"].std == pytest.approx(200.0)
        assert found.parameters["k_ar"].value == pytest.approx(5e3)


@pytest.mark.parametrize(("std", "names"), [(24.9, ()), (25.1, ("k",))])
def test_a_value_that_is_known_to_a_quarter_can_be_planned_with(
    std: float, names: tuple[str, ...]
) -> None:
    found = {"k": Estimate(-100.0, std, 0.0, 0.0, ""), "k_af": Estimate(0.0, 1e9, 0.0, 0.0, "")}
    assert vague(found) == names


# Runs are computed once for several plans, and anew for whatever they depend on ------------------

SENSORS = (
    Channel("z", Quantity.BODY_ACCELERATION, at_cg=True),
    Channel("p", Quantity.PITCH_RATE),
    Channel("r", Quantity.ROLL_RATE),
    *(Channel(f"h{c}", Quantity.HUB_ACCELERATION, corner=c) for c in Corner),
)


def states(*, mass_kg: float = 5.0, sigma_kg: float = 0.0) -> tuple[MassState, ...]:
    weights = (BodyWeight(60.0, -1.0, 0.4), HubWeight(mass_kg, Corner.REAR_LEFT, sigma_kg))
    return MassState(BASELINE), MassState(ADDED, AddedMass(weights))


BASE = Plan(
    FORD_GRANADA.to_array(),
    sensors_of(SENSORS, 100.0),
    states(),
    tuple(Runs(state, kind) for state in (BASELINE, ADDED) for kind in (PITCH, ROLL)),
    Bump(0.05, 0.1, 0.2),
    1.0,
)
CHANGES: dict[str, Callable[[Plan], Plan]] = {
    "vehicle": lambda p: replace(p, vehicle=1.1 * FORD_GRANADA.to_array()),
    "rate": lambda p: replace(p, sensors=sensors_of(SENSORS, 150.0)),
    "noise": lambda p: replace(
        p, sensors=tuple(replace(s, noise=0.7 * s.noise) for s in p.sensors)
    ),
    "geometry": lambda p: replace(p, geometry=FORD_GRANADA.geometry),
    "structure": lambda p: replace(p, structure=Structure(anti_roll_bars=True)),
    "corner loads": lambda p: replace(p, facts=(Fact(FactQuantity.CORNER_FL, 400.0, 1.0),)),
    "a weight": lambda p: replace(p, mass_states=states(mass_kg=8.0)),
    "its uncertainty": lambda p: replace(p, mass_states=states(sigma_kg=0.1)),
    "duration of the bump": lambda p: replace(p, bump=Bump(0.05, 0.1, 0.25)),
    "height of the bump": lambda p: replace(p, bump=Bump(0.03, 0.1, 0.2)),
    "length of the decay": lambda p: replace(p, decay_s=1.5),
    "repeats": lambda p: replace(p, runs=(*p.runs, Runs(ADDED, Excitation.ROLL, 3))),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_is_known_of_other_runs_changes_no_answer(what: str) -> None:
    known = KnownRuns()
    first = known.fisher(BASE).information
    changed = CHANGES[what](BASE)
    found, fresh = known.fisher(changed), KnownRuns().fisher(changed)
    assert found.information == pytest.approx(fresh.information, rel=1e-9, abs=1e-9)
    again = known.fisher(BASE).information
    assert again == pytest.approx(first, rel=1e-12)
    if found.information.shape == first.shape:
        assert not np.allclose(found.information, first, rtol=1e-3)
