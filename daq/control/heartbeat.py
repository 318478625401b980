"""Defines the heartbeats of a recorder's threads, from which the watchdog finds a hung thread."""

from __future__ import annotations

from dataclasses import dataclass

STILL_S = 2.0
"""Seconds without a cycle after which a loop counts as hung."""
DISK_S = 60.0
"""Time, s, for which a disk may refuse data while blocks wait in memory; a restart then loses
little more."""


@dataclass(frozen=True, slots=True)
class Heartbeats:
    """Monotonic time of the last cycle of each thread of a recorder, s."""

    readers: tuple[tuple[str, float], ...]
    """Name of each bus, and the last cycle of its reader; 0 before the first cycle."""
    writer_s: float
    """Last cycle of the writer."""
    durable_s: float
    """Last time at which all received frames were on the disk; 0 before the first block is
    stored."""


def standstill(heartbeats: Heartbeats, now_s: float) -> str:
    """Return a text that names the thread that hangs; empty if none does."""
    for name, turned_s in heartbeats.readers:
        if turned_s and now_s - turned_s > STILL_S:
            return f"the reader of {name} has had no cycle for {now_s - turned_s:.1f} s"
    if now_s - heartbeats.writer_s > STILL_S:
        return f"the writer has had no cycle for {now_s - heartbeats.writer_s:.1f} s"
    if heartbeats.durable_s and now_s - heartbeats.durable_s > DISK_S:
        return f"nothing has reached the disk for {now_s - heartbeats.durable_s:.0f} s"
    return ""
