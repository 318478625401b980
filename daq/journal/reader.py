"""Reads journals: every block that is whole, with an exact account of all losses."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
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
    PATTERNS,
    Block,
    JournalBlock,
    JournalHead,
    Kind,
    Summary,
    last_block,
    read_segment,
    segment_number,
    session_name,
    unpack_events,
    unpack_frames,
    unpack_head,
)

RETENTION = "retention"
"""Code of the event that lists the blocks of its recording that were deleted to make room."""
_NOTES = 20
"""Largest number of notes that are given in full in one line."""


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
        """The notes on one line, only the first if there are many; empty if there are none."""
        more = len(self.notes) - _NOTES
        last = (counted(more, "more note"),) if more > 0 else ()
        return "; ".join((*self.notes[:_NOTES], *last))


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


# Finds the recordings in a folder of segments without reading their frames ------------------------


@dataclass(frozen=True, slots=True)
class SegmentInfo:
    """A segment, without its frames.

    `writer`: the process that wrote it, as `JournalHead.wall_ns`.  `head`: None if each copy of it
    is damaged.  `blocks`: of a segment without a proper end, number and frame count of each block
    of frames, because the last ones may also be in the next segment.
    """

    path: Path
    recording: str
    writer: int
    head: JournalHead | None
    summary: Summary
    blocks: tuple[tuple[int, int], ...] = ()


def scan(path: Path) -> SegmentInfo:
    """Return the content of a segment.

    A segment with its proper end has a summary, which makes this fast at any size.

    Raises InputError as `read_segment`, or if no block is whole.
    """
    if (end := last_block(path)) is not None:
        stated, summary = unpack_head(end.content)
        assert summary is not None
        return SegmentInfo(path, end.recording, end.writer, stated, summary)
    blocks = read_segment(path).blocks
    if not blocks:
        raise InputError(str(path), "has no whole block of a journal", ADVICE)
    heads, first = [unpack_head(b.content)[0] for b in blocks if b.kind == Kind.HEAD], blocks[0]
    numbers = [b.number for b in blocks if b.kind in (Kind.EVENTS, Kind.FRAMES)]
    events: list[tuple[int, Event]] = []
    sizes: list[tuple[int, int]] = []
    spans_ns: list[int] = []
    for block in blocks:
        if block.kind == Kind.EVENTS:
            events += ((block.number, event) for event in unpack_events(block.content))
        elif block.kind == Kind.FRAMES and (stored := unpack_frames(block.content)).size:
            sizes.append((block.number, stored.size))
            spans_ns += (int(stored.t_ns.min()), int(stored.t_ns.max()))
    summary = Summary(
        numbers[0] if numbers else first.number,
        numbers[-1] + 1 if numbers else first.number,
        sum(frames for _, frames in sizes),
        min(spans_ns, default=0),
        max(spans_ns, default=0),
        tuple(events),
    )
    head = heads[-1] if heads else None
    return SegmentInfo(path, first.recording, first.writer, head, summary, tuple(sizes))


def segments_in(folder: Path) -> tuple[Path, ...]:
    """Return the segments in a folder, also empty ones, in order of their numbers."""
    paths = [path for pattern in PATTERNS for path in folder.glob(pattern)]
    return tuple(sorted(paths, key=segment_number))


def next_segment(folder: Path) -> int:
    """Return the number of the next segment."""
    return 1 + max(map(segment_number, segments_in(folder)), default=0)


def recordings(folder: Path) -> tuple[RecordingInfo, ...]:
    """Return the recordings in a folder, the oldest first; what cannot be read is left out."""
    return tuple(_newest_first(folder))[::-1]


def recordings_of(segments: Sequence[Path]) -> tuple[RecordingInfo, ...]:
    """Return the recordings of these segments, the oldest first.

    A file that cannot be read, or whose recording has no head, is the last of the recording before
    it, so that a reader counts what is lost with it.  Raises InputError if none can be read.
    """
    groups: dict[str, list[SegmentInfo]] = {}
    fault = InputError("journal", "holds no recording with a bench.toml and DBC", ADVICE)
    in_order = sorted(segments, key=segment_number)
    for path in in_order:
        try:
            info = scan(path)
            groups.setdefault(info.recording, []).append(info)
        except InputError as error:
            fault = error
    states = [state for group in groups.values() if (state := _state(group))]
    if not states:
        raise fault
    readable = {path for state in states for path in state.segments}
    for path in (path for path in in_order if path not in readable):
        firsts = [segment_number(state.segments[0]) for state in states]
        k = max(0, sum(number < segment_number(path) for number in firsts) - 1)
        states[k] = replace(states[k], segments=(*states[k].segments, path))
    return tuple(states)


def recording_of(segments: Sequence[Path]) -> RecordingInfo:
    """Return the recording of these segments; as `recordings_of`.

    Raises InputError also if they belong to several recordings.
    """
    one, *others = recordings_of(segments)
    if others:
        problem = f"belongs to another recording than {one.segments[0].name}"
        raise InputError(str(others[0].segments[0]), problem, "read one recording at a time")
    return one


def last_recording(folder: Path) -> RecordingInfo | None:
    """Return the state of the newest recording in a folder; None if there is none."""
    return next(_newest_first(folder), None)


def last_campaign(folder: Path) -> RecordingInfo | None:
    """Return the state of the newest recording that is a campaign; None if there is none."""
    return next((state for state in _newest_first(folder) if state.head.campaign), None)


def _newest_first(folder: Path) -> Iterator[RecordingInfo]:
    """Yield the recordings' states one by one, because a folder may have thousands of segments."""

    def readable() -> Iterator[SegmentInfo]:
        for path in reversed(segments_in(folder)):
            with suppress(InputError, OSError):  # from another program, or deleted meanwhile
                yield scan(path)

    for _, group in groupby(readable(), key=lambda info: info.recording):
        if state := _state(list(group)[::-1]):
            yield state


