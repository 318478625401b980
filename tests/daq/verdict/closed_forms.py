"""Runs of closed form: records with a known property, and what one check finds in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import Bench, load_bench
from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from daq.verdict.window import RunWindow, Trace, traces
from dbc.words import Finding

Array = NDArray[np.float64]
BUMP_NS = 1_800_000_000_000_000_000
T_S: Array = np.arange(-1000.0, 2500.0) / 1000.0
BEFORE = T_S < -0.0301
TURNS: Array = np.resize([0.0, 1.0, 0.0, -1.0], len(T_S))
"""Samples that differ by 1 each, as white noise of 0.707 does."""
HUB = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", "HUB.a", corner=Corner.FRONT_LEFT)
TRAVEL = Channel(
    "travel", Quantity.SUSPENSION_TRAVEL, "m", "SUSP.z", corner=Corner.FRONT_LEFT
)  # fmt: skip
OTHER = replace(TRAVEL, name="other", signal="SUSP.y", corner=Corner.FRONT_RIGHT)
BODY = Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "IMU.z")
PITCH = Channel("pitch", Quantity.PITCH_RATE, "rad/s", "IMU.p")
ROLL = Channel("roll", Quantity.ROLL_RATE, "rad/s", "IMU.r")
TURN = Channel("turn", Quantity.ROLL_ACCELERATION, "rad/s2", "IMU.t")
TILT = Channel("tilt", Quantity.PITCH_ACCELERATION, "rad/s2", "IMU.u")
HEIGHT = Channel("height", Quantity.BODY_DISPLACEMENT, "m", "L.z")
Check = Callable[[Bench, RunWindow, tuple[Trace, ...]], Iterator[Finding]]


def bench_of(*channels: Channel, **trigger: float) -> Bench:
    bench = load_bench(None)
    return replace(bench, channels=channels, trigger=bench.trigger.model_copy(update=trigger))


def run_of(records: Mapping[Channel, Array], time_s: Array = T_S) -> RunWindow:
    t_ns = BUMP_NS + np.rint(time_s * 1e9).astype(np.int64)
    return RunWindow(BUMP_NS, {c.name: (t_ns, value) for c, value in records.items()})


def window(records: Mapping[Channel, Array], time_s: Array = T_S) -> tuple[Bench, RunWindow]:
    """Return a bench of these channels and the run that they show."""
    return bench_of(*records), run_of(records, time_s)


def seen(records: Mapping[Channel, Array], time_s: Array = T_S) -> tuple[Trace, ...]:
    return traces(tuple(records), run_of(records, time_s))


def found(check: Check, records: Mapping[Channel, Array], time_s: Array = T_S) -> list[Finding]:
    bench, run = window(records, time_s)
    return list(check(bench, run, traces(bench.channels, run)))


def one(check: Check, records: Mapping[Channel, Array], time_s: Array = T_S) -> Finding:
    (finding,) = found(check, records, time_s)
    return finding


def pulse(height: float) -> Array:
    """Return one sample away from rest, at 0.1 s."""
    return np.where(np.isclose(T_S, 0.1), height, 0.0)


def ringing(frequency_hz: float, damping: float, size: float = 1.0, shift: float = 0.4) -> Array:
    """Return a damped wave from the bump on, by its undamped frequency."""
    omega = 2 * np.pi * frequency_hz
    phase = omega * np.sqrt(1 - damping**2) * T_S + shift
    wave = np.exp(-omega * damping * np.clip(T_S, 0.0, None)) * np.sin(phase)
    return np.where(T_S > 0.0, size * wave, 0.0)


def noisy(value: Array, noise: float) -> Array:
    """Add samples that differ by `noise` sqrt(2) each before the bump, and none after it."""
    return value + np.where(BEFORE, noise * np.sqrt(2.0) * TURNS, 0.0)
