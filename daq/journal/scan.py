"""Finds the content of a journal segment, without its frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..runs import Event
from .format import EventBlock, JournalHead
from .segment_reader import CorruptBlock, SegmentReader
from .summary import Summary, read_summary


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """A segment, without its frames."""

    path: Path
    """The file."""
    recording: str
    """Identity of the recording that it belongs to."""
    number: int
    """Number of the segment in its folder."""
    first_segment: int
    """Number of the first segment of its recording."""
    bytes: int
    """Size of the file, bytes."""
    first: int
    """Number of the first block."""
    stop: int
    """Number of the block after the last; equal to `first` if there is none."""
    frames: int
    """Number of frames in all its blocks."""
    first_ns: int
    """Earliest time stamp (in older versions: that of the first frame), ns; 0 if there is none."""
    last_ns: int
    """Latest time stamp, ns; 0 if there is none."""
    events: tuple[tuple[int, Event], ...]
    """Events in order, each with the number of its block."""
    sealed: bool
    """True if it has a proper end."""
    blocks: tuple[tuple[int, int], ...] = ()
    """Number and frame count of each of its blocks of frames, if it has no proper end: the last
    blocks may also be in the next segment."""


def read_head(path: Path) -> tuple[JournalHead, int] | None:
    """Return head and segment number, None if the file has no complete head.

    Raises InputError if the file cannot be read or is not a journal.
    """
    with SegmentReader(path) as segment:
        return segment.head


def scan(path: Path) -> SegmentInfo | None:
    """Return the content of a segment, None if it ends within its head.

    A segment with its proper end has a summary, which makes this fast at any size.

    Raises InputError as `read_head`.
    """
    with SegmentReader(path) as segment:
        if segment.head is None:
            return None
        head, number = segment.head
        size = segment.file.size
        summary = read_summary(segment.file)
        sealed = summary is not None
        blocks: tuple[tuple[int, int], ...] = ()
        if summary is None:
            summary, blocks = _walk(segment)
            sealed = segment.sealed
    return SegmentInfo(
        path, head.identity, number, head.first_segment or number, size, summary.first,
        summary.stop, summary.frames, summary.first_ns, summary.last_ns, summary.events, sealed,
        () if sealed else blocks,
    )  # fmt: skip


def _walk(segment: SegmentReader) -> tuple[Summary, tuple[tuple[int, int], ...]]:
    """Return the content of a segment without a summary, and its blocks of frames."""
    first: int | None = None
    stop = frames = first_ns = last_ns = 0
    events: list[tuple[int, Event]] = []
    blocks: list[tuple[int, int]] = []
    for block in segment.blocks():
        if isinstance(block, CorruptBlock) or block.number < stop:
            continue
        first, stop = (block.number if first is None else first), block.number + 1
        if isinstance(block, EventBlock):
            events += ((block.number, event) for event in block.events)
        elif block.frames:
            frames += block.frames
            blocks.append((block.number, block.frames))
            earliest_ns = int(block.t_ns.min())
            first_ns = min(first_ns or earliest_ns, earliest_ns)
            last_ns = max(last_ns, int(block.t_ns.max()))
    return Summary(first or 0, stop, frames, first_ns, last_ns, tuple(events)), tuple(blocks)
