"""The verdict on simulated runs: good ones on many benches, and spoilt ones.

The runs are sampled from the simulated car's motion without a bus: the truth is the force balance.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Method, Step
from daq.bench.config import Bench, load_bench
from daq.channels import Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation, Losses
from daq.samples.mapping import trigger_channels
from daq.samples.trigger import TriggerState, advance
from daq.sim.car import NOISE, SensorTruth, measured, true_reading
from daq.sim.motion import PUSHED_S, Bump, Kinematics, Moving, Spliced, dropped, pushed_down
from daq.vehicle import FORD_GRANADA, AddedMass
from daq.verdict.checks import remaining_ratio
from daq.verdict.judge import judge
from daq.verdict.window import RunMeasure, RunWindow
from daq.verdict.words import WORDS
from dbc.words import Finding
from tests.simulated.elements import named_car

from ...flow.coverage import simulated_session
from ...simulated.elements import NONE, Imperfections, load_car
from ...simulated.engine import drive

START_NS = 1_800_000_000_000_000_000
LEAD_S, AFTER_S = 1.3, 2.8
"""Time that is simulated before and after the beginning of a bump, s."""
HEIGHT_M = 0.05
CARS: Mapping[str, Imperfections] = {
    "linear": NONE,
    "anti-roll bars": Imperfections(bar_front_n_m=20e3, bar_rear_n_m=12e3),
}


def _points() -> tuple[Channel, ...]:
    places = {"fl": (0.2, 0.6), "fr": (0.2, -0.6), "rl": (-2.6, 0.5), "rr": (-2.6, -0.5)}
    return tuple(
        Channel(f"body_{n}", Quantity.BODY_ACCELERATION, "m/s2", f"B_{n}.a", x_m=x, y_m=y)
        for n, (x, y) in places.items()
    )


def _shipped(*starts: str) -> tuple[Channel, ...]:
    used = (c for c in load_bench(None).channels if c.quantity is not Quantity.UNUSED)
    return tuple(c for c in used if c.name.startswith(starts))


@cache
def benches() -> Mapping[str, Bench]:
    """Return the shipped bench with all and with some of its sensors."""
    hubs, imu, travels = _shipped("hub"), _shipped("body", "roll", "pitch"), _shipped("travel")
    sets = {
        "all": hubs + imu + travels,
        "hubs": hubs,
        "hubs and IMU": hubs + imu,
        "IMU": imu,
        "IMU and travels": imu + travels,
        "body accelerations": _points(),
        "hubs, two travels": hubs + travels[:2],
    }
    bench = load_bench(None)
    low = bench.trigger.model_copy(update={"level": 0.4})
    return {
        name: replace(
            bench, channels=channels, trigger=bench.trigger if hubs[0] in channels else low
        )
        for name, channels in sets.items()
    }


@dataclass(frozen=True, slots=True)
class Setting:
    """A car, a bench and a bump that is due."""

    car: str
    bench: str
    step: Step

    @property
    def described(self) -> Bench:
        return benches()[self.bench]


@cache
def motion(
    car: str,
    state: str,
    excitation: Excitation,
    height: float = 1.0,
    again: tuple[float, float] | None = None,
) -> Moving:
    """Drive a car over a bump of `height` times the usual, and over another (delay s, height)."""
    states = {s.name: s.added for s in load_bench(None).mass_states}
    plant = load_car(FORD_GRANADA, states[state], CARS[car])
    first = plant.drive(Bump(excitation, height * HEIGHT_M, LEAD_S, 0.2), LEAD_S + AFTER_S)
    if again is None:
        return first
    delay_s, size = again
    begin_s = LEAD_S + delay_s
    second = Bump(excitation, size * HEIGHT_M, begin_s, 0.2)
    before = first.states(np.array([begin_s]))
    return Spliced(first, drive(plant, second, begin_s + AFTER_S, before), begin_s)


def windowed(
    setting: Setting,
    moving: Moving,
    seed: int,
    begin_s: float = LEAD_S,
    limit: Mapping[str, float] | None = None,
) -> RunWindow:
    """Sample a motion and cut the run whose bump begins at `begin_s`."""
    bench = setting.described
    unloaded = load_car(FORD_GRANADA, load_bench(None).mass_states[0].added)
    rng = np.random.default_rng([seed, 5])
    phase: dict[str, float] = {}
    seen: dict[str, Kinematics] = {}
    channels = {}
    for channel in bench.channels:
        message = channel.signal.partition(".")[0]
        rate_hz = 1000.0 if channel.quantity is Quantity.HUB_ACCELERATION else 500.0
        offset = phase.setdefault(message, rng.uniform())
        t_s = begin_s - 1.2 + (np.arange(round(3.9 * rate_hz)) + offset) / rate_hz
        sensor = SensorTruth(
            channel.x_m,
            channel.y_m,
            0.002,
            0.3 * rng.standard_normal() * _bias(channel),
            limit=(limit or {}).get(channel.name, np.inf),
        )
        if message not in seen:
            seen[message] = moving.at(np.asarray(t_s - sensor.delay_s, dtype=np.float64))
        reading = true_reading(channel, sensor, unloaded, seen[message])
        value = measured(channel, sensor, NOISE, reading, rng)
        channels[channel.name] = (START_NS + np.rint(t_s * 1e9).astype(np.int64), value)
    bump_ns = _bump_ns(bench, channels, begin_s)
    low = bump_ns - round(bench.trigger.pre_s * 1e9)
    high = bump_ns + round(bench.trigger.post_s * 1e9)
    cut = {
        name: (t[(t >= low) & (t < high)], v[(t >= low) & (t < high)])
        for name, (t, v) in channels.items()
    }
    return RunWindow(bump_ns, cut)


def _bias(channel: Channel) -> float:
    return 0.005 if channel.quantity is Quantity.SUSPENSION_TRAVEL else 0.05


def _bump_ns(
    bench: Bench,
    channels: Mapping[str, tuple[NDArray[np.int64], NDArray[np.float64]]],
    begin_s: float,
) -> int:
    """Return when the trigger fires; where it would not be armed, when the bump begins."""
    block = {c.name: channels[c.name] for c in trigger_channels(bench.channels)}
    _, events = advance(bench.trigger, TriggerState(), block)
    begin_ns = START_NS + round(begin_s * 1e9)
    bumps = [e.t_ns for e in events if e.code == "bump" and abs(e.t_ns - begin_ns) < 5e7]
    return bumps[0] if bumps else begin_ns + 3_000_000


def good(setting: Setting, seed: int, height: float = 1.0) -> RunWindow:
    """Return a run as it should be."""
    step = setting.step
    moving = motion(setting.car, step.mass_state, step.excitation, height)
    return windowed(setting, moving, seed)


def judged(
    setting: Setting, window: RunWindow, accepted: Sequence[RunMeasure] = ()
) -> tuple[tuple[Finding, ...], RunMeasure]:
    """Judge a run of a setting."""
    return judge(setting.described, setting.step, window, accepted)


def first_failed(findings: Sequence[Finding]) -> str:
    """Return the code of the first check that failed; '' if all passed."""
    return next((finding.code for finding in findings if not finding.passed), "")


Spoiler = Callable[[Setting, int], RunWindow]


def _stale(setting: Setting, seed: int) -> RunWindow:
    rng = np.random.default_rng([seed, 6])
    window = good(setting, seed)
    messages = sorted({c.signal.partition(".")[0] for c in setting.described.channels})
    message = messages[rng.integers(len(messages))]
    start_s, length_s = rng.uniform(-0.5, 1.5), rng.uniform(0.35, 2.0)
    names = {c.name for c in setting.described.channels if c.signal.startswith(f"{message}.")}
    return _without(window, names, start_s, start_s + length_s)


def _without(window: RunWindow, names: set[str], start_s: float, stop_s: float) -> RunWindow:
    low, high = (window.bump_ns + round(x * 1e9) for x in (start_s, stop_s))
    lost = 0
    channels = dict(window.channels)
    for name in names:
        t_ns, value = channels[name]
        kept = (t_ns < low) | (t_ns >= high)
        lost += int(np.sum(~kept))
        channels[name] = (t_ns[kept], value[kept])
    return replace(window, channels=channels, losses=Losses(counter_gaps=lost))


def _lost(setting: Setting, seed: int) -> RunWindow:
    rng = np.random.default_rng([seed, 6])
    start_s = rng.uniform(-0.3, 1.0)
    window = good(setting, seed)
    return _without(window, set(window.channels), start_s, start_s + 0.12)


def _overload(setting: Setting, seed: int) -> RunWindow:
    window = good(setting, seed)
    name = trigger_channels(setting.described.channels)[0].name
    t_ns, value = window.channels[name]
    free = value[t_ns > window.bump_ns + 210_000_000]
    limit = 9.81 + 0.5 * (float(free.max()) - 9.81)
    step = setting.step
    moving = motion(setting.car, step.mass_state, step.excitation)
    return windowed(setting, moving, seed, limit={name: limit})


def _restless(setting: Setting, seed: int) -> RunWindow:
    step, delay_s = setting.step, 1.25
    moving = motion(setting.car, step.mass_state, step.excitation, 1.0, (delay_s, 1.0))
    return windowed(setting, moving, seed, LEAD_S + delay_s)


def _weak(setting: Setting, seed: int) -> RunWindow:
    names = [c.name for c in trigger_channels(setting.described.channels)]
    window = good(setting, seed)
    peak = max(float(np.max(np.abs(window.channels[n][1] - 9.81))) for n in names)
    return good(setting, seed, round(1.4 * setting.described.trigger.level / peak, 3))


def _double(setting: Setting, seed: int) -> RunWindow:
    rng = np.random.default_rng([seed, 6])
    again = (round(rng.uniform(0.6, 1.6), 1), round(rng.uniform(0.5, 1.0), 1))
    step = setting.step
    moving = motion(setting.car, step.mass_state, step.excitation, 1.0, again)
    return windowed(setting, moving, seed)


def _wrong(setting: Setting, seed: int) -> RunWindow:
    rng = np.random.default_rng([seed, 6])
    due = setting.step.excitation
    others = [e for e in Excitation if e is not due]
    if setting.bench in ("IMU", "body accelerations"):
        flat = {Excitation.BOUNCE, Excitation.WARP}  # alike to all sensors on the body
        others = [e for e in others if not {e, due} <= flat]
    bumped = replace(setting.step, excitation=others[rng.integers(len(others))])
    return good(replace(setting, step=bumped), seed)


def _swinging(setting: Setting, seed: int) -> RunWindow:
    """Somebody keeps the car swinging: what the body does after 0.6 s is kept up to the end."""
    window = good(setting, seed)
    slow = {"body", "pitch", "roll", "trave"}
    channels = dict(window.channels)
    rng = np.random.default_rng([seed, 6])
    for name, (t_ns, value) in window.channels.items():
        if any(name.startswith(start) for start in slow):
            t_s = (t_ns - window.bump_ns) * 1e-9
            rest = np.median(value[t_s < -0.05])
            peak = np.max(np.abs(value - rest))
            swing = 0.35 * peak * np.sin(2 * np.pi * 1.1 * t_s + rng.uniform(0, 6))
            channels[name] = (t_ns, value + swing * np.clip((t_s - 0.6) / 0.8, 0.0, 1.0))
    return replace(window, channels=channels)


def _frozen(setting: Setting, seed: int) -> RunWindow:
    """One sensor of a wheel, or of the body's acceleration, shows one value from some time on."""
    window = good(setting, seed)
    rng = np.random.default_rng([seed, 6])
    angular = ("pitch", "roll")
    name = str(rng.choice([n for n in sorted(window.channels) if not n.startswith(angular)]))
    t_ns, value = window.channels[name]
    since_s = rng.choice([-1.0, rng.uniform(0.0, 0.5)])
    last = int(np.searchsorted((t_ns - window.bump_ns) * 1e-9, since_s))
    held = np.where(np.arange(len(value)) >= last, value[last], value)
    return replace(window, channels={**window.channels, name: (t_ns, held)})


