"""Defines the events that report blocks that are missing from a journal, as the recorder knows."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from ..runs import Event

DISK_GAP = "disk_gap"
"""Code: neither the disk nor the memory had room."""
FILE_GONE = "file_gone"
"""Code: a file was deleted or replaced while it was written."""
RETENTION = "retention"
"""Code: the oldest segments were deleted on purpose to make room, which is not a loss."""
ENDED = "ended"
"""Code: the recorder ended the recording, which will not be resumed."""


@dataclass(frozen=True, slots=True)
class Gap:
    """A span of blocks that is missing from the journal."""

    recording: str
    """Identity of the recording of these blocks."""
    first: int
    """Number of the first block."""
    stop: int
    """Number of the block after the last."""
    frames: int
    """Number of frames in these blocks."""
    file: str = ""
    """Name of the segment that contained them; empty if none did."""


def gap_event(code: str, t_ns: int, gap: Gap) -> Event:
    """Return the event that reports a gap; its value is the number of frames."""
    return Event(t_ns, code, gap.frames, json.dumps(asdict(gap)))


def parse_gap(event: Event) -> Gap | None:
    """Return the gap that an event reports; None if it is another event or cannot be read."""
    if event.code not in (DISK_GAP, FILE_GONE, RETENTION):
        return None
    try:
        return Gap(**json.loads(event.text))
    except (ValueError, TypeError):
        return None


def overlap(first: int, stop: int, gaps: Sequence[Gap]) -> int:
    """Return the number of block numbers of a span that are in gaps."""
    covered = 0
    for gap in sorted(gaps, key=lambda gap: gap.first):
        begin = max(first, gap.first)
        covered += max(0, min(stop, gap.stop) - begin)
        first = max(first, gap.stop)
    return covered
