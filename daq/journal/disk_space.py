"""What once a second is asked of the disk: is our file still there, and is there room."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from ..bench.config import RecorderConfig

LOW_RESERVES = 10
"""Less room than so many reserves is worth a warning."""
LOW_SHARE = 0.1
"""And so is less than this share of the disk."""
_RESUME_RESERVES = 1.05
"""Recording is taken up again above so many reserves: not at the first byte."""


@dataclass(frozen=True, slots=True)
class Room:
    """Room on a disk, bytes."""

    free: int
    total: int


def room_on(folder: Path) -> Room:
    """Return the room on the disk of a folder.

    Raises
    ------
    OSError
        If the folder is not there.
    """
    usage = shutil.disk_usage(folder)
    return Room(usage.free, usage.total)


def too_little(room: Room, limits: RecorderConfig, stopped: bool) -> bool:
    """Whether nothing must be written any more; `stopped` if that was so before."""
    reserves = _RESUME_RESERVES if stopped else 1.0
    return room.free < reserves * limits.reserve_bytes


def low_text(room: Room, limits: RecorderConfig) -> str:
    """Return a warning if the room goes to its end, else nothing."""
    if room.free < LOW_RESERVES * limits.reserve_bytes or room.free < LOW_SHARE * room.total:
        return (
            f"{room.free / 1e9:.2f} GB ({room.free / max(room.total, 1):.0%}) left on the disk; "
            f"recording stops at {limits.reserve_bytes / 1e9:.2f} GB"
        )
    return ""


def place_of(folder: Path) -> tuple[int, int] | None:
    """Return what identifies a folder: its disk and its number there; None if it is gone."""
    try:
        found = folder.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def taken_away(path: Path, own: os.stat_result, size: int) -> str:
    """Say what happened to the open file behind our back; empty if nothing did.

    Parameters
    ----------
    path : Path
        Its name.
    own : os.stat_result
        Of the open file.
    size : int
        Bytes written to it.
    """
    try:
        named = path.stat()
    except OSError:
        return "was deleted"
    if own.st_nlink == 0 or (named.st_dev, named.st_ino) != (own.st_dev, own.st_ino):
        return "was replaced by another file"
    return "was cut short" if own.st_size < size else ""
