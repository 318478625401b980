"""The recorder itself: queue, disk, clock, and the parts that look at the frames."""

from __future__ import annotations

from collections.abc import Mapping

from ..config import RecorderConfig
from ..messages import DiskStatus, QueueStatus
from .symptoms import Count, Key, Symptom

CLOCK_STEP_S = 0.05
"""A wall clock that has moved so far against the monotonic one was set."""
_QUEUE_HIGH = 0.5
_DISK_LOW_RESERVES = 5.0


def host_symptoms(
    config: RecorderConfig, disk: DiskStatus, queue: QueueStatus, failed: Mapping[str, str]
) -> list[Symptom]:
    """Return what is wrong with the recorder.

    Parameters
    ----------
    config : RecorderConfig
        Its limits.
    disk, queue : DiskStatus, QueueStatus
        As published.
    failed : mapping of str to str
        Parts that were switched off, and why.
    """
    found = []
    if disk.failed:
        held = f"; {disk.held_frames} frames are held in memory" if disk.held_frames else ""
        found.append(Symptom("journal_failed", "", f"{disk.failed}{held}"))
    if disk.free_bytes < _DISK_LOW_RESERVES * config.reserve_bytes:
        text = (
            f"{disk.free_bytes / 1e9:.2f} GB left; recording stops at "
            f"{config.reserve_bytes / 1e9:.2f} GB"
        )
        found.append(Symptom("disk_low", "", text))
    if queue.blocks > _QUEUE_HIGH * queue.room:
        found.append(Symptom("queue_high", "", f"{queue.blocks} of {queue.room} blocks wait"))
    found += [Symptom("consumer_failed", name, why) for name, why in failed.items()]
    return found


def dropped_since(before: int, after: int) -> dict[Key, Count]:
    """Return the frames that the queue had to leave out in this turn."""
    return {("queue_dropped", ""): Count(after - before)} if after > before else {}
