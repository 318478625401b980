"""Runs of closed form: records with a known property, and what one check finds in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from daq.bench.config import Bench, load_bench
from daq.channels import Channel, Quantity
from daq.vehicle import Corner
from daq.verdict import RunWindow
from daq.verdict.window import Trace, traces
from dbc.finding import Finding

Array = NDArray[np.float64]
BUMP_NS = 1_800_000_000_000_000_000
T_S: Array = np.arange(-1000.0, 2500.0) / 1000.0
HUB = Channel("hub", Quantity.HUB_ACCELERATION, "m/s2", "HUB.a", corner=Corner.FRONT_LEFT)
TRAVEL = Channel(
    "travel", Quantity.SUSPENSION_TRAVEL, "m", "SUSP.z", corner=Corner.FRONT_LEFT
)  # fmt: skip
BODY = Channel("body", Quantity.BODY_ACCELERATION, "m/s2", "IMU.z")
Check = Callable[[Bench, RunWindow, tuple[Trace, ...]], Iterator[Finding]]


def window(records: Mapping[Channel, Array], time_s: Array = T_S) -> tuple[Bench, RunWindow]:
    """Return a bench of these channels and the run that they show."""
    bench = replace(load_bench(None), channels=tuple(records))
    t_ns = BUMP_NS + np.rint(time_s * 1e9).astype(np.int64)
    return bench, RunWindow(BUMP_NS, {c.name: (t_ns, value) for c, value in records.items()})


def found(check: Check, records: Mapping[Channel, Array], time_s: Array = T_S) -> list[Finding]:
    bench, run = window(records, time_s)
    return list(check(bench, run, traces(bench.channels, run)))


def one(check: Check, records: Mapping[Channel, Array], time_s: Array = T_S) -> Finding:
    (finding,) = found(check, records, time_s)
    return finding


def pulse(height: float) -> Array:
    """Return one sample away from rest, at 0.1 s."""
    return np.where(np.isclose(T_S, 0.1), height, 0.0)