def _higher(setting: Setting, seed: int) -> RunWindow:
    return good(setting, seed, 0.5)


def _slipped(setting: Setting, seed: int) -> RunWindow:
    window = good(setting, seed)
    name = next(c.name for c in setting.described.channels if c.name.startswith("travel"))
    t_ns, value = window.channels[name]
    t_s = (t_ns - window.bump_ns) * 1e-9
    channels = {**window.channels, name: (t_ns, value + 0.012 * np.clip(t_s / 0.5, 0.0, 1.0))}
    return replace(window, channels=channels)


SPOILERS: Mapping[str, Spoiler] = {
    "stale": _stale,
    "lost_frames": _lost,
    "overload": _overload,
    "frozen": _frozen,
    "not_at_rest": _restless,
    "too_weak": _weak,
    "double_bump": _double,
    "wrong_mode": _wrong,
    "not_decayed": _swinging,
    "not_repeatable": _higher,
    "rest_changed": _slipped,
}
"""By the code that must be the first to fail."""


def can_show(code: str, bench: str) -> bool:
    """Return whether the sensors of a bench allow a check at all."""
    if code == "not_decayed":
        return bench != "hubs"  # wheels hardly show the body
    return code != "rest_changed" or "travels" in bench or bench == "all"


SETTINGS = [
    Setting("linear", bench, Step(state, kind, 1))
    for bench, state, kind in itertools.product(benches(), (BASELINE, ADDED), Excitation)
]
"""Every bench with every bump in either mass state."""


