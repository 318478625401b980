"""Bumps that are let go, simulated from forces: drops off blocks and pushes by hand."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daq.bench.campaign import Method, Step
from daq.bench.config import Bench
from daq.runs import BASELINE, Excitation
from daq.samples.trigger import TriggerState, advance, trigger_channels
from daq.sim.motion import PUSHED_S, Moving, dropped, pushed_down
from daq.sim.plant import load_car
from daq.vehicle import FORD_GRANADA, AddedMass
from daq.verdict import judge

from ..verdict_runs import LEAD_S, Setting, benches, first_failed, windowed

PLANT = load_car(FORD_GRANADA, AddedMass())
END_S = LEAD_S + 5.0
DROPS = [(Method.DROP, kind) for kind in Excitation]
PUSHES = [(Method.PUSH, kind) for kind in (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)]
"""A tail that is pushed hardly moves the accelerometer of this bench, which is ahead of the middle:
the push triggers when it lets go, as the manual says."""


@cache
def _motion(method: Method, kind: Excitation) -> Moving:
    if method is Method.DROP:
        return dropped(PLANT, kind, 0.04, LEAD_S, END_S)
    return pushed_down(PLANT, kind, 0.04, LEAD_S, END_S)


def _bench(name: str, method: Method) -> Bench:
    bench = benches()[name]
    level = 3.0 if method is Method.DROP and name != "IMU and travels" else 0.4
    return replace(
        bench,
        campaign=replace(bench.campaign, method=method),
        trigger=bench.trigger.model_copy(update={"level": level}),
    )


@pytest.mark.parametrize("name", ["all", "IMU and travels"])
@pytest.mark.parametrize(("method", "kind"), [*DROPS, *PUSHES])
def test_a_release_triggers_and_is_taken_for_what_it_is(
    method: Method, kind: Excitation, name: str
) -> None:
    bench = _bench(name, method)
    step = Step(BASELINE, kind, 1)
    window = windowed(Setting("linear", name, step), _motion(method, kind), 1)
    block = {c.name: window.channels[c.name] for c in trigger_channels(bench.channels, method)}
    _, events = advance(bench.trigger, TriggerState(), block)
    (bump_ns,) = (event.t_ns for event in events if event.code == "bump")
    latest_s = PUSHED_S if method is Method.PUSH else 0.01
    assert -0.01 < (bump_ns - window.bump_ns) * 1e-9 < latest_s
    findings, _ = judge(bench, step, replace(window, bump_ns=bump_ns), ())
    assert first_failed(findings) == "", [f.text for f in findings if not f.passed]
    assert "mirrored" not in {finding.code for finding in findings}


@pytest.mark.parametrize(("method", "done"), [(Method.DROP, Excitation.PITCH), PUSHES[1]])
def test_another_kind_than_the_one_that_is_due_is_named(method: Method, done: Excitation) -> None:
    bench = _bench("all", method)
    step = Step(BASELINE, Excitation.ROLL, 1)
    findings, _ = judge(
        bench, step, windowed(Setting("linear", "all", step), _motion(method, done), 2), ()
    )
    assert first_failed(findings) == "wrong_mode"


def test_a_push_begins_gently_and_lets_go_at_once() -> None:
    push = pushed_down(PLANT, Excitation.BOUNCE, 0.04, 1.0, 4.0)
    go_s = 1.0 + PUSHED_S
    rest, held, after = (push.at(np.array([t])) for t in (0.5, go_s - 1e-6, go_s + 1e-6))
    assert held.pose[0, 0] - rest.pose[0, 0] == pytest.approx(-0.04)
    assert np.all(held.acceleration == 0.0)
    assert after.acceleration[0, 0] > 1.0
    with pytest.raises(ValueError, match="cannot make a warp"):
        pushed_down(PLANT, Excitation.WARP, 0.04, 1.0, 4.0)


def test_a_car_on_blocks_is_in_balance_and_falls_off_them() -> None:
    drop = dropped(PLANT, Excitation.PITCH, 0.04, 1.0, 4.0)
    held, after = drop.at(np.array([0.9])), drop.at(np.array([1.0 + 1e-6]))
    rise = held.pose - drop.decay.at(np.array([3.9])).pose
    assert rise[3:, 0] == pytest.approx([0.04, 0.04, 0.0, 0.0], abs=2e-3)
    assert np.all(after.acceleration[3:5, 0] < -50.0)  # the springs press the wheels down
