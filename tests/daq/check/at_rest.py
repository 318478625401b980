"""Samples of a car at rest, made by hand, and what the bench check finds in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.bench.bench_tables import SampleSet
from daq.channels import Channel, Quantity
from daq.check.channel_checks import check_channel
from daq.samples.groups import Timekeeping
from daq.samples.mapping import map_channels
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.finding import Finding, Severity
from dbc.samples import DecodeCounts, Decoded, Samples

Array = NDArray[np.float64]
TODAY = date(2026, 6, 1)
G = 9.80665
WARN, FAIL, OK = Severity.WARNING, Severity.ERROR, Severity.NOTE
FLOATS = {"Z": "m/s2", "W": "rad/s", "T": "rad/s2", "S": "m"}
DBC = (
    'VERSION ""\n\nBU_: A B\n'
    + "".join(
        f'BO_ {300 + n} {name}: 8 A\n SG_ v : 0|32@1- (1,0) [0|0] "{unit}" A\n'
        for n, (name, unit) in enumerate(FLOATS.items())
    )
    + 'BO_ 310 RAW: 8 B\n SG_ v : 0|16@1- (0.001,0) [-30|30] "m" A\n'
    + ' SG_ bit : 16|1@1+ (1,0) [0|0] "m" A\n SG_ up : 24|16@1+ (0.001,0) [0|0] "m" A\n'
    + ' SG_ two : 40|2@1+ (0.01,0) [0|0] "m" A\n'
    + 'BO_ 320 IMU: 8 B\n SG_ x : 0|16@1- (0.001,0) [0|0] "g" A\n'
    + ' SG_ y : 16|16@1- (0.01,0) [0|0] "m/s2" A\n SG_ z : 32|16@1- (1,0) [0|0] "furlong" A\n'
    + 'BO_ 330 TWIN: 8 B\n SG_ u : 0|16@1- (0.001,0) [0|0] "g" A\n'
    + "".join(f"SIG_VALTYPE_ {300 + n} v : 1;\n" for n in range(4))
)
CODEC = parse_codec(DBC, "rest.dbc")
MESSAGES = {m.name: m for m in CODEC.messages}
STEP_NS = 12_500_000
"""80 Hz: eight samples in each tenth of a second."""
KINDS = {
    Quantity.BODY_ACCELERATION: "Z",
    Quantity.HUB_ACCELERATION: "Z",
    Quantity.PITCH_RATE: "W",
    Quantity.ROLL_RATE: "W",
    Quantity.PITCH_ACCELERATION: "T",
    Quantity.ROLL_ACCELERATION: "T",
    Quantity.SUSPENSION_TRAVEL: "S",
    Quantity.BODY_DISPLACEMENT: "S",
}


def channel(quantity: Quantity, signal: str = "", **facts: Any) -> Channel:
    wheel = quantity in (Quantity.HUB_ACCELERATION, Quantity.SUSPENSION_TRAVEL)
    corner = Corner.FRONT_LEFT if wheel else None
    return Channel("c", quantity, signal=signal or f"{KINDS[quantity]}.v", corner=corner, **facts)


def checked(
    one: Channel,
    value: Sequence[float] | Array,
    quality: int | NDArray[np.uint8] = 0,
    others: Mapping[str, Samples] | None = None,
    sets: Sequence[SampleSet] = (),
    step_ns: int = STEP_NS,
) -> list[Finding]:
    array = np.asarray(value, float)
    n = len(array)
    bits: NDArray[np.uint8] = np.zeros(n, np.uint8)
    bits[:] = quality
    own = Samples(one.signal, np.arange(n) * step_ns, array, bits)
    decoded = Decoded({one.signal: own, **(others or {})}, DecodeCounts(0, 0, 0, 0, 0))
    (mapped,) = map_channels((one,), CODEC.messages, "rest.dbc")
    return check_channel(mapped, Timekeeping(MESSAGES, {}, sets), decoded, 365, TODAY)


def still(level: float, noise: float = 1e-3, n: int = 320) -> Array:
    """Return samples whose neighbours differ by 1.414 `noise`; the mean of each eight is `level`.

    White noise of that standard deviation differs as much.
    """
    turn: Array = np.resize([0.0, 1.0, 0.0, -1.0], n)
    return np.asarray(level + noise * np.sqrt(2.0) * turn)


def faults(lines: Sequence[Finding]) -> list[Finding]:
    """Return what is not right, or else what the channel reads."""
    return [line for line in lines if line.code != "rest"] or list(lines)


def found(lines: Sequence[Finding]) -> dict[str, Severity]:
    return {line.code: line.severity for line in faults(lines)}


def level_of(quantity: Quantity) -> float:
    return G if KINDS[quantity] == "Z" else 0.0
