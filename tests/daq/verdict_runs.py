"""Simulated runs for the verdict: good ones on many cars and benches, and spoilt ones.

They are sampled from the simulated car's motion without a bus: the truth is the force balance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
from numpy.typing import NDArray

from daq.bench.campaign import Step
from daq.bench.config import Bench, load_bench
from daq.channels import Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation, Losses
from daq.samples.mapping import trigger_channels
from daq.samples.trigger import TriggerState, advance
from daq.sim.car import NOISE, SensorTruth, install, measured, true_reading
from daq.sim.motion import Bump, Kinematics, Moving, Spliced, drive
from daq.vehicle import FORD_GRANADA
from daq.verdict.judge import judge
from daq.verdict.window import RunMeasure, RunWindow
from dbc.words import Finding

from ..simulated.elements import NONE, Imperfections, load_car

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
    first = drive(plant, Bump(excitation, height * HEIGHT_M, LEAD_S, 0.2), LEAD_S + AFTER_S)
    if again is None:
        return first
    delay_s, size = again
    begin_s = LEAD_S + delay_s
    second = Bump(excitation, size * HEIGHT_M, begin_s, 0.2)
    before = first.states(np.array([begin_s]))
    return Spliced(first, drive(plant, second, begin_s + AFTER_S, before))


def windowed(
    setting: Setting,
    moving: Moving,
    seed: int,
    begin_s: float = LEAD_S,
    limit: Mapping[str, float] | None = None,
) -> RunWindow:
    """Sample a motion and cut the run whose bump begins at `begin_s`."""
    bench = setting.described
    installation = install(load_car(FORD_GRANADA, load_bench(None).mass_states[0].added))
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
        reading = true_reading(channel, sensor, installation, seen[message])
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


# Counts verdicts on good and on spoilt runs -----------------------------------------------------


def settings(cars: Sequence[str]) -> list[Setting]:
    """Return every car on every bench with every bump in either mass state."""
    kinds = product(cars, benches(), (BASELINE, ADDED), Excitation)
    return [Setting(car, bench, Step(state, kind, 1)) for car, bench, state, kind in kinds]


def rejected(chosen: Sequence[Setting]) -> Iterator[tuple[Setting, Finding]]:
    """Judge a good run of each setting; yield what is found against it."""
    for number, setting in enumerate(chosen):
        findings, _ = judged(setting, good(setting, 1000 * number))
        yield from ((setting, finding) for finding in findings if not finding.passed)


def confusion(cars: Sequence[str]) -> dict[str, str]:
    """Return the code of the first check that fails in a run with each fault."""
    rng = np.random.default_rng(0)
    table = {}
    for code, spoil in SPOILERS.items():
        able = [setting for setting in settings(cars) if can_show(code, setting.bench)]
        setting = able[rng.integers(len(able))]
        accepted = [judged(setting, good(setting, 7000))[1]] if code == "not_repeatable" else []
        findings, _ = judged(setting, spoil(setting, 0), accepted)
        table[code] = first_failed(findings)
    return table
