"""The bench of docs/sensors.md as it is in truth, and a recording of it at rest and pushed.

The databases are ours, of the shape of public ones: two IMUs of one maker on two buses, one of them
on its side; an IMU and hub sensors of another; four nodes of CANopen that one database describes.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.sensors import Database, stored_text
from daq.check.pushes import ORDER
from daq.runs import BASELINE
from daq.sim.bench import Acts
from daq.sim.car import SimulatedCar
from daq.sim.ecu import rig_of
from dbc import FrameBatch

from .sensor_bench import START_NS

FOLDER = Path(__file__).parents[2] / "docs" / "examples" / "unknown_bench"
TRUTH = (FOLDER / "car.toml").read_text("utf-8")
IMU_A, IMU_B, HUBS, POT = (
    (FOLDER / f"{name}.dbc").read_text("utf-8") for name in ("imu_a", "imu_b", "hubs", "pot")
)
DATABASES = (
    Database("imu_a.dbc", IMU_A),
    Database("imu_b.dbc", IMU_B),
    Database("hubs.dbc", HUBS),
    Database("pot.dbc", POT),
)

NODES = {1: "RR", 2: "FL", 3: "FR", 4: "RL"}
"""Where the nodes of CANopen are in truth; no name says so."""
POSITIONS = {"imu_front": (-0.3, 0.1), "imu_rear": (-2.2, -0.1), "imu_mid": (-1.1, 0.0)}


@cache
def wild_bench() -> Bench:
    """Return the bench as it is in truth."""
    return parse_bench(TRUTH, "truth.toml", Path(), stored_text(DATABASES))


@cache
def rest_and_pushes() -> tuple[FrameBatch, FrameBatch]:
    """Return three seconds of rest, and a push on each corner with rest before each."""
    bench = wild_bench()
    rig = rig_of(bench, bench_codec(bench), SimulatedCar(), 3)
    acts = Acts(bench, rig)
    plan = [(acts.rest(BASELINE), 4.0)]
    for corner in ORDER:
        plan += [(acts.push(BASELINE, corner), 1.2), (acts.rest(BASELINE), 1.0)]
    acts.close()
    rng = np.random.default_rng(5)
    free_ns, begun_s, batches = [START_NS] * 2, 0.0, []
    for act, length_s in plan:
        span_s = (begun_s, begun_s + length_s)
        batches.append(rig.frames(act, begun_s, span_s, rng, START_NS, free_ns))
        begun_s = span_s[1]
    frames = FrameBatch.concatenate(batches)
    cut_ns = START_NS + 3_000_000_000
    return frames.select(frames.t_ns < cut_ns), frames.select(frames.t_ns >= cut_ns)
