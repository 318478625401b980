"""A session with a bit of everything, and frames of every kind."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from daq.channels import Channel, Quantity
from daq.runs import Event, Excitation, Losses, Run, RunStatus, SampleGroup
from daq.session import write_session
from daq.sessions import Session
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
    VehicleGeometry,
)
from dbc.frames import FrameBatch

from .formats.mixed import batch_of, mixed

START_NS = 1_700_000_000_123_456_789


def mixed_frames(n: int, seed: int = 1) -> FrameBatch:
    """Frames of two buses: standard, extended, FD with BRS and ESI, remote, error, transmitted."""
    frames, rng = batch_of(mixed(n, seed)), np.random.default_rng(seed)
    t_ns = START_NS + np.cumsum(rng.integers(1, 400_000, n))
    return replace(frames, t_ns=t_ns, bus=frames.bus % 2)


def small_run(repeat: int, frames: FrameBatch) -> Run:
    rng = np.random.default_rng(repeat)
    n = 500
    hub = SampleGroup(
        "HUB_Front",
        np.arange(n) / 1000.0 - 0.1 + 1e-5 * rng.random(n),
        START_NS + np.arange(n) * 1_000_000,
        {"hub_fl": rng.standard_normal(n), "hub_fr": np.where(np.arange(n) == 7, np.nan, 1.0)},
        rng.integers(0, 64, n).astype(np.uint8),
    )
    imu = SampleGroup(
        "A_IMU",
        np.arange(3) / 8.0,
        START_NS + np.arange(3) * 125_000_000,
        {"az": np.array([9.75, -1e-9, 1 / 3]), "pitch": np.array([0.25, 0.0, -0.5])},
        np.zeros(3, np.uint8),
    )
    return Run(
        "baseline",
        Excitation.ROLL,
        repeat,
        START_NS,
        0.2,
        (hub, imu),
        RunStatus.REJECTED,
        ("too weak: 0.3 m/s2", "µ-Zeichen"),
        Losses(bus_dropped=1, counter_gaps=2, crc_bad=3, remote_frames=9),
        (Event(5, "bump", 1.5, "baseline_roll_1"), Event(9, "run_end")),
        frames,
    )


def small_session(frames: FrameBatch | None = None) -> Session:
    """Two runs with frames, one without."""
    frames = mixed_frames(200) if frames is None else frames
    weights = (
        BodyWeight(30.0, -1.0, 0.5, 0.1, 0.02, 0.005),
        HubWeight(4.0, Corner.REAR_LEFT, 0.01),
    )
    half = len(frames) // 2
    return Session(
        Vehicle(
            "Wagen Ü",
            VehicleGeometry(1.25, 1.51, 0.74, 0.75),
            Structure(symmetric=False, anti_roll_bars=True),
            (Fact("total_mass_kg", 1551.8, 1.0), Fact("k_sfl", 17e3, 50.0)),
        ),
        (
            Channel("hub_fl", Quantity.HUB_ACCELERATION, "m/s2", "HUB_Front.a", Corner.FRONT_LEFT),
            Channel("hub_fr", Quantity.HUB_ACCELERATION, "m/s2", "HUB_Front.b", Corner.FRONT_RIGHT),
            Channel("az", Quantity.BODY_ACCELERATION, "m/s2", x_m=-1.0, y_m=0.1, delay_s=0.002),
            Channel("pitch", Quantity.PITCH_RATE, "rad/s"),
        ),
        (MassState("baseline"), MassState("added", AddedMass(weights, np.eye(7)))),
        (
            small_run(1, frames.select(slice(0, half))),
            small_run(2, frames.select(slice(half, None))),
            replace(small_run(3, FrameBatch.empty()), events=()),
        ),
        {"uuid": "x", "dbc": "BO_ \udce9 \x00", "bench_toml": "", "created": "2026-11-21"},
    )


@cache
def small_file() -> bytes:
    """Return the file of `small_session()`, written once."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "car.h5")
        write_session(path, small_session())
        return path.read_bytes()
