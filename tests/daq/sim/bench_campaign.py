"""A campaign recorded from the simulated bench by the recorder, turn by turn, no threads."""

from __future__ import annotations

import math
from collections.abc import Sequence

from daq.bench.config import Bench, bench_codec
from daq.bus.source import BusError, HopLosses, Now
from daq.control.messages import (
    Arm,
    DiskStatus,
    Phase,
    Status,
    StorageStatus,
    Until,
)
from daq.journal.writer import JournalWriter
from daq.recorder.recording import Recording
from daq.runs import Event
from daq.sim.bench import Fault, SimulatedBench
from daq.sim.car import SimulatedCar
from dbc import FrameBatch

START_NS = 1_800_000_000_000_000_000
DISK = DiskStatus(10**12, 0, 0, 0.0)
NO_LOSSES = HopLosses()


class Kept(JournalWriter):
    """Keeps in memory what a recorder stores."""

    def __init__(self) -> None:
        self.frames: list[FrameBatch] = []
        self.events: list[Event] = []

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        self.frames.append(frames)

    def append_events(self, events: Sequence[Event]) -> None:
        self.events += events


def record(
    bench: Bench, seed: int, fault: Fault | None = None, speed: float = math.inf, turns: int = 6000
) -> tuple[Kept, Status]:
    """Record until the campaign is complete; return what was stored and the last status."""
    codec, kept = bench_codec(bench), Kept()
    recorder = Recording(bench, codec, kept)
    statuses: list[Status] = []
    source = SimulatedBench(
        bench, codec, SimulatedCar(), seed, speed, lambda: statuses[-1], fault, START_NS
    )
    now = Now(START_NS, 0.0)
    statuses.append(recorder.status(now))
    armed = False
    for _ in range(turns):
        try:
            batch = source.read(0.02)
        except BusError:
            batch = FrameBatch.concatenate([])
        if len(batch):
            now = Now(int(batch.t_ns[-1]), (int(batch.t_ns[-1]) - START_NS) * 1e-9)
        recorder.store(batch, NO_LOSSES)
        recorder.look(now, (), DISK, StorageStatus())
        if not armed and len(batch):
            recorder.carry_out(Arm(Until.COMPLETE), "test", now)
            armed = True
        statuses[:] = [recorder.status(now)]
        if statuses[-1].phase is Phase.COMPLETE:
            break
    return kept, statuses[-1]
