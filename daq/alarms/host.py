"""The recorder itself: queue, disk, clock, and the parts that look at the frames."""

from __future__ import annotations

from collections.abc import Mapping

from dbc.finding import Finding

from ..bench.config import RecorderConfig
from ..control.messages import DiskStatus, QueueStatus
from ..journal.disk_space import Room, low_text
from .inputs import Count, Key, fault

CLOCK_STEP_S = 0.05
"""Largest drift of the wall clock against the monotonic one, s, that is not taken for a step."""
_QUEUE_HIGH = 0.5


def host_symptoms(
    config: RecorderConfig, disk: DiskStatus, queue: QueueStatus, failed: Mapping[str, str]
) -> list[Finding]:
    """Return the faults of the recorder itself."""
    found = []
    if disk.failed:
        held = f"; {disk.held_frames} frames are held in memory" if disk.held_frames else ""
        found.append(fault("journal_failed", "", f"{disk.failed}{held}"))
    if disk.warning:
        found.append(fault("journal_warning", "", disk.warning))
    if low := low_text(Room(disk.free_bytes, disk.total_bytes), config):
        found.append(fault("disk_low", "", low))
    if queue.blocks > _QUEUE_HIGH * queue.room:
        found.append(fault("queue_high", "", f"{queue.blocks} of {queue.room} blocks wait"))
    found += [fault("consumer_failed", name, why) for name, why in failed.items()]
    return found


def dropped_since(before: int, after: int) -> dict[Key, Count]:
    """Return the frames that the queue had to leave out in this turn."""
    return {("queue_dropped", ""): Count(after - before)} if after > before else {}
