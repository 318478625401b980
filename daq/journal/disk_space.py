"""Checks about once per second the free space on the disk and that the open file still exists."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..bench.config import RecorderConfig
from .segment import Segment

LOW_RESERVES = 10
"""Free space, as a multiple of the reserve, below which there is a warning."""
LOW_SHARE = 0.1
"""Free share of the disk below which there is also a warning."""
_RESUME_RESERVES = 1.05
"""Free space, as a multiple of the reserve, from which a stopped recording continues: more than
that at which it stops, so that it does not stop again at once."""


@dataclass(frozen=True, slots=True)
class Room:
    """Space on a disk, bytes."""

    free: int
    total: int


def room_on(folder: Path) -> Room:
    """Return the space on the disk of a folder.

    Raises OSError if the folder does not exist.
    """
    usage = shutil.disk_usage(folder)
    return Room(usage.free, usage.total)


def too_little(room: Room, limits: RecorderConfig, stopped: bool) -> bool:
    """Return whether recording must stop; `stopped`: True if it has already stopped."""
    reserves = _RESUME_RESERVES if stopped else 1.0
    return room.free < reserves * limits.reserve_bytes


def low_text(room: Room, limits: RecorderConfig) -> str:
    """Return a warning if there is little space, else an empty text."""
    if room.free < LOW_RESERVES * limits.reserve_bytes or room.free < LOW_SHARE * room.total:
        return (
            f"{room.free / 1e6:,.0f} MB ({room.free / max(room.total, 1):.0%}) left on the disk; "
            f"recording stops at {limits.reserve_bytes / 1e6:,.0f} MB"
        )
    return ""


def place_of(folder: Path) -> tuple[int, int] | None:
    """Return the identity of a folder: its disk and its number on it; None if it is gone."""
    try:
        found = folder.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def taken_away(path: Path, opened: os.stat_result, size: int) -> str:
    """Return what another process did to the open file, in words; empty if nothing.

    `opened`: state of the open file.  `size`: bytes written to it.
    """
    try:
        named = path.stat()
    except OSError:
        return "was deleted"
    if opened.st_nlink == 0 or (named.st_dev, named.st_ino) != (opened.st_dev, opened.st_ino):
        return "was replaced by another file"
    return "was truncated" if opened.st_size < size else ""


class DiskWatch:
    """Watches the disk of a journal: its space, and that folder and open file still exist.

    `room`: last measured space.  `stopped`: True while there is too little space to record.
    """

    def __init__(self, folder: Path, room_on: Callable[[Path], Room]) -> None:
        self.room = Room(0, 0)
        self.stopped = False
        self._folder = folder
        self._room_on = room_on
        self._place: tuple[int, int] | None = None

    def settle(self) -> None:
        """Take the folder that now has the name as the folder of the journal."""
        self._place = place_of(self._folder)

    def measure(self, limits: RecorderConfig) -> None:
        """Measure the space, and decide whether recording must stop.

        Raises OSError if the folder does not exist.
        """
        self.room = self._room_on(self._folder)
        self.stopped = too_little(self.room, limits, self.stopped)

    def taken_text(self, segment: Segment | None) -> str:
        """Return what another process did to folder or open segment, in words; empty if nothing."""
        if place_of(self._folder) != self._place:
            return f"folder {self._folder.name} was removed or its disk was unmounted"
        if segment is None:
            return ""
        try:
            text = taken_away(segment.path, segment.file.stat(), segment.size)
        except OSError as error:
            text = f"cannot be checked: {error.strerror or error}"
        return f"{segment.path.name} {text}" if text else ""