# The tests ----------------------------------------------------------------------------------------

BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)
PITCH = Step(BASELINE, Excitation.PITCH, 1)
ALL = Setting("linear", "all", BOUNCE)


def test_good_runs_are_accepted() -> None:
    for number, setting in enumerate(SETTINGS[::4]):  # every bench, every bump, both mass states
        findings, _ = judged(setting, good(setting, 1000 * number))
        assert [finding.text for finding in findings if not finding.passed] == [], setting


@pytest.mark.parametrize("code", SPOILERS)
def test_a_fault_gives_its_reason_first(code: str) -> None:
    rng = np.random.default_rng(list(SPOILERS).index(code))
    able = [setting for setting in SETTINGS[::4] if can_show(code, setting.bench)]
    setting = able[rng.integers(len(able))]
    accepted = [judged(setting, good(setting, 7000))[1]] if code == "not_repeatable" else []
    findings, _ = judged(setting, SPOILERS[code](setting, 0), accepted)
    assert first_failed(findings) == code


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


def test_a_rear_axle_that_follows_the_front_one_is_no_second_bump() -> None:
    front = good(replace(ALL, step=PITCH), 4)
    early = {n: v for n, v in front.channels.items() if n in ("hub_acc_fl", "hub_acc_fr")}
    late_ns = 1_000_000_000
    late = {
        rear: (early[name][0] + late_ns, early[name][1])
        for name, rear in (("hub_acc_fl", "hub_acc_rl"), ("hub_acc_fr", "hub_acc_rr"))
    }
    rest = {
        name: (np.concatenate([t - late_ns, t])[: len(t)], np.concatenate([v[:1000], v])[: len(v)])
        for name, (t, v) in late.items()
    }
    setting = Setting("linear", "hubs", BOUNCE)
    findings, _ = judged(setting, RunWindow(front.bump_ns, {**early, **rest}))
    codes = {finding.code for finding in findings if not finding.passed}
    assert not codes & {"double_bump", "wrong_mode"}


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