def _state(infos: Sequence[SegmentInfo]) -> RecordingInfo | None:
    """Return the recording of segments, which must be in order; None if none has a head."""
    head = next((info.head for info in infos if info.head), None)
    if head is None:
        return None
    stamped = [info.summary for info in infos if info.summary.frames]
    # Blocks whose sync failed are also in the next segment.
    with_blocks = [info for info in infos if info.summary.stop > info.summary.first]
    twice = sum(
        frames
        for info, after in pairwise(with_blocks)
        for number, frames in info.blocks
        if number >= after.summary.first
    )
    events: list[Event] = []
    stop = 0
    for info in infos:
        fresh = [(number, event) for number, event in info.summary.events if number >= stop]
        events += (event for _, event in fresh)
        stop = max((number + 1 for number, _ in fresh), default=stop)
    return RecordingInfo(
        replace(head, wall_ns=infos[0].writer),
        tuple(info.path for info in infos),
        max(info.summary.stop for info in infos),
        sum(info.summary.frames for info in infos) - twice,
        stamped[0].first_ns if stamped else 0,
        max(info.summary.last_ns for info in infos),
        tuple(events),
    )


# Reads the blocks ---------------------------------------------------------------------------------

_ALWAYS = (-(2**63), 2**63 - 1)


def read_journal(paths: Sequence[Path]) -> JournalContents:
    """Read all segments of a recording.

    `paths`: in any order.  Raises InputError as `recording_of`.
    """
    contents, (frames,) = read_windows(recording_of(paths), [_ALWAYS])
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
    rows: list[tuple[int, ...]] = []  # of `HopCounts`
    latest_ns = 0
    starts_ns, stops_ns = np.array(windows, np.int64).reshape(-1, 2).T
    for block in reader:
        t_ns = block.t_ns
        events += block.events
        latest_ns = int(t_ns.max(initial=latest_ns))
        row = (latest_ns, *block.losses)
        # `HopCounts.between` uses the row before a span and the first one after it.  Because both
        # ends of every level are kept, it returns the same losses.
        if len(rows) >= 2 and rows[-1][1:] == row[1:] == rows[-2][1:]:
            rows[-1] = row
        else:
            rows.append(row)
        if not len(t_ns):
            continue
        touched = np.flatnonzero((starts_ns <= t_ns.max()) & (t_ns.min() < stops_ns)).tolist()
        frames = block.frames if touched else FrameBatch.empty()  # most frames are in no window
        for k in touched:
            pieces[k].append(frames if windows[k] is _ALWAYS else frames.within([windows[k]]))
    table = np.array(rows, np.int64).reshape(-1, 5)
    hops = HopCounts(table[:, 0], table[:, 1:])
    none = FrameBatch.empty()
    contents = JournalContents(recording.head, none, tuple(events), hops, reader.lost)
    joined = []
    while pieces:  # joined one after another, so that not all of them are in memory twice
        joined.append(FrameBatch.concatenate(pieces.pop(0)))
    return contents, tuple(joined)


class JournalReader:
    """Iterates once over the blocks of a recording; `lost` is exact after that.

    `head`: that of the recording.
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
        lost = [*self._lost, *self._torn]
        for name, first, stop in self._missing:
            missing = stop - first
            for begin, end in sorted(self._deleted):
                missing -= max(0, min(stop, end) - max(first, begin))
                first = max(first, end)
            if missing > 0:
                note = f"{name}: {counted(missing, 'block')} missing before it"
                lost.append(JournalLoss(blocks_missing=missing, notes=(note,)))
        return JournalLoss(
            sum(each.bytes_cut for each in lost),
            sum(each.blocks_missing for each in lost),
            tuple(note for each in lost for note in each.notes),
        )

    def __iter__(self) -> Iterator[JournalBlock]:
        expected, writer = 0, self.head.wall_ns
        losses = before = HopLosses()
        for path in self._segments:
            for block in self._blocks(path):
                is_of_another = block.writer != writer  # a process that repeats no block
                if is_of_another:
                    before, writer = losses, block.writer
                if is_of_another or block.number > expected:
                    self._lost += self._torn
                    self._torn.clear()
                if block.number < expected:
                    continue  # written twice: the first time its fdatasync failed
                if block.number > expected:
                    self._missing.append((path.name, expected, block.number))
                if block.kind == Kind.END:
                    expected = block.number
                    continue
                self._torn.clear()  # the block that was cut off before is this one
                expected = block.number + 1
                if block.kind == Kind.FRAMES:
                    stored = unpack_frames(block.content)
                    losses = before.plus(stored.losses)
                    yield stored._replace(losses=losses)
                else:
                    events = unpack_events(block.content)
                    for event in events:
                        self._deleted |= set(deleted_blocks(event))
                    yield JournalBlock(losses, events=events)

    def _blocks(self, path: Path) -> Iterator[Block]:
        """Yield the numbered blocks of a segment; note what else it holds."""
        try:
            content = read_segment(path)
        except InputError as error:
            size = path.stat().st_size if path.is_file() else 0
            self._lost.append(JournalLoss(size, notes=(f"{path.name}: {error.what}",)))
            return
        if any(block.recording != self.head.recording for block in content.blocks):
            note = f"{path.name}: has lost every copy of its bench.toml and DBC"
            self._lost.append(JournalLoss(path.stat().st_size, notes=(note,)))
            return
        yield from (b for b in content.blocks if b.kind in (Kind.FRAMES, Kind.EVENTS, Kind.END))
        if content.torn_bytes:
            self._torn.append(JournalLoss(content.torn_bytes, notes=(content.torn_text,)))


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
