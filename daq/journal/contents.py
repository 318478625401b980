"""Defines the content of a journal as read: blocks or all of it, and its losses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, freeze_arrays
from dbc.words import counted

from ..bus.source import HopLosses
from ..runlog.run_log import Code
from ..runs import Event
from .format import ENDED, JournalHead, StoredFrames, session_name

_NOTES = 20
"""Largest number of notes that are given in full in one line."""


@dataclass(frozen=True, slots=True)
class JournalLoss:
    """The parts of a journal that are missing.

    `bytes_cut`: bytes at the ends of segments that are no complete block.  `blocks_corrupt`: places
    between blocks that are damaged.  `blocks_missing`: blocks, in addition, that are missing.
    `frames_dropped`: frames that the recorder itself reported as lost: disk and memory were full,
    or a file was deleted while it was written.  `notes`: the losses in words, with their files.
    """

    bytes_cut: int = 0
    blocks_corrupt: int = 0
    blocks_missing: int = 0
    frames_dropped: int = 0
    notes: tuple[str, ...] = ()

    @property
    def any(self) -> bool:
        """True if any written data are missing."""
        return bool(
            self.bytes_cut or self.blocks_corrupt or self.blocks_missing or self.frames_dropped
        )

    @property
    def text(self) -> str:
        """The notes on one line, only the first if there are many; empty if there are none."""
        more = len(self.notes) - _NOTES
        last = (counted(more, "more note"),) if more > 0 else ()
        return "; ".join((*self.notes[:_NOTES], *last))


@dataclass(frozen=True, slots=True)
class JournalBlock:
    """A block of a recording: frames or events.

    `losses`: counted up to the block, over all processes that wrote the recording.  `stored`: its
    frames; None if it holds `events`.
    """

    losses: HopLosses
    stored: StoredFrames | None = None
    events: tuple[Event, ...] = ()

    @property
    def frames(self) -> FrameBatch:
        """The frames, unpacked at each access."""
        return self.stored.frames if self.stored else FrameBatch.empty()


@dataclass(frozen=True, slots=True)
class HopCounts:
    """Cumulative losses between wire and journal, one row for each block."""

    t_ns: NDArray[np.int64]
    """Latest time stamp up to the block, ns, shape (m,); never decreases."""
    counts: NDArray[np.int64]
    """The fields of `HopLosses`, shape (m, 4)."""

    def __post_init__(self) -> None:
        freeze_arrays(self, "t_ns", "counts")

    def between(self, start_ns: int, stop_ns: int) -> HopLosses:
        """Return the losses of all blocks that overlap a span of time, start <= t <= stop.

        A loss belongs to a block, not to a frame, so the span is extended to complete blocks.
        """
        before = int(np.searchsorted(self.t_ns, start_ns, side="left")) - 1
        last = min(int(np.searchsorted(self.t_ns, stop_ns, side="left")), len(self.t_ns) - 1)
        if last < 0:
            return HopLosses()
        lost = self.counts[last] - (self.counts[before] if before >= 0 else 0)
        return HopLosses(*map(int, lost))


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """A recording in a folder, without its frames.

    `head`: its clocks are those of the first segment.  `segments`: in order.  `next_number`: of the
    next block.  `frames`: number of frames recorded.  `first_ns`, `last_ns`: earliest and latest
    time stamp, ns; 0 without frames.  `events`: all of them; the run log is a fold over them.
    """

    head: JournalHead
    segments: tuple[Path, ...]
    next_number: int
    frames: int
    first_ns: int
    last_ns: int
    events: tuple[Event, ...]

    @property
    def ended(self) -> bool:
        """True if its recorder ended it; else a recorder may resume it."""
        return any(event.code == ENDED for event in self.events)

    @property
    def bumps(self) -> int:
        """Number of bumps that are runs."""
        return sum(event.code == Code.BUMP for event in self.events)

    @property
    def session_name(self) -> str:
        """Name of its session file."""
        return session_name(self.head.first_segment)


@dataclass(frozen=True, slots=True)
class JournalContents:
    """A journal in memory: all of its `frames`, or only those around the bumps.

    `hops`: losses between wire and journal.  `lost`: losses of the files themselves.
    """

    head: JournalHead
    frames: FrameBatch
    events: tuple[Event, ...]
    hops: HopCounts
    lost: JournalLoss
