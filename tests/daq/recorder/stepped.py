"""A recording that a test steps block by block."""

from __future__ import annotations

from collections.abc import Sequence

from daq.bench.config import Bench
from daq.bus.source import HopLosses, LinkFacts, Now
from daq.control.messages import (
    Arm,
    DiskStatus,
    Status,
    StorageStatus,
    Until,
)
from daq.journal.writer import JournalWriter
from daq.recorder.recording import Recording
from daq.runs import Event
from dbc import Codec, FrameBatch

from ..small_campaign import START_NS, codes

DISK = DiskStatus(10**12, 0, 0, 0.0)
LINK = LinkFacts("can0", 1_000_000, True, "", "", 0.0, 0, HopLosses())


def now(block: FrameBatch | None = None) -> Now:
    t_ns = int(block.t_ns[-1]) if block is not None and len(block) else START_NS
    return Now(t_ns, 100.0 + (t_ns - START_NS) * 1e-9)


def look(recording: Recording, now: Now, links: Sequence[LinkFacts] = ()) -> tuple[Event, ...]:
    """Look at what was stored, on a host that has no trouble."""
    return recording.look(now, links, DISK, StorageStatus())


def step(
    recording: Recording,
    batch: FrameBatch,
    hops: HopLosses,
    now: Now,
    links: Sequence[LinkFacts] = (),
) -> tuple[Event, ...]:
    """Store one block and look at it."""
    recording.store(batch, hops)
    return look(recording, now, links)


def feed(recording: Recording, given: Sequence[FrameBatch]) -> list[Event]:
    return [
        event
        for block in given
        for event in step(recording, block, HopLosses(), now(block), [LINK])
    ]


def runs_of(events: Sequence[Event]) -> list[tuple[str, str]]:
    return [pair for pair in codes(events) if pair[0] in ("bump", "run_end")]


def status_of(recording: Recording) -> Status:
    return recording.status(now())


def armed(
    bench: Bench, codec: Codec, store: JournalWriter, until: Until = Until.COMPLETE
) -> Recording:
    recording = Recording(bench, codec, store)
    recording.carry_out(Arm(until), "Ann", now())
    return recording
