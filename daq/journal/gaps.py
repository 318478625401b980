"""Blocks that are missing from a journal with the recorder's knowledge, told by events in it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from ..runs import Event

DISK_GAP = "disk_gap"
"""Neither the disk nor the memory had room."""
FILE_GONE = "file_gone"
"""A file was deleted or replaced while it was written."""
RETENTION = "retention"
"""The oldest segments made room, on purpose: no loss."""
ENDED = "ended"
"""The recording was ended by its recorder: nothing is to be taken up again."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A span of blocks that is not in the journal any more."""

    recording: str
    """Identity of the recording that the blocks are missing from."""
    first: int
    stop: int
    """Numbers of the first block and of the one after the last."""
    frames: int
    """In these blocks."""
    file: str = ""
    """Name of the segment that held them; empty if none did."""


def gap_event(code: str, t_ns: int, gap: Gap) -> Event:
    """Return the event that tells of a gap; its value is the number of frames."""
    return Event(t_ns, code, gap.frames, json.dumps(asdict(gap), sort_keys=True))


def parse_gap(event: Event) -> Gap | None:
    """Return the gap that an event tells of; None if it is another event or cannot be read."""
    if event.code not in (DISK_GAP, FILE_GONE, RETENTION):
        return None
    try:
        return Gap(**json.loads(event.text))
    except (ValueError, TypeError):
        return None
