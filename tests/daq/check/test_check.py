"""The bench check on simulated benches: a sound one passes, each fault is named."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import date
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import Bench, bench_codec, load_bench
from daq.channels import Channel, Quantity
from daq.check.check import CheckReport, check_bench
from daq.check.signs import opposed_signs
from daq.runs import Excitation, Losses, Run, RunStatus, SampleGroup
from daq.sessions import Session
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from daq.vehicle import Corner
from dbc import FrameBatch, FrameFlag
from dbc.words import Finding, Severity

from ...flow.coverage import simulated_session
from ..sensor_bench import START_NS
from ..small_campaign import frames_at

TODAY = date(2026, 6, 1)
REST_S = 3.0
BENCH = load_bench(None)
CODEC = bench_codec(BENCH)


@cache
def _rest() -> FrameBatch:
    """Three seconds of the simulated car at rest."""
    car = SimulatedCar(lead_s=REST_S + 0.2, tail_s=0.3)
    frames = next(iter(campaign_frames(BENCH, CODEC, car, 1, START_NS)))
    return frames.select(frames.t_ns < START_NS + round(REST_S * 1e9))


def _check(frames: FrameBatch, bench: Bench = BENCH) -> CheckReport:
    return check_bench(bench, CODEC, frames, TODAY)


def _bad(report: CheckReport) -> list[Finding]:
    return [line for line in report.lines if line.severity is not Severity.NOTE]


def _channel(name: str, **changes: Any) -> Bench:
    """Return the bench with one channel described differently."""
    channels = tuple(replace(c, **changes) if c.name == name else c for c in BENCH.channels)
    return replace(BENCH, channels=channels)


def test_a_sound_bench_passes_and_says_what_it_measured() -> None:
    report = _check(_rest())
    assert _bad(report) == []
    assert report.verdict is Severity.NOTE
    lines = {line.subject: line for line in report.lines}
    figures = lines["message HUB_Front"].figures
    assert figures["rate_hz"] == pytest.approx(1000, rel=1e-3)
    assert 0 < figures["jitter_s"] < 1e-3
    z = lines["channel body_acc_z"]
    assert z.figures["level"] == pytest.approx(9.80665, abs=0.2)
    assert z.figures["noise"] == pytest.approx(0.03, rel=0.15)  # as simulated
    assert "+1 g" in z.text
    assert lines["channel hub_acc_fl"].figures["noise"] == pytest.approx(0.15, rel=0.15)
    assert report.frames == len(_rest())


def test_silence_is_a_failure() -> None:
    (line,) = _check(FrameBatch.empty()).lines
    assert (line.severity, line.text) == (Severity.ERROR, "no frame was received")


@pytest.mark.parametrize(
    ("bench", "subject", "advice"),
    [
        (_channel("hub_acc_rl", sign=-1.0), "channel hub_acc_rl", "set sign = 1"),
        (
            replace(BENCH, channels=tuple(c for c in BENCH.channels if "travel" in c.name)),
            "trigger",
            "add a hub_acceleration or a body_acceleration",
        ),
    ],
)
def test_a_mistake_of_the_bench_is_its_only_fault(bench: Bench, subject: str, advice: str) -> None:
    (line,) = _bad(_check(_rest(), bench))
    assert (line.severity, line.subject, line.advice) == (Severity.ERROR, subject, advice)


def test_a_missing_message() -> None:
    frames = _rest()
    rear = CODEC.message("SUSP_Rear").can_id
    can_id = np.where(frames.can_id == rear, 0x3A1, frames.can_id).astype(np.uint32)
    unknown, missing, *channels = _bad(_check(replace(frames, can_id=can_id)))
    assert unknown.text.startswith("1 identifier is not in the DBC: 0x3a1 (500 Hz)")
    assert (missing.severity, missing.subject) == (Severity.ERROR, "message SUSP_Rear")
    assert [line.subject for line in channels] == ["channel travel_rl", "channel travel_rr"]


def test_error_frames_and_foreign_traffic_are_warnings() -> None:
    flags = np.where(np.arange(20) % 2, FrameFlag.ERROR, 0)
    extra = frames_at(START_NS + np.arange(20) * 10_000_000, can_id=0x7FF, flags=flags)
    frames = FrameBatch.concatenate([_rest(), extra])
    report = _check(frames.by_time())
    texts = [line.text.split(":")[0] for line in _bad(report)]
    assert texts == ["10 error frames", "1 identifier is not in the DBC"]
    assert report.verdict is Severity.WARNING


def test_a_moving_car_is_not_at_rest() -> None:
    car = SimulatedCar(lead_s=0.5, tail_s=1.0)
    frames = next(iter(campaign_frames(BENCH, CODEC, car, 1, START_NS)))
    report = _check(frames)
    moving = {x.subject for x in _bad(report) if "not at rest" in x.text}
    assert moving >= {"channel body_acc_z", "channel travel_fl", "channel pitch_rate"}
    # Half a second of rest is enough to be sure of units and signs all the same.
    assert not [x for x in report.lines if "upside down" in x.text or "wrong" in x.text]


# Channels whose sign is wrong, by what moves with them --------------------------------------------


TRAVELS = ("travel_fl", "travel_fr", "travel_rl", "travel_rr")


@cache
def recorded() -> Session:
    """Return a campaign of the shipped bench: an IMU, four hubs, four travels."""
    bench = replace(BENCH, campaign=replace(BENCH.campaign, repeats=1))
    return simulated_session(bench, 1)


def turned(session: Session, *names: str) -> Session:
    """Return the session with the other sign of these channels."""
    return with_values(session, lambda run, g, k: -g.values[k] if k in names else g.values[k])


def with_values(
    session: Session, value: Callable[[Run, SampleGroup, str], NDArray[np.float64]]
) -> Session:
    """Return the session with other samples of each channel."""
    runs = []
    for run in session.runs:
        groups = (replace(g, values={k: value(run, g, k) for k in g.values}) for g in run.groups)
        runs.append(replace(run, groups=tuple(groups)))
    return replace(session, runs=tuple(runs))


def named(session: Session) -> list[str]:
    """Return what is named, a subject each."""
    return [f.subject for f in opposed_signs(session.runs, session.channels)]


@pytest.mark.parametrize(
    ("wrong", "subjects"),
    [
        ((), []),
        (("travel_rl",), ["travel_rl"]),
        (TRAVELS, [", ".join(TRAVELS)]),
        (("roll_rate",), ["roll_rate"]),
        (("pitch_rate",), ["pitch_rate"]),
        ((*TRAVELS, "roll_rate"), [", ".join(TRAVELS), "roll_rate"]),
    ],
)
def test_wrong_signs_are_named(wrong: tuple[str, ...], subjects: list[str]) -> None:
    assert named(turned(recorded(), *wrong)) == subjects


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("hub_acc_fl", "hub_acc_fr"),
        ("hub_acc_fl", "hub_acc_rl"),
        ("travel_rl", "travel_rr"),
        ("pitch_rate", "roll_rate"),
    ],
)
def test_channels_that_were_exchanged_are_not_upside_down(one: str, other: str) -> None:
    place = {one: other, other: one}
    session = with_values(recorded(), lambda run, g, k: column(run, place.get(k, k), g))
    assert named(session) == []


def column(run: Run, name: str, group: SampleGroup) -> NDArray[np.float64]:
    """Return the samples of a channel at the times of a group."""
    own = next(g for g in run.groups if name in g.values)
    return np.interp(group.time_s, own.time_s, own.values[name])


def run_of(values: Mapping[str, NDArray[np.float64]]) -> Run:
    """Return a run of 2 s at 250 Hz."""
    time_s = np.arange(500) / 250.0
    t_ns = np.rint(time_s * 1e9).astype(np.int64)
    group = SampleGroup("all", time_s, t_ns, values, np.zeros(500, np.uint8))
    return Run(
        "baseline", Excitation.BOUNCE, 1, 0, 0.2, (group,), RunStatus.ACCEPTED, (), Losses(), (),
        FrameBatch.empty(),
    )  # fmt: skip


def wheel_motion(seed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a random motion between 6 and 14 Hz, and its second derivative."""
    hz = np.fft.rfftfreq(500, 1 / 250.0)
    rng = np.random.default_rng(seed)
    spectrum = rng.standard_normal(len(hz)) + 1j * rng.standard_normal(len(hz))
    spectrum[(hz < 6.0) | (hz > 14.0)] = 0.0
    motion = np.fft.irfft(spectrum, 500)
    acceleration = np.fft.irfft(-((2 * np.pi * hz) ** 2) * spectrum, 500)
    return motion / np.std(motion), acceleration / np.std(motion)


