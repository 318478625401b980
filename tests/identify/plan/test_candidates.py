"""Steps and campaigns that the planner offers: their words, and the plan that each makes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

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
)
from identify.model.response import Bump
from identify.plan import Plan, Runs, sensors_of
from identify.plan.design import campaigns, candidates

BARE = MassState(BASELINE)
A, B = FORD_GRANADA.a, FORD_GRANADA.b
ROLL, PITCH, BOUNCE = Excitation.ROLL, Excitation.PITCH, Excitation.BOUNCE
IMU = (
    Channel("z", Quantity.BODY_ACCELERATION, at_cg=True),
    Channel("p", Quantity.PITCH_RATE),
    Channel("r", Quantity.ROLL_RATE),
)


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
    ("now_m", "heights"),
    [
        (
            0.01,
            {"a bump of 20 mm instead of 10 mm": 0.02, "a bump of 50 mm instead of 10 mm": 0.05},
        ),
        (0.025, {"a bump of 50 mm instead of 25 mm": 0.05}),
        (0.04, {"a bump of 50 mm instead of 40 mm": 0.05}),
        (0.05, {}),
        (0.06, {}),
    ],
)
def test_a_bump_of_twice_the_height_and_the_highest_are_offered(
    now_m: float, heights: dict[str, float]
) -> None:
    found = {a: p for a, p in offered(plan(bump=Bump(now_m, 0.2))).items() if "bump of" in a}
    assert {action: one.bump.height_m for action, one in found.items()} == heights
    assert all(one.bump.duration_s == 0.2 for one in found.values())


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


def test_weights_on_the_body_are_offered_twice_as_heavy_or_on_one_side() -> None:
    body, hub = BodyWeight(50.0, -1.0, -0.5, 0.1, 0.2), HubWeight(2.0, Corner.FRONT_LEFT)
    given = plan(BARE, loaded(body, hub))
    where = " in mass state added"
    assert weights(given, f"5 kg more on every hub{where}") == (body, hub, *HUBS)
    assert weights(given, f"the weights on the body twice as heavy{where}") == (
        hub, replace(body, mass_kg=100.0),
    )  # fmt: skip
    left = f"the weights on the body all on the left side{where}"
    assert weights(given, left) == (hub, replace(body, y_m=0.5))
    assert left not in offered(plan(BARE, loaded(replace(body, y_m=0.5))))
    assert not any("floor" in action for action in offered(given))


@pytest.mark.parametrize(
    "state",
    [loaded(HubWeight(2.0, Corner.REAR_LEFT)), MassState(ADDED, AddedMass((), np.eye(7)))],
)
def test_weights_on_the_floor_are_offered_where_the_body_has_none(state: MassState) -> None:
    given, own = plan(BARE, state), state.added.weights
    where = " in mass state added"
    assert weights(given, f"30 kg on the floor near each wheel{where}") == (*own, *FLOOR)
    near = f"30 kg on the floor near the left rear wheel{where}"
    assert weights(given, near) == (*own, FLOOR[2])
    after = offered(given)[near].mass_states[1].added.matrix
    np.testing.assert_array_equal(after, state.added.matrix)


TOTAL, FRONT, REAR = FactQuantity.TOTAL_MASS, FactQuantity.FRONT_AXLE, FactQuantity.REAR_AXLE
CORNERS = (FactQuantity.CORNER_FL, FactQuantity.CORNER_FR, FactQuantity.CORNER_RL)


@pytest.mark.parametrize(
    ("known", "offers"),
    [
        ((), [("weigh the vehicle to 1 kg", [TOTAL]), ("weigh each axle to 1 kg", [FRONT, REAR])]),
        ((TOTAL,), [("weigh each axle to 1 kg", [FRONT, REAR])]),
        (
            (FRONT,),
            [("weigh the vehicle to 1 kg", [TOTAL]), ("weigh each axle to 1 kg", [FRONT, REAR])],
        ),
        ((FRONT, REAR), []),
        ((TOTAL, REAR), []),
        ((*CORNERS, FactQuantity.CORNER_RR), []),
        (
            CORNERS,
            [("weigh the vehicle to 1 kg", [TOTAL]), ("weigh each axle to 1 kg", [FRONT, REAR])],
        ),
    ],
)
def test_scales_are_offered_until_both_axles_are_known(
    known: tuple[FactQuantity, ...], offers: list[tuple[str, list[FactQuantity]]]
) -> None:
    given = plan(facts=tuple(Fact(quantity, 1.0, 2.0) for quantity in known))
    found = [
        (a, [f.quantity for f in p.facts[len(known) :]])
        for a, p in offered(given).items()
        if a.startswith("weigh ")
    ]
    assert found == offers
    for action, after in offered(given).items():
        if action.startswith("weigh "):
            assert all(fact.sigma == 1.0 for fact in after.facts[len(known) :])


def test_a_tape_is_offered_for_the_lengths_that_are_not_known() -> None:
    base, front, rear = (
        FactQuantity.WHEELBASE, FactQuantity.FRONT_TRACK, FactQuantity.REAR_TRACK,
    )  # fmt: skip
    after = offered(plan())["measure wheelbase, front track, rear track by tape to 3 mm"]
    assert [(f.quantity, f.sigma) for f in after.facts] == [
        (base, 0.003), (front, 0.003), (rear, 0.003),
    ]  # fmt: skip
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
        "roll, warp once in each mass state, bumps of 30 mm",
        "roll, warp once in each mass state, bumps of 50 mm",
        "roll, warp, rear pitch once in each mass state, bumps of 50 mm",
    ]
    bare, taped, low, high, more = found.values()
    assert bare.mass_states == (BARE,)
    assert [(r.mass_state, r.excitation, r.repeats, r.height_m) for r in bare.runs] == [
        (BASELINE, ROLL, 1, 0.05), (BASELINE, Excitation.WARP, 1, 0.05),
    ]  # fmt: skip
    assert [(f.quantity, f.sigma) for f in bare.facts] == [(TOTAL, 0.5), (FRONT, 1.0), (REAR, 1.0)]
    assert [f.sigma for f in taped.facts[3:]] == [0.002, 0.004, 0.004]
    assert [state.name for state in low.mass_states] == [BASELINE, ADDED]
    assert [(r.mass_state, r.height_m) for r in low.runs] == [
        (BASELINE, 0.03), (BASELINE, 0.03), (ADDED, 0.03), (ADDED, 0.03),
    ]  # fmt: skip
    assert {r.height_m for r in high.runs} == {r.height_m for r in more.runs} == {0.05}
    assert len(more.runs) == 6
    assert low.facts == more.facts == (scales,)
