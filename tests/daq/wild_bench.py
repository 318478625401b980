"""The bench of docs/sensors.md as it is in truth, and a recording of it at rest and pushed.

The databases are ours, of the shape of public ones: two IMUs of one maker on two buses, one of them
on its side; an IMU and hub sensors of another; four nodes of CANopen that one database describes.
"""

from __future__ import annotations

from functools import cache
from itertools import takewhile
from pathlib import Path

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.sensors import stored_text
from daq.sim.bench import push_frames
from daq.sim.car import SimulatedCar
from dbc import FrameBatch

from .sensor_bench import START_NS

FOLDER = Path(__file__).parents[2] / "docs" / "examples" / "unknown_bench"
TRUTH = (FOLDER / "car.toml").read_text("utf-8")
IMU_A, IMU_B, HUBS, POT = (
    (FOLDER / f"{name}.dbc").read_text("utf-8") for name in ("imu_a", "imu_b", "hubs", "pot")
)
DATABASES = {"imu_a.dbc": IMU_A, "imu_b.dbc": IMU_B, "hubs.dbc": HUBS, "pot.dbc": POT}

NODES = {1: "RR", 2: "FL", 3: "FR", 4: "RL"}
"""Where the nodes of CANopen are in truth; no name says so."""


@cache
def wild_bench() -> Bench:
    """Return the bench as it is in truth."""
    return parse_bench(TRUTH, "truth.toml", Path(), stored_text(DATABASES))


@cache
def rest_and_pushes() -> tuple[FrameBatch, FrameBatch]:
    """Return three seconds of rest, and a push on each corner with rest before each."""
    bench = wild_bench()
    end_ns = START_NS + 15_000_000_000
    blocks = push_frames(bench, bench_codec(bench), SimulatedCar(), 3, START_NS, 4.0)
    frames = FrameBatch.concatenate(list(takewhile(lambda b: int(b.t_ns[0]) < end_ns, blocks)))
    cut_ns = START_NS + 3_000_000_000
    return frames.select(frames.t_ns < cut_ns), frames.select(frames.t_ns >= cut_ns)
