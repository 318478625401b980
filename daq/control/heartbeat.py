"""Whether a recorder is at work: what its watchdog looks at."""

from __future__ import annotations

from dataclasses import dataclass

STILL_S = 2.0
"""A loop that has not turned for so long hangs."""
DISK_S = 60.0
"""A disk may refuse for so long, with blocks held in memory; then a restart costs little more."""


@dataclass(frozen=True, slots=True)
class Beats:
    """When each part of a recorder was last seen at work; monotonic clock, s."""

    readers: tuple[tuple[str, float], ...]
    """Bus, and the last turn of its reader's loop; 0 before it was first tried."""
    writer_s: float
    """Last turn of the writer's loop."""
    durable_s: float
    """When all that was received was last on the disk; 0 before the journal's first block is."""


def standstill(beats: Beats, now_s: float) -> str:
    """Return which part hangs, empty if all are at work."""
    for name, turned_s in beats.readers:
        if turned_s and now_s - turned_s > STILL_S:
            return f"the reader of {name} has not turned for {now_s - turned_s:.1f} s"
    if now_s - beats.writer_s > STILL_S:
        return f"the writer has not turned for {now_s - beats.writer_s:.1f} s"
    if beats.durable_s and now_s - beats.durable_s > DISK_S:
        return f"nothing has reached the disk for {now_s - beats.durable_s:.0f} s"
    return ""