CORNER = {
    "travel": Channel("travel", Quantity.SUSPENSION_TRAVEL, corner=Corner.FRONT_LEFT),
    "hub": Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_LEFT),
}


@pytest.mark.parametrize(("share", "is_named"), [(-0.55, True), (-0.45, False), (0.55, False)])
def test_half_of_the_motion_must_be_opposed(share: float, is_named: bool) -> None:
    runs = []
    for seed in range(40):
        motion, hub = wheel_motion(seed)
        other, _ = wheel_motion(1000 + seed)
        runs.append(run_of({"travel": share * motion + np.sqrt(1 - share**2) * other, "hub": hub}))
    assert bool(opposed_signs(runs, tuple(CORNER.values()))) == is_named


@pytest.mark.parametrize("late_s", [0.04, 0.048, 0.056])
def test_a_sensor_that_is_half_a_swing_late_is_not_upside_down(late_s: float) -> None:
    runs = []
    for seed in range(10):
        motion, hub = wheel_motion(seed)
        runs.append(run_of({"travel": np.roll(motion, round(late_s * 250)), "hub": hub}))
    assert opposed_signs(runs, tuple(CORNER.values())) == ()


def test_a_bounce_does_not_show_the_sign_of_the_roll_rate() -> None:
    session = turned(recorded(), "roll_rate", "pitch_rate")
    shown = {
        kind: named(replace(session, runs=tuple(r for r in session.runs if r.excitation is kind)))
        for kind in (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
    }
    assert shown == {
        Excitation.BOUNCE: [],
        Excitation.PITCH: ["pitch_rate"],
        Excitation.ROLL: ["roll_rate"],
    }