@pytest.mark.parametrize(
    ("bench", "method"),
    [("all", Method.ROLL_OVER), ("IMU and travels", Method.DROP), ("all", Method.PUSH)],
)
def test_no_silence_of_any_channel_is_an_error(bench: str, method: Method) -> None:
    setting = Setting("linear", bench, BOUNCE)
    window = good(setting, 11)
    every, half = set(window.channels), set(list(window.channels)[::2])
    spans_s = ((-1.0, 0.0), (0.0, 0.4), (0.3, 2.6), (-0.1, 2.6))
    for chosen, span_s in itertools.product((every, half), spans_s):
        low, high = (window.bump_ns + round(x * 1e9) for x in span_s)
        channels = {
            name: (t, np.where((t >= low) & (t < high) & (name in chosen), np.nan, v))
            for name, (t, v) in window.channels.items()
        }
        _, measure = judged(setting, window)
        silent = replace(window, channels=channels)
        findings, _ = judge(_bench(bench, method), setting.step, silent, [measure])
        assert first_failed(findings) in ("stale", "lost_frames")


def test_the_motion_left_falls_from_one_to_nothing() -> None:
    window = good(ALL, 10)
    bench = benches()["all"]

    def left(after_s: float) -> float | None:
        now_ns = window.bump_ns + round(after_s * 1e9)
        so_far = {n: (t[t <= now_ns], v[t <= now_ns]) for n, (t, v) in window.channels.items()}
        return remaining_ratio(bench.channels, window.bump_ns, so_far, now_ns)

    shares = [left(after_s) for after_s in (0.5, 1.0, 1.5, 2.4)]
    assert all(share is not None for share in shares)
    assert shares == sorted(shares, key=lambda share: -(share or 0.0))
    assert (shares[0] or 0.0) > 0.4
    assert (shares[-1] or 1.0) < 0.05
    assert remaining_ratio(bench.channels, window.bump_ns, {}, window.bump_ns) is None


PLANT = load_car(FORD_GRANADA, AddedMass())
DROPS = [(Method.DROP, kind) for kind in (Excitation.ROLL, Excitation.REAR_PITCH)]
PUSHES = [(Method.PUSH, kind) for kind in Excitation if kind is not Excitation.REAR_PITCH]
"""Of these a warp is dropped: no push can make it.  A tail that is pushed hardly moves the
accelerometer of this bench, which is ahead of the middle: the push triggers when it lets go."""


@cache
def _motion(method: Method, kind: Excitation) -> Moving:
    if method is Method.DROP or kind is Excitation.WARP:
        return dropped(PLANT, kind, 0.04, LEAD_S)
    return pushed_down(PLANT, kind, 0.04, LEAD_S)


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
