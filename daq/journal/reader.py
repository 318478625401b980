"""Reads journals: every block that is whole, with an exact account of all losses."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, freeze_arrays
from dbc.words import InputError, counted

from ..bus.source import HopLosses
from ..runlog import Code
from ..runs import Event
from .segment import (
    ADVICE,
    ENDED,
    Block,
    JournalHead,
    Kind,
    Summary,
    end_of,
    read_segment,
    segment_number,
)

# Finds the recordings in a folder of segments without reading their frames ------------------------


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """A segment, without its frames.

    `writer`: the process that wrote it, as `JournalHead.wall_ns`.  `head`: None if damaged.
    """

    path: Path
    recording: str
    writer: int
    head: JournalHead | None
    summary: Summary


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


def segments_in(folder: Path) -> tuple[Path, ...]:
    """Return the segments in a folder, also empty ones, in order of their numbers."""
    # Until November 2026 the segment being written was an open one.
    paths = (*folder.glob("journal_*.bbj"), *folder.glob("open_*.bbj"))
    return tuple(sorted(paths, key=segment_number))


def next_segment(folder: Path) -> int:
    """Return the number of the next segment."""
    return 1 + max(map(segment_number, segments_in(folder)), default=0)


def scan(path: Path, later: SegmentInfo | None = None) -> SegmentInfo:
    """Return the content of a segment.

    A segment with its proper end has a summary, which makes this fast at any size.  `later`: the
    next segment with blocks; a block whose sync failed may be in both, and is counted there.

    Raises InputError as `read_segment`, or if no block is whole.
    """
    if (end := end_of(path)) is not None:
        return SegmentInfo(path, end.recording, end.writer, *end.head)
    blocks, _ = read_segment(path)
    if not blocks:
        raise InputError(str(path), "has no whole block of a journal", ADVICE)
    first_block = blocks[0]
    heads = [block.head[0] for block in blocks if block.kind == Kind.HEAD]
    kept = [block for block in blocks if block.kind in (Kind.EVENTS, Kind.FRAMES)]
    if later is not None and later.recording == first_block.recording:
        kept = [block for block in kept if block.number < later.summary.first]
    summary = Summary(first_block.number, first_block.number).extended(kept)
    return SegmentInfo(
        path, first_block.recording, first_block.writer, heads[-1] if heads else None, summary
    )


def _scanned(newest_first: Iterable[Path]) -> Iterator[SegmentInfo | InputError]:
    """Yield the content of segments, or the reasons why they cannot be read."""
    later = None
    for path in newest_first:
        try:
            info = scan(path, later)
        except InputError as error:  # from another program, or deleted meanwhile
            yield error
            continue
        if info.summary.stop > info.summary.first:
            later = info
        yield info


def _recording(infos: Sequence[SegmentInfo]) -> RecordingInfo | None:
    """Return the recording of segments, which must be in order; None if none has a head."""
    head = next((info.head for info in infos if info.head), None)
    if head is None:
        return None
    stamped = [info.summary for info in infos if info.summary.frames]
    return RecordingInfo(
        replace(head, wall_ns=infos[0].writer),
        tuple(info.path for info in infos),
        max(info.summary.stop for info in infos),
        sum(summary.frames for summary in stamped),
        stamped[0].first_ns if stamped else 0,
        max((summary.last_ns for summary in stamped), default=0),
        tuple(event for info in infos for _, event in info.summary.events),
    )


def _newest_first(folder: Path) -> Iterator[RecordingInfo]:
    """Yield recordings one by one, because a folder may have thousands of segments."""
    scanned = _scanned(reversed(segments_in(folder)))
    infos = (info for info in scanned if isinstance(info, SegmentInfo))
    for _, group in groupby(infos, key=lambda info: info.recording):
        if recording := _recording(list(group)[::-1]):
            yield recording


def recordings(folder: Path) -> tuple[RecordingInfo, ...]:
    """Return the recordings in a folder, the oldest first; what cannot be read is left out."""
    return tuple(_newest_first(folder))[::-1]


def last_recording(folder: Path) -> RecordingInfo | None:
    """Return the newest recording in a folder; None if there is none."""
    return next(_newest_first(folder), None)


def recordings_of(segments: Sequence[Path]) -> tuple[RecordingInfo, ...]:
    """Return the recordings of these segments, the oldest first.

    A file that cannot be read, or whose recording has no head, is the last of the recording before
    it, so that a reader counts what is lost with it.  Raises InputError if none can be read.
    """
    reason = InputError("journal", "holds no recording with a bench.toml and DBC", ADVICE)
    infos_of: dict[str, list[SegmentInfo]] = {}
    for info in _scanned(sorted(segments, key=segment_number, reverse=True)):
        if isinstance(info, InputError):
            reason = info
        else:
            infos_of.setdefault(info.recording, []).insert(0, info)
    found = [recording for infos in infos_of.values() if (recording := _recording(infos))][::-1]
    if not found:
        raise reason
    readable = {path for recording in found for path in recording.segments}
    first_numbers = [segment_number(recording.segments[0]) for recording in found]
    for path in sorted(set(segments) - readable, key=segment_number):
        begun_before = sum(number < segment_number(path) for number in first_numbers)
        owner = max(0, begun_before - 1)
        found[owner] = replace(found[owner], segments=(*found[owner].segments, path))
    return tuple(found)


def recording_of(segments: Sequence[Path]) -> RecordingInfo:
    """Return the recording of these segments; as `recordings_of`.

    Raises InputError also if they belong to several recordings.
    """
    recording, *others = recordings_of(segments)
    if others:
        problem = f"belongs to another recording than {recording.segments[0].name}"
        raise InputError(str(others[0].segments[0]), problem, "read one recording at a time")
    return recording


# Reads the blocks of a recording ------------------------------------------------------------------

RETENTION = "retention"
"""Code of the event that lists the blocks of its recording that were deleted to make room."""


@dataclass(frozen=True, slots=True)
class JournalLoss:
    """The parts of a journal that are missing.

    `bytes_cut`: bytes at the ends of segments that are no complete block.  `blocks_missing`: blocks
    between others that are damaged or absent, or found no room.  `notes`: the losses in words, with
    their files.
    """

    bytes_cut: int = 0
    blocks_missing: int = 0
    notes: tuple[str, ...] = ()

    @property
    def any(self) -> bool:
        """True if any written data are missing."""
        return bool(self.bytes_cut or self.blocks_missing)

    @property
    def text(self) -> str:
        """The notes on one line, only the first 20 of many."""
        more = len(self.notes) - 20
        return "; ".join(self.notes[:20]) + (f"; {counted(more, 'more note')}" if more > 0 else "")


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
        row_before = int(np.searchsorted(self.t_ns, start_ns, side="left")) - 1
        last_row = min(int(np.searchsorted(self.t_ns, stop_ns, side="left")), len(self.t_ns) - 1)
        if last_row < 0:
            return HopLosses()
        counted_before = self.counts[row_before] if row_before >= 0 else 0
        lost = self.counts[last_row] - counted_before
        return HopLosses(*map(int, lost))

    def after(self, stop_ns: int) -> HopCounts:
        """Return the counts without the losses that `between` returns up to a time."""
        last_row = min(int(np.searchsorted(self.t_ns, stop_ns, side="left")), len(self.t_ns) - 1)
        if last_row < 0:
            return self
        t_ns = self.t_ns[last_row:].copy()
        t_ns[0] = np.iinfo(np.int64).min  # before any span: its counts are subtracted from all
        return HopCounts(t_ns, self.counts[last_row:])


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


def read_journal(paths: Sequence[Path]) -> JournalContents:
    """Read all segments of a recording.

    `paths`: in any order.  Raises InputError as `recording_of`.
    """
    contents, (frames,) = read_windows(recording_of(paths), [(-(2**63), 2**63 - 1)])
    return replace(contents, frames=frames)


def read_windows(
    recording: RecordingInfo, windows: Sequence[tuple[int, int]]
) -> tuple[JournalContents, tuple[FrameBatch, ...]]:
    """Read the frames of a recording in windows of time, which may overlap.

    `windows`: start <= t < stop, ns; memory grows with them, not with the recording.  Returns all
    else that is in the segments, and the frames of each window.
    """
    reader = JournalReader(recording)
    pieces: list[list[FrameBatch]] = [[] for _ in windows]
    events: list[Event] = []
    hop_rows: list[tuple[int, ...]] = []  # of `HopCounts`: time stamp, losses
    latest_ns = 0
    for losses, block in reader:
        t_ns = block.t_ns
        events += block.events
        latest_ns = int(t_ns.max(initial=latest_ns))
        hop_row = (latest_ns, *losses)
        # `HopCounts.between` uses the row before a span and the first one after it.  Because both
        # ends of every level are kept, it returns the same losses.
        if len(hop_rows) >= 2 and hop_rows[-1][1:] == hop_row[1:] == hop_rows[-2][1:]:
            hop_rows.pop()
        hop_rows.append(hop_row)
        if not len(t_ns):
            continue
        first_ns, last_ns = int(t_ns.min()), int(t_ns.max())
        frames: FrameBatch | None = None  # most blocks are in no window
        for k, (start_ns, stop_ns) in enumerate(windows):
            if start_ns <= last_ns and first_ns < stop_ns:
                frames = frames or block.frames
                is_whole = start_ns <= first_ns and last_ns < stop_ns
                pieces[k].append(frames if is_whole else frames.within([windows[k]]))
    hop_table = np.array(hop_rows, np.int64).reshape(-1, 5)
    hops = HopCounts(hop_table[:, 0], hop_table[:, 1:])
    contents = JournalContents(recording.head, FrameBatch.empty(), tuple(events), hops, reader.lost)
    joined = []
    while pieces:  # joined one after another, so that not all of them are in memory twice
        joined.append(FrameBatch.concatenate(pieces.pop(0)))
    return contents, tuple(joined)


class JournalReader:
    """Iterates once over the blocks of a recording; `lost` is exact after that.

    `head`: that of the recording.  Yields blocks of frames or events, with the losses up to each.
    """

    def __init__(self, recording: RecordingInfo) -> None:
        self.head, self._segments = recording.head, recording.segments
        self._lost: list[JournalLoss] = []
        self._torn: list[JournalLoss] = []  # ends of segments: the next block may be the one cut
        self._missing: list[tuple[str, int, int]] = []  # file, first block, block after the last
        self._deleted: set[tuple[int, int]] = set()  # first block, block after the last

    @property
    def lost(self) -> JournalLoss:
        """The losses found; exact once all blocks have been read."""
        losses = [*self._lost, *self._torn]
        for name, first_missing, stop in self._missing:
            missing = stop - first_missing
            for first_deleted, stop_deleted in sorted(self._deleted):
                missing -= max(0, min(stop, stop_deleted) - max(first_missing, first_deleted))
                first_missing = max(first_missing, stop_deleted)
            if missing > 0:
                note = f"{name}: {counted(missing, 'block')} missing before it"
                losses.append(JournalLoss(blocks_missing=missing, notes=(note,)))
        return JournalLoss(
            sum(each.bytes_cut for each in losses),
            sum(each.blocks_missing for each in losses),
            tuple(note for each in losses for note in each.notes),
        )

    def __iter__(self) -> Iterator[tuple[HopLosses, Block]]:
        expected, writer = 0, self.head.wall_ns  # number of the next block; process that writes
        losses = earlier_losses = HopLosses()
        for path in self._segments:
            for block in self._blocks(path):
                is_new_writer = block.writer != writer  # a process that repeats no block
                if is_new_writer:
                    earlier_losses, writer = losses, block.writer
                if is_new_writer or block.number > expected:
                    self._lost += self._torn
                    self._torn.clear()
                if block.number < expected:
                    continue  # written twice: the first time its fdatasync failed
                if block.number > expected:
                    self._missing.append((path.name, expected, block.number))
                if block.kind == Kind.END:  # its number is that of the next block
                    expected = block.number
                    continue
                self._torn.clear()  # the block that was cut off before is this one
                expected = block.number + 1
                if block.kind == Kind.FRAMES:
                    losses = earlier_losses.plus(block.losses)
                for event in block.events:
                    self._deleted |= set(deleted_blocks(event))
                yield losses, block

    def _blocks(self, path: Path) -> Iterator[Block]:
        """Yield the numbered blocks of a segment; note what else it holds."""
        try:
            blocks, torn_bytes = read_segment(path)
        except InputError as error:
            size = path.stat().st_size if path.is_file() else 0
            self._lost.append(JournalLoss(size, notes=(f"{path.name}: {error.what}",)))
            return
        if any(block.recording != self.head.recording for block in blocks):
            note = f"{path.name}: has lost every copy of its bench.toml and DBC"
            self._lost.append(JournalLoss(path.stat().st_size, notes=(note,)))
            return
        yield from (block for block in blocks if block.kind != Kind.HEAD)
        if torn_bytes:
            note = f"{path.name}: its last {counted(torn_bytes, 'byte')} are no whole block"
            self._torn.append(JournalLoss(torn_bytes, notes=(note,)))


def deleted_event(t_ns: int, blocks: Sequence[tuple[int, int]], frames: int) -> Event:
    """Return the event on the blocks of a recording that are deleted on purpose, in `frames`."""
    return Event(t_ns, RETENTION, frames, json.dumps({"deleted": blocks}))


def deleted_blocks(event: Event) -> tuple[tuple[int, int], ...]:
    """Return the spans of blocks that an event reports as deleted on purpose.

    Each is the number of the first block, and of the block after the last.
    """
    if event.code != RETENTION:
        return ()
    return tuple((int(first), int(stop)) for first, stop in json.loads(event.text)["deleted"])
