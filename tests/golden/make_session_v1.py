"""Made `session_v1_2026-11.h5`; kept for the record, the file is never made again.

The values are those of closed forms, which `test_golden.py` states once more.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from daq.channels import Channel, Quantity
from daq.runs import Event, Losses, RunStatus
from daq.session import write_session
from daq.sessions import session_from_arrays
from daq.vehicle import BodyWeight, Corner, Fact, HubWeight, Structure, Vehicle, VehicleGeometry
from dbc import FrameBatch

CHANNELS = (
    Channel("hub_fl", Quantity.HUB_ACCELERATION, "m/s2", "Hubs.fl", corner=Corner.FRONT_LEFT),
    Channel(
        "body_z",
        Quantity.BODY_ACCELERATION,
        "m/s2",
        x_m=-1.25,
        y_m=0.5,
        position_sigma_m=0.01,
        sign=-1.0,
        gain=1.5,
        tare=9.81,
        delay_s=0.002,
        delay_sigma_s=0.0005,
        low_pass_hz=80.0,
        low_pass_order=4,
    ),
    Channel("pitch", Quantity.PITCH_RATE, "rad/s"),
)


def main(path: Path) -> None:
    """Write the file."""
    t_s = np.arange(200) / 100.0
    body = np.exp(-t_s) * np.sin(2 * np.pi * 1.5 * t_s)
    body[17] = np.nan
    data = {"hub_fl": (t_s, t_s**2), "body_z": (t_s, body), "pitch": (t_s[::2], -t_s[::2])}
    weights = (BodyWeight(60.0, 0.25, 0.5, 0.1, 0.05), HubWeight(4.0, Corner.REAR_RIGHT, 0.01))
    session = session_from_arrays(
        [("baseline", "bounce", {"pitch": data["pitch"]}), ("added", "roll", data)],
        CHANNELS,
        weights,
        Vehicle(
            "Käfer 1303",
            VehicleGeometry(1.25, 1.5, 0.75, 0.7),
            Structure(symmetric=False, tyre_damping=True),
            (Fact("total_mass_kg", 1551.75, 0.5),),
        ),
        bump_s=0.25,
    )
    frames = FrameBatch(
        1_790_000_000_000_000_000 + np.arange(3) * 1_000_001,
        np.array([0x100, 0x1ABCDEF0, 0x7FF], np.uint32),
        np.array([0, 1, 8 + 16], np.uint16),
        np.full(3, 1, np.uint8),
        np.array([8, 2, 64], np.uint8),
        np.arange(3 * 64).reshape(3, 64).astype(np.uint8),
    )
    first, second = session.runs
    t0_ns = 1_790_000_000_000_000_000
    hubs = replace(second.groups[0], name="Hubs")
    second = replace(
        second,
        t0_ns=t0_ns,
        groups=(replace(hubs, t_ns=t0_ns + hubs.t_ns),),
        status=RunStatus.REJECTED,
        reasons=("too weak", "Prüfer: nochmal"),
        losses=Losses(1, 2, 3, 4, 5, 6, 7, 8, 9),
        events=(Event(1_790_000_000_500_000_000, "bump", 12.5, "added_roll_1"),),
        frames=frames,
    )
    provenance = {"uuid": "golden", "created": "2026-11-21T00:00:00Z", "dbc": "BO_ é\n"}
    write_session(path, replace(session, runs=(first, second), provenance=provenance))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
