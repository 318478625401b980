"""The recorder itself: queue, disk, clock, and the parts that look at the frames."""

from __future__ import annotations

from collections.abc import Mapping

from ..bench.config import RecorderConfig
from ..control.messages import DiskStatus, QueueStatus
from ..journal.disk_space import Room, low_text
from .inputs import Count, Key, Symptom

CLOCK_STEP_S = 0.05
"""Largest drift of the wall clock against the monotonic one, s, that is not taken for a step."""
_QUEUE_HIGH = 0.5


def host_symptoms(
    config: RecorderConfig, disk: DiskStatus, queue: QueueStatus, failed: Mapping[str, str]
) -> list[Symptom]:
    """Return the faults of the recorder itself."""
    found = []
    if disk.failed:
        held = f"; {disk.held_frames} frames are held in memory" if disk.held_frames else ""
        found.append(Symptom("journal_failed", "", f"{disk.failed}{held}"))
    if disk.warning:
        found.append(Symptom("journal_warning", "", disk.warning))
    if low := low_text(Room(disk.free_bytes, disk.total_bytes), config):
        found.append(Symptom("disk_low", "", low))
    if queue.blocks > _QUEUE_HIGH * queue.room:
        found.append(Symptom("queue_high", "", f"{queue.blocks} of {queue.room} blocks wait"))
    found += [Symptom("consumer_failed", name, why) for name, why in failed.items()]
    return found


def dropped_since(before: int, after: int) -> dict[Key, Count]:
    """Return the frames that the queue had to leave out in this turn."""
    return {("queue_dropped", ""): Count(after - before)} if after > before else {}
