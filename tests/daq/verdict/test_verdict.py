"""The verdict on simulated runs, good and spoilt."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daq.bench.campaign import Method, Step
from daq.bench.config import Bench, load_bench
from daq.runs import BASELINE, Excitation, Losses
from daq.samples.mapping import trigger_channels
from daq.samples.trigger import TriggerState, advance
from daq.sim.motion import PUSHED_S, Moving, dropped, pushed_down
from daq.vehicle import FORD_GRANADA, AddedMass
from daq.verdict.judge import judge
from daq.verdict.motion import peak_left
from daq.verdict.window import RunMeasure, RunWindow
from daq.verdict.words import WORDS
from tests.simulated.elements import named_car

from ...flow.coverage import simulated_session
from ...simulated.elements import load_car
from ..verdict_runs import (
    AFTER_S,
    LEAD_S,
    Setting,
    benches,
    confusion,
    first_failed,
    good,
    judged,
    motion,
    rejected,
    settings,
    windowed,
)

BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)
PITCH = Step(BASELINE, Excitation.PITCH, 1)
ALL = Setting("linear", "all", BOUNCE)


def test_good_runs_are_accepted() -> None:
    some = settings(("linear",))[::4]  # every bench, every bump, both mass states
    assert [finding.text for _, finding in rejected(some)] == []


def test_every_fault_gives_its_reason_first() -> None:
    table = confusion(("linear",))
    assert {code: first for code, first in table.items() if first != code} == {}


def test_findings_state_value_limit_and_advice() -> None:
    findings, _ = judged(ALL, replace(good(ALL, 1), losses=Losses(counter_gaps=1000)))
    lost = next(finding for finding in findings if finding.code == "lost_frames")
    assert not lost.passed
    assert lost.value > lost.limit
    assert "1,000 frames" in lost.text
    assert lost.advice == WORDS["lost_frames"].advice
    assert all(finding.passed and not finding.advice for finding in findings if finding != lost)
    assert {finding.code for finding in findings} <= set(WORDS)


def _held_up(window: RunWindow, lost: bool) -> RunWindow:
    """Hold the reader up for 60 ms every 100 ms; or lose what it did not read."""
    channels = {}
    for name, (t_ns, value) in window.channels.items():
        since_ns = t_ns - window.bump_ns
        held = since_ns % 100_000_000 < 60_000_000
        late_ns = np.where(held, since_ns // 100_000_000 * 100_000_000 + 60_000_000, since_ns)
        kept = ~(held & (since_ns > 0) & (since_ns < 100_000_000)) if lost else slice(None)
        channels[name] = ((late_ns + window.bump_ns)[kept], value[kept])
    return replace(window, channels=channels)


@pytest.mark.parametrize(("timed", "lost", "passed"), [(1, 0, 1), (0, 0, 0), (1, 1, 0)])
def test_late_is_not_lost_where_a_counter_tells_the_time(
    timed: bool, lost: bool, passed: bool
) -> None:
    messages = {channel.signal.partition(".")[0] for channel in ALL.described.channels}
    window = replace(good(ALL, 8), timed=frozenset(messages if timed else ()))
    findings, _ = judged(ALL, _held_up(window, lost))
    found = next(finding for finding in findings if finding.code == "lost_frames")
    assert found.passed == passed


def test_the_time_of_a_second_bump_is_reported() -> None:
    moving = motion("linear", BASELINE, Excitation.BOUNCE, 1.0, (0.84, 1.0))
    findings, _ = judged(ALL, windowed(ALL, moving, 3))
    found = next(finding for finding in findings if finding.code == "double_bump")
    assert not found.passed
    reported = float(found.text.partition("+")[2].partition(" s")[0])
    assert reported == pytest.approx(0.84, abs=0.02)


def test_a_rear_axle_that_follows_the_front_one_is_no_second_bump() -> None:
    front = good(replace(ALL, step=PITCH), 4)
    early = {n: v for n, v in front.channels.items() if n in ("hub_acc_fl", "hub_acc_fr")}
    late_ns = 1_000_000_000
    late = {
        rear: (early[name][0] + late_ns, early[name][1])
        for name, rear in (("hub_acc_fl", "hub_acc_rl"), ("hub_acc_fr", "hub_acc_rr"))
    }
    rest = {
        name: (
            np.concatenate([t - late_ns, t])[: len(t)],
            np.concatenate([v[:1000], v])[: len(v)],
        )
        for name, (t, v) in ((n, late[n]) for n in late)
    }
    setting = Setting("linear", "hubs", BOUNCE)
    findings, _ = judged(setting, RunWindow(front.bump_ns, {**early, **rest}))
    codes = {finding.code for finding in findings if not finding.passed}
    assert not codes & {"double_bump", "wrong_mode"}


@pytest.mark.parametrize(
    ("bumped", "words"),
    [
        (Excitation.PITCH, "pitch: front wheels only"),
        (Excitation.ROLL, "roll: left wheels only"),
        (Excitation.WARP, "warp: front left and rear right"),
        (Excitation.REAR_PITCH, "pitch: rear wheels only"),
    ],
)
def test_the_wrong_wheels_are_named(bumped: Excitation, words: str) -> None:
    window = good(replace(ALL, step=Step(BASELINE, bumped, 1)), 5)
    findings, _ = judged(ALL, window)
    assert first_failed(findings) == "wrong_mode"
    found = next(finding for finding in findings if finding.code == "wrong_mode")
    assert f"looks like {words}, not bounce" in found.text


@pytest.mark.parametrize("name", ["all", "IMU and travels", "body accelerations"])
def test_a_pitch_at_the_wrong_axle_is_found_where_the_campaign_has_both(name: str) -> None:
    four = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.REAR_PITCH)
    usual = benches()[name]
    both = replace(usual, campaign=replace(usual.campaign, excitations=four))
    for bumped in (Excitation.PITCH, Excitation.REAR_PITCH):
        window = good(Setting("anti-roll bars", name, Step(BASELINE, bumped, 1)), 7)
        for due in (Excitation.PITCH, Excitation.REAR_PITCH):
            found = {
                bench is both: first_failed(judge(bench, Step(BASELINE, due, 1), window, ())[0])
                for bench in (usual, both)
            }
            wrong = "" if due is bumped else "wrong_mode"
            assert found[True] == wrong
            # The usual campaign takes a pitch at either axle for one.
            assert found[False] == (wrong if due is Excitation.REAR_PITCH else "")


def test_frequency_and_damping_are_those_of_the_pitch_mode() -> None:
    findings, _ = judged(replace(ALL, step=PITCH), good(replace(ALL, step=PITCH), 6))
    # docs/method.md, "The vehicle": the lowest mode of the car without weights is at 1.0511 Hz.
    assert findings[-1].value == pytest.approx(1.0511, rel=0.03)
    damping = float(findings[-1].text.partition("zeta ")[2][:4])
    assert 0.2 < damping < 0.3


@pytest.mark.parametrize("spoilt", ["none", "nan", "one sample", "no rest"])
def test_whatever_is_missing_is_a_finding_and_no_error(spoilt: str) -> None:
    window = good(ALL, 7)
    channels = {
        "none": {},
        "nan": {n: (t, np.full(len(t), np.nan)) for n, (t, _) in window.channels.items()},
        "one sample": {n: (t[:1], v[:1]) for n, (t, v) in window.channels.items()},
        "no rest": {
            n: (t[t > window.bump_ns], v[t > window.bump_ns])
            for n, (t, v) in window.channels.items()
        },
    }[spoilt]
    findings, measure = judged(ALL, replace(window, channels=channels), [RunMeasure()])
    assert first_failed(findings) == "stale"
    assert "no_data" in {finding.code for finding in findings}
    assert measure == RunMeasure()


@pytest.mark.parametrize("bench", ["all", "IMU and travels"])
def test_no_silence_of_any_channel_is_an_error(bench: str) -> None:
    setting = Setting("linear", bench, BOUNCE)
    window = good(setting, 11)
    every, half = set(window.channels), set(list(window.channels)[::2])
    spans_s = ((-1.0, 0.0), (0.0, 0.4), (0.3, 2.6))
    for chosen, span_s in itertools.product((every, half), spans_s):
        low, high = (window.bump_ns + round(x * 1e9) for x in span_s)
        channels = {
            name: (t, np.where((t >= low) & (t < high) & (name in chosen), np.nan, v))
            for name, (t, v) in window.channels.items()
        }
        findings, _ = judged(
            setting, replace(window, channels=channels), [judged(setting, window)[1]]
        )
        assert first_failed(findings) in ("stale", "lost_frames")


def test_the_motion_left_falls_from_one_to_nothing() -> None:
    window = good(ALL, 10)
    bench = benches()["all"]

    def left(after_s: float) -> float | None:
        now_ns = window.bump_ns + round(after_s * 1e9)
        so_far = {n: (t[t <= now_ns], v[t <= now_ns]) for n, (t, v) in window.channels.items()}
        return peak_left(bench.channels, window.bump_ns, so_far, now_ns)

    shares = [left(after_s) for after_s in (0.5, 1.0, 1.5, 2.4)]
    assert all(share is not None for share in shares)
    assert shares == sorted(shares, key=lambda share: -(share or 0.0))
    assert (shares[0] or 0.0) > 0.4
    assert (shares[-1] or 1.0) < 0.05
    assert peak_left(bench.channels, window.bump_ns, {}, window.bump_ns) is None


PLANT = load_car(FORD_GRANADA, AddedMass())
END_S = LEAD_S + AFTER_S
DROPS = [(Method.DROP, kind) for kind in (Excitation.ROLL, Excitation.REAR_PITCH)]
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


@pytest.mark.parametrize(("method", "done"), [(Method.DROP, Excitation.PITCH), PUSHES[1]])
def test_another_kind_than_the_one_that_is_due_is_named(method: Method, done: Excitation) -> None:
    bench = _bench("all", method)
    step = Step(BASELINE, Excitation.ROLL, 1)
    findings, _ = judge(
        bench, step, windowed(Setting("linear", "all", step), _motion(method, done), 2), ()
    )
    assert first_failed(findings) == "wrong_mode"


def test_runs_of_a_car_with_leaf_springs_are_accepted_although_friction_holds_it() -> None:
    """After a roll it rests a sixth of the peak from where it was; nothing else is unusual."""
    bench = load_bench(None)
    roll = replace(bench.campaign, excitations=(Excitation.ROLL,), repeats=1)
    bench = replace(bench, campaign=replace(roll, mass_states=(BASELINE,)))
    (run,) = simulated_session(bench, 1, named_car("cherokee")).runs
    samples = {
        name: (run.t0_ns + (group.time_s * 1e9).astype("i8"), value)
        for group in run.groups
        for name, value in group.values.items()
    }
    window = RunWindow(run.t0_ns + round(bench.trigger.pre_s * 1e9), samples)
    findings, _ = judge(bench, Step(BASELINE, Excitation.ROLL, 1), window, ())
    assert [f.text for f in findings if not f.passed] == []
    (rest,) = [f for f in findings if f.code == "rest_changed"]
    assert 0.75 < rest.value / rest.limit < 1.0
