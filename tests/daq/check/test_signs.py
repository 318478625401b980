"""Channels whose sign is wrong are named by what moves with them, and nothing else is."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import load_bench
from daq.channels import Channel, Quantity
from daq.check.signs import opposed_signs
from daq.runs import Excitation, Losses, Run, RunStatus, SampleGroup
from daq.sessions import Session
from daq.vehicle import Corner
from dbc import FrameBatch

from ...flow.coverage import simulated_session

TRAVELS = ("travel_fl", "travel_fr", "travel_rl", "travel_rr")


@cache
def recorded() -> Session:
    """Return a campaign of the shipped bench: an IMU, four hubs, four travels."""
    return simulated_session(load_bench(None), 1)


def turned(session: Session, *names: str) -> Session:
    """Return the session with the other sign of these channels."""
    return with_values(session, lambda run, g, k: -g.values[k] if k in names else g.values[k])


def with_values(
    session: Session, value: Callable[[Run, SampleGroup, str], NDArray[np.float64]]
) -> Session:
    """Return the session with other samples of each channel."""
    runs = [
        replace(
            run,
            groups=tuple(
                replace(g, values={k: value(run, g, k) for k in g.values}) for g in run.groups
            ),
        )
        for run in session.runs
    ]
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


def test_rates_without_travels_are_held_against_each_other() -> None:
    time_s = np.arange(500) / 250.0
    roll = np.exp(-time_s) * np.sin(2 * np.pi * 1.6 * time_s)
    channels = tuple(Channel(name, Quantity.ROLL_RATE) for name in ("a", "b", "c"))
    (finding,) = opposed_signs([run_of({"a": roll, "b": -roll, "c": roll})], channels)
    assert (finding.subject, finding.text) == ("b", "b moves against a")
    assert finding.advice.startswith("change the sign of one side")


@pytest.mark.parametrize("number", range(0, 12, 4))
def test_a_single_run_gives_no_advice_on_a_sign_that_is_right(number: int) -> None:
    session = recorded()
    assert named(replace(session, runs=session.runs[number : number + 1])) == []


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
