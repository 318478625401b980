"""Frames written by hand, as the documents of their sensors say."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np

from daq.bench.config import Bench, parse_bench
from daq.bench.sensors import stored_text
from dbc.frames import FrameBatch

from .small_campaign import frames_at

START_NS = 1_800_000_000_000_000_000

Row = tuple[float, int, bytes]
"""Seconds since the start, identifier, payload."""


def frame_batch(rows: Iterable[Row]) -> FrameBatch:
    """Return frames in order of time; those at one time keep their order."""
    ordered = sorted(rows, key=lambda row: row[0])
    n = len(ordered)
    wide = max((len(row[2]) for row in ordered), default=0) > 8
    data = np.zeros((n, 64 if wide else 8), np.uint8)
    for i, (_, _, payload) in enumerate(ordered):
        data[i, : len(payload)] = np.frombuffer(payload, np.uint8)
    t_ns = [START_NS + round(row[0] * 1e9) for row in ordered]
    length = [len(row[2]) for row in ordered]
    return frames_at(t_ns, data, [row[1] for row in ordered], length)


# A bench of sensors: two like IMUs on two buses, four like string pots, four hub sensors --------


IMU = """VERSION ""
BU_: Imu
BO_ 256 Accel: 8 Imu
 SG_ AccX : 0|16@1- (0.00025,0) [0|0] "g" Imu
 SG_ AccY : 16|16@1- (0.00025,0) [0|0] "g" Imu
 SG_ AccZ : 32|16@1- (0.00025,0) [0|0] "g" Imu
BO_ 257 Rate: 8 Imu
 SG_ GyrX : 0|16@1- (0.01,0) [0|0] "deg/s" Imu
 SG_ GyrY : 16|16@1- (0.01,0) [0|0] "deg/s" Imu
 SG_ GyrZ : 32|16@1- (0.01,0) [0|0] "deg/s" Imu
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;
BA_DEF_DEF_ "GenMsgCycleTime" 5;
"""
HUBS = """VERSION ""
BU_: Hub
BO_ 768 Accel: 8 Hub
 SG_ FL : 0|16@1- (0.01,0) [0|0] "m/s2" Hub
 SG_ FR : 16|16@1- (0.01,0) [0|0] "m/s2" Hub
 SG_ RL : 32|16@1- (0.01,0) [0|0] "m/s2" Hub
 SG_ RR : 48|16@1- (0.01,0) [0|0] "m/s2" Hub
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;
BA_DEF_DEF_ "GenMsgCycleTime" 2;
"""
POT = """VERSION ""
BU_: Pot
BO_ 385 TPDO1: 4 Pot
 SG_ Position : 0|32@1- (0.01,0) [0|0] "mm" Pot
BO_ 1793 Heartbeat: 1 Pot
 SG_ State : 0|8@1+ (1,0) [0|0] "" Pot
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;
BA_DEF_DEF_ "GenMsgCycleTime" 5;
"""
HEAD = """
[[bus]]
interface = "virtual"
channel = "can0"

[[bus]]
interface = "virtual"
channel = "can1"
name = "rear"

[campaign]
excitations = ["bounce"]
repeats = 1

[[sensor]]
name = "imu_a"
dbc = "imu.dbc"
bus = "can0"

[[sensor]]
name = "imu_b"
dbc = "imu.dbc"
bus = "rear"

[[sensor]]
name = "hubs"
dbc = "hubs.dbc"
bus = 0

[[sensor]]
name = "pot_fl"
dbc = "pot.dbc"
bus = "rear"

[[sensor]]
name = "pot_fr"
dbc = "pot.dbc"
bus = "rear"
id_offset = 1

[[sensor]]
name = "pot_rl"
dbc = "pot.dbc"
bus = "rear"
ids = { TPDO1 = 0x183 }

[[sensor]]
name = "pot_rr"
dbc = "pot.dbc"
bus = "rear"
ids = { "0x181" = 0x1C4 }
"""
DATABASES = {"imu.dbc": IMU, "hubs.dbc": HUBS, "pot.dbc": POT}


def channel(name: str, signal: str, quantity: str, *more: str) -> str:
    """Return a `[[channel]]`."""
    lines = [f'name = "{name}"', f'signal = "{signal}"', f'quantity = "{quantity}"', *more]
    return "\n".join(["\n[[channel]]", *lines, ""])


CHANNELS = (
    channel("acc_a", "imu_a.AccZ", "body_acceleration", "x_m = -0.2", "y_m = 0.1")
    + channel("roll_a", "imu_a.GyrX", "roll_rate")
    + channel("pitch_a", "imu_a.GyrY", "pitch_rate")
    + channel("acc_b", "imu_b.Accel.AccZ", "body_acceleration", "x_m = -2.0", "sign = -1")
    + channel("pitch_b", "imu_b.GyrY", "pitch_rate", "sign = -1")
    + "".join(
        channel(f"hub_{c}", f"hubs.{c.upper()}", "hub_acceleration", f'corner = "{c.upper()}"')
        + channel(f"pot_{c}", f"pot_{c}.Position", "suspension_travel", f'corner = "{c.upper()}"')
        for c in ("fl", "fr", "rl", "rr")
    )
)
TEXT = HEAD + CHANNELS


@cache
def sensor_bench() -> Bench:
    """Return the bench, its databases read."""
    return parse_bench(TEXT, "bench.toml", Path(), stored_text(DATABASES))
