"""Watches the recorder itself: queue, disk, clock, and the consumers of the frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dbc.finding import Finding
from dbc.words import counted

from ..bench.config import RecorderConfig
from ..control.messages import Alarm, DiskStatus, QueueStatus, Status, StorageStatus
from ..journal.disk_space import Room, low_text
from .inputs import Count, Key, fault

CLOCK_STEP_S = 0.05
"""Largest difference between wall clock and monotonic clock, s, that is not taken as a step."""
_QUEUE_HIGH = 0.5
_SAYS_SO = ("not_recording", "journal_failed")
"""Codes of alarms that already state the cause when frames are not recorded."""
_NOT_RECORDING_S = 0.9
"""Time, s, after which frames that arrive and are not stored raise an alarm.  A daemon's main
thread has a cycle of a tenth of a second, so the alarm comes within one second."""


def host_symptoms(
    config: RecorderConfig,
    disk: DiskStatus,
    queue: QueueStatus,
    failed: Mapping[str, str],
    storage: StorageStatus,
) -> list[Finding]:
    """Return the symptoms of the recorder itself."""
    found = _not_recording(storage)
    if disk.failed:
        frames = counted(disk.held_frames, "frame is", "frames are")
        held = f"; {frames} held in memory" if disk.held_frames else ""
        found.append(fault("journal_failed", "", f"{disk.failed}{held}"))
    if disk.warning:
        found.append(fault("journal_warning", "", disk.warning))
    if low := low_text(Room(disk.free_bytes, disk.total_bytes), config):
        found.append(fault("disk_low", "", low))
    if queue.blocks > _QUEUE_HIGH * queue.room:
        found.append(fault("queue_high", "", f"{queue.blocks} of {queue.room} blocks wait"))
    found += [fault("consumer_failed", name, why) for name, why in failed.items()]
    return found


def with_not_recording(status: Status, storage: StorageStatus, wall_ns: int) -> Status:
    """Return a status with the alarm that a hanging writer of the recorder cannot raise itself.

    `status`: the last published one.  Returns the same object if there is no alarm to add.
    """
    found = _not_recording(storage)
    if not found or any(alarm.code in _SAYS_SO for alarm in status.alarms):
        return status
    since_ns = wall_ns - round(storage.late_s * 1e9)
    alarm = Alarm(found[0].code, "", found[0].text, found[0].advice, since_ns)
    return replace(status, alarms=(alarm, *status.alarms), storage=storage)


def _not_recording(storage: StorageStatus) -> list[Finding]:
    if storage.late_s < _NOT_RECORDING_S:
        return []
    text = f"frames arrive, and none was stored for {storage.late_s:.1f} s"
    return [fault("not_recording", "", text)]


def dropped_since(before: int, after: int) -> dict[Key, Count]:
    """Return the number of frames that the queue dropped in this cycle."""
    return {("queue_dropped", ""): Count(after - before)} if after > before else {}
