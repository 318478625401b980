"""Reads journals: every block that is whole, with an exact account of all losses."""

from __future__ import annotations

import json
from bisect import bisect
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, freeze_arrays
from dbc.words import InputError, counted, printable

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
    next block.  `frames`: number of frames recorded.  `last_ns`: latest time stamp, ns; 0 without
    frames.  `events`: all of them; the run log is a fold over them.
    """

    head: JournalHead
    segments: tuple[Path, ...]
    next_number: int
    frames: int
    last_ns: int
    events: tuple[Event, ...]

    @property
    def ended(self) -> bool:
        """True if its recorder ended it; else, or if events follow, a recorder may resume it."""
        return any(event.code == ENDED for event in self.events[-1:])

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
    """Return head and summary of a segment.

    A segment with its proper end has a summary, which makes this fast at any size.  `later`: the
    next segment with blocks; a block whose sync failed may be in both, and is counted there.

    Raises InputError as `read_segment`, or if no block is whole.
    """
    if (end := end_of(path)) is not None:
        return SegmentInfo(path, end.recording, end.writer, *end.head)
    blocks, _ = read_segment(path)
    if not blocks:
        raise InputError(str(path), "has no whole block of a journal", ADVICE)
    _, number, writer, recording, _ = blocks[0]
    heads = [block.head[0] for block in blocks if block.kind == Kind.HEAD]
    counted_blocks = [
        block
        for block in blocks
        if block.kind in (Kind.EVENTS, Kind.FRAMES)
        and (later is None or later.recording != recording or block.number < later.summary.first)
    ]
    summary = Summary(number, number).extended(counted_blocks)
    return SegmentInfo(path, recording, writer, heads[-1] if heads else None, summary)


def _scanned(newest_first: Iterable[Path]) -> Iterator[SegmentInfo]:
    """Yield head and summary of each segment that can be read."""
    later = None
    for path in newest_first:
        with suppress(InputError):  # a file of another program, or deleted meanwhile
            info = scan(path, later)
            if info.summary.stop > info.summary.first:
                later = info
            yield info


def _recording(infos: Sequence[SegmentInfo]) -> RecordingInfo | None:
    """Return the recording of segments, which must be in order; None if none has a head."""
    head = next((info.head for info in infos if info.head), None)
    if head is None:
        return None
    return RecordingInfo(
        head=replace(head, wall_ns=infos[0].writer),
        segments=tuple(info.path for info in infos),
        next_number=max(info.summary.stop for info in infos),
        frames=sum(info.summary.frames for info in infos),
        last_ns=max(info.summary.last_ns for info in infos),
        events=tuple(event for info in infos for _, event in info.summary.events),
    )


def last_recording(folder: Path) -> RecordingInfo | None:
    """Return the newest recording in a folder of which a head can be read; None if there is none.

    It reads no other segments than those of that recording: a folder may have thousands.
    """
    scanned = _scanned(reversed(segments_in(folder)))
    for _, infos in groupby(scanned, key=lambda info: info.recording):
        if recording := _recording(list(infos)[::-1]):
            return recording
    return None


def recordings(folder: Path) -> tuple[RecordingInfo, ...]:
    """Return the recordings in a folder, as `recordings_of`; empty if there is none."""
    with suppress(InputError):
        return recordings_of(segments_in(folder))
    return ()


def recordings_of(segments: Sequence[Path]) -> tuple[RecordingInfo, ...]:
    """Return the recordings of these segments, the oldest first.

    A file that cannot be read, or whose recording has no head, is added to the segments of the
    recording before it, whose reader counts it as lost.  Raises InputError if none can be read.
    """
    infos_by_recording: dict[str, list[SegmentInfo]] = {}
    for info in _scanned(sorted(segments, key=segment_number, reverse=True)):
        infos_by_recording.setdefault(info.recording, []).insert(0, info)
    newest_first = [_recording(infos) for infos in infos_by_recording.values()]
    in_order = [recording for recording in newest_first[::-1] if recording]
    if not in_order:
        for path in segments:
            scan(path)  # raises InputError with the reason, if this is a file that cannot be read
        raise InputError("journal", "holds no recording with a bench.toml and DBC", ADVICE)
    readable = {path for recording in in_order for path in recording.segments}
    first_numbers = [segment_number(recording.segments[0]) for recording in in_order]
    for path in sorted(set(segments) - readable, key=segment_number):
        k = max(bisect(first_numbers, segment_number(path)) - 1, 0)
        in_order[k] = replace(in_order[k], segments=(*in_order[k].segments, path))
    return tuple(in_order)


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
        """The notes on one line, which ends in dots if they are very many."""
        return printable("; ".join(self.notes), 2000)


@dataclass(frozen=True, slots=True)
class HopCounts:
    """Cumulative losses between wire and journal, by block; of equal ones, only both ends."""

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
        if not len(self.t_ns):
            return HopLosses()
        first_row, last_row = np.searchsorted(self.t_ns, [start_ns, stop_ns])
        counted_before = self.counts[first_row - 1] if first_row > 0 else 0
        counted_until = self.counts[min(last_row, len(self.t_ns) - 1)]
        return HopLosses(*map(int, counted_until - counted_before))

    def after(self, stop_ns: int) -> HopCounts:
        """Return the counts without the losses that `between` returns up to a time."""
        last_row = min(int(np.searchsorted(self.t_ns, stop_ns)), len(self.t_ns) - 1)
        t_ns = self.t_ns[last_row:].copy()
        t_ns[:1] = np.iinfo(np.int64).min  # before any span: its counts are subtracted from all
        return HopCounts(t_ns, self.counts[last_row:])


@dataclass(frozen=True, slots=True)
class JournalContents:
    """The content of a recording, beside the events that `RecordingInfo` has.

    `windows`: its frames in each window of time.  `hops`: losses between wire and journal.  `lost`:
    losses of the files themselves.
    """

    windows: tuple[FrameBatch, ...]
    hops: HopCounts
    lost: JournalLoss


def read_windows(recording: RecordingInfo, windows: Sequence[tuple[int, int]]) -> JournalContents:
    """Return the content of a recording with its frames in windows of time, which may overlap.

    `windows`: start <= t < stop, ns; memory grows with them, not with the recording.
    """
    reader = JournalReader(recording)
    pieces: list[list[FrameBatch]] = [[] for _ in windows]
    hop_rows: list[tuple[int, ...]] = []  # of `HopCounts`: time stamp, losses
    latest_ns = 0
    for losses, block in reader:
        t_ns = block.t_ns
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
        frames: FrameBatch | None = None  # most blocks are in no window, and are not unpacked
        for k, (start_ns, stop_ns) in enumerate(windows):
            if start_ns <= last_ns and first_ns < stop_ns:
                frames = frames or block.frames
                pieces[k].append(frames.within([windows[k]]))
    hop_table = np.array(hop_rows, np.int64).reshape(-1, 5)
    hops = HopCounts(hop_table[:, 0], hop_table[:, 1:])
    # Joined one after another, so that not all of them are in memory twice.
    joined = tuple(FrameBatch.concatenate(pieces.pop(0)) for _ in windows)
    return JournalContents(joined, hops, reader.lost)


class JournalReader:
    """Iterates once over the blocks of a recording; `lost` is exact after that.

    `head`: that of the recording.  Yields blocks of frames or events, with the losses up to each.
    """

    def __init__(self, recording: RecordingInfo) -> None:
        self.head, self._segments = recording.head, recording.segments
        self._cut: list[tuple[int, str]] = []  # bytes that are no block, and a note on them
        self._gaps: list[tuple[str, int, int]] = []  # file, first missing block, block after them
        self._deleted: tuple[tuple[int, int], ...] = ()  # spans of `deleted_blocks`

    @property
    def lost(self) -> JournalLoss:
        """The losses found; exact once all blocks have been read."""
        notes = [note for _, note in self._cut]
        blocks_missing = 0
        for name, first, stop in self._gaps:
            spans = [(max(first, begin), min(stop, end)) for begin, end in self._deleted]
            missing = stop - first - sum(max(0, end - begin) for begin, end in spans)
            if missing > 0:
                notes.append(f"{name}: {counted(missing, 'block')} missing before it")
                blocks_missing += missing
        return JournalLoss(sum(size for size, _ in self._cut), blocks_missing, tuple(notes))

    def __iter__(self) -> Iterator[tuple[HopLosses, Block]]:
        """Yield each block of frames or events once, with the losses up to it, and note gaps."""
        next_number, writer = 0, self.head.wall_ns  # number of the next block; process that writes
        losses = earlier_losses = HopLosses()  # up to a block; of the processes before its writer
        torn: list[tuple[int, str]] = []  # ends of segments: the next block may be the one cut off
        for path in self._segments:
            blocks, torn_bytes = self._read(path)
            for block in blocks:
                if block.writer != writer:  # another process, which repeats no block
                    self._cut, torn = self._cut + torn, []
                    earlier_losses, writer = losses, block.writer
                if block.number < next_number:
                    continue  # written twice: the first time its fdatasync failed
                if block.number > next_number:
                    self._cut, torn = self._cut + torn, []
                    self._gaps.append((path.name, next_number, block.number))
                next_number = block.number
                if block.kind == Kind.END:  # its number is that of the next block
                    continue
                next_number += 1
                torn = []  # the block that was cut off before is this one
                if block.kind == Kind.FRAMES:
                    losses = earlier_losses.plus(block.losses)
                for event in block.events:
                    self._deleted = deleted_blocks(event) or self._deleted
                yield losses, block
            if torn_bytes:
                note = f"{path.name}: its last {counted(torn_bytes, 'byte')} are no whole block"
                torn.append((torn_bytes, note))
        self._cut += torn

    def _read(self, path: Path) -> tuple[list[Block], int]:
        """Return the numbered blocks of a segment, and the size of its torn end, bytes.

        A file that cannot be read, or is of another recording, is a loss and has no blocks.
        """
        try:
            blocks, torn_bytes = read_segment(path)
            if all(block.recording == self.head.recording for block in blocks):
                return [block for block in blocks if block.kind != Kind.HEAD], torn_bytes
            problem = "has lost every copy of its bench.toml and DBC"
        except InputError as error:
            problem = error.what
        self._cut.append((path.stat().st_size if path.is_file() else 0, f"{path.name}: {problem}"))
        return [], 0


def deleted_event(t_ns: int, blocks: Sequence[tuple[int, int]], frames: int) -> Event:
    """Return the event on the blocks of a recording that were deleted on purpose.

    `blocks`: all such spans until now: first block, block after.  `frames`: number deleted last.
    """
    return Event(t_ns, RETENTION, frames, json.dumps({"deleted": blocks}))


def deleted_blocks(event: Event) -> tuple[tuple[int, int], ...]:
    """Return the spans of blocks that an event reports, as `deleted_event`; else none."""
    if event.code != RETENTION:
        return ()
    return tuple((int(first), int(stop)) for first, stop in json.loads(event.text)["deleted"])
