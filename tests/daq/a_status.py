"""A status of a recorder that does not exist."""

from __future__ import annotations

from daq.control.messages import (
    Alarm,
    BusState,
    BusStatus,
    DiskStatus,
    Phase,
    QueueStatus,
    SessionStatus,
    Status,
)
from daq.runs import Losses


def a_status(t_ns: int = 0, alarms: tuple[Alarm, ...] = ()) -> Status:
    return Status(
        wall_ns=1_800_000_000_000_000_000,
        t_ns=t_ns,
        recording="r1",
        folder="/var/lib/bumpbench",
        vehicle="Granada",
        bench_crc32=7,
        phase=Phase.IDLE,
        phase_s=1.0,
        countdown_s=None,
        not_at_rest=(),
        bump_ns=0,
        peak_left=None,
        halted="",
        due=None,
        tallies=(),
        runs=(),
        notes=(),
        overrides=(),
        undo="",
        redo="",
        alarms=alarms,
        overloaded=(),
        buses=(
            BusStatus("can0", BusState.OK, 0.5, 9_000.0, 12_345, 2, 0),
            BusStatus("can1", BusState.OK, 0.25, 3_031.4, 6_000, 0, 0),
            BusStatus("can2", BusState.DISCONNECTED, 0.0, 0.0, 0, 0, 3),
        ),
        sensors_alive=8,
        sensors_expected=9,
        losses=Losses(counter_gaps=4),
        disk=DiskStatus(212_400_000_000, 5_000_000, 18_345, 0.04),
        queue=QueueStatus(1, 5, 600),
        session=SessionStatus(),
    )
