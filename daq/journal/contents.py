"""What a journal holds, read back: blocks, or all of it, and an account of what is missing."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..bus.source import HopLosses
from ..runs import Event
from .format import JournalHead

_NOTES = 20


def session_name(first_segment: int) -> str:
    """Return the name of a recording's session file, from the number of its first segment."""
    return f"session_{first_segment:04d}.h5"


@dataclass(frozen=True, slots=True)
class JournalLoss:
    """What a journal should hold and does not."""

    bytes_cut: int = 0
    """Bytes at the ends of segments that are no whole record."""
    blocks_corrupt: int = 0
    """Blocks whose checksum does not fit."""
    blocks_missing: int = 0
    """Blocks that should lie between others and do not."""
    frames_dropped: int = 0
    """Frames that the recorder itself reported as lost: disk and memory were full, or a file was
    deleted while it was written."""
    segments_unclosed: int = 0
    """Segments that end without the mark of a proper end: the writer was killed or its disk full.
    By itself no loss."""
    notes: tuple[str, ...] = ()
    """The same in words, with the names of the files."""

    @property
    def any(self) -> bool:
        """Whether something that was written is missing."""
        return bool(
            self.bytes_cut or self.blocks_corrupt or self.blocks_missing or self.frames_dropped
        )

    @property
    def text(self) -> str:
        """The notes on one line, the first of them if there are many; empty if there are none."""
        more = len(self.notes) - _NOTES
        told = self.notes[:_NOTES] + ((f"{more} more notes",) if more > 0 else ())
        return "; ".join(told)


@dataclass(frozen=True, slots=True)
class JournalBlock:
    """One message of the journal: frames or events."""

    frames: FrameBatch
    """Empty in a block of events."""
    losses: HopLosses
    """Cumulative counts up to this block."""
    events: tuple[Event, ...] = ()
    """Empty in a block of frames."""


@dataclass(frozen=True, slots=True)
class HopCounts:
    """Cumulative losses between wire and journal, one row a block."""

    t_ns: NDArray[np.int64]
    """Latest time stamp up to the block, shape (m,); never decreases."""
    counts: NDArray[np.int64]
    """The fields of `HopLosses`, shape (m, 4)."""

    def between(self, start_ns: int, stop_ns: int) -> HopLosses:
        """Return the losses of all blocks that reach into a span of time.

        A loss is known to a block, not to a frame: the span is widened to whole blocks.
        """
        before = int(np.searchsorted(self.t_ns, start_ns, side="left")) - 1
        last = min(int(np.searchsorted(self.t_ns, stop_ns, side="left")), len(self.t_ns) - 1)
        if last < 0:
            return HopLosses()
        lost = self.counts[last] - (self.counts[before] if before >= 0 else 0)
        return HopLosses(*map(int, lost))


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """A recording in a folder, without its frames."""

    recording: str
    """Its identity."""
    segments: tuple[Path, ...]
    """In order."""
    first_segment: int
    """Number of its first segment, which may have been deleted since to make room."""
    bytes: int
    frames: int
    """`bytes`, `frames`: in all segments."""
    first_ns: int
    last_ns: int
    """`first_ns`, `last_ns`: time stamps of the first frame and the latest; 0 if there is none."""
    bumps: int
    """Bumps that are runs."""
    ended: bool
    """Whether its recorder ended it; else it may be taken up again."""

    @property
    def session_name(self) -> str:
        """Name of its session file."""
        return session_name(self.first_segment)


@dataclass(frozen=True, slots=True)
class JournalTail:
    """Where a recording stands, for a recorder that takes it up again."""

    head: JournalHead
    """Of its first segment."""
    next_number: int
    """Of the next block."""
    t_ns: int
    """Latest time stamp; 0 if there is none."""
    frames: int
    """Recorded so far."""
    events: tuple[Event, ...]
    """All of them: the book is a fold over them."""
    ended: bool
    """Whether it was ended, so that nothing is to be added."""
    segments: tuple[Path, ...]
    """In order."""
    first_segment: int
    """Number of its first segment, which may have been deleted since to make room."""

    @property
    def session_name(self) -> str:
        """Name of its session file."""
        return session_name(self.first_segment)


@dataclass(frozen=True, slots=True)
class JournalContents:
    """A journal in memory: all of its frames, or those around the bumps."""

    head: JournalHead
    """bench.toml, DBC, software and clocks."""
    frames: FrameBatch
    """In order of arrival."""
    events: tuple[Event, ...]
    """In order."""
    hops: HopCounts
    """Losses on the way to the journal."""
    lost: JournalLoss
    """What the files themselves have lost."""

    @property
    def bench_text(self) -> str:
        """bench.toml in full."""
        return self.head.bench_text

    @property
    def dbc_text(self) -> str:
        """The DBC in full."""
        return self.head.dbc_text
