"""Reads journals up to where a crash has cut them, with an exact account of what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, DataEnd, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader
from numpy.typing import NDArray

from dbc.frames import FrameBatch, read_only

from ..bus.source import HopLosses
from ..errors import InputError
from ..runs import Event
from .contents import HopCounts, JournalBlock, JournalContents, JournalLoss
from .format import EVENTS_TOPIC, FRAMES_TOPIC, JournalHead, unpack_events, unpack_frames
from .gaps import DISK_GAP, FILE_GONE, RETENTION, Gap, parse_gap
from .scan import LARGEST_RECORD_BYTES, holds_blocks, read_head

_GAP_TEXTS = {
    DISK_GAP: "found no room on the disk nor in memory",
    FILE_GONE: "gone: the file was taken away while it was written",
    RETENTION: "between the runs given up to make room",
}


def read_journal(
    paths: Sequence[Path], spans: Sequence[tuple[int, int]] | None = None
) -> JournalContents:
    """Read all segments of a recording.

    `paths`: as for `JournalReader`.  `spans`, sequence of (int, int): keep only frames with time
    stamps in these spans, start <= t < stop, ns, so that memory grows with the spans, not with the
    recording.  Without it all frames are kept.  Raises InputError as `JournalReader`.
    """
    reader = JournalReader(paths)
    frames: list[FrameBatch] = []
    events: list[Event] = []
    hops = _HopTable()
    for block in reader:
        hops.add(block)
        events += block.events
        if len(block.frames):
            kept = block.frames if spans is None else _within(block.frames, spans)
            if len(kept):
                frames.append(kept)
    return JournalContents(
        reader.head, FrameBatch.concatenate(frames), tuple(events), hops.counts(), reader.lost
    )


def _within(frames: FrameBatch, spans: Sequence[tuple[int, int]]) -> FrameBatch:
    first_ns, last_ns = int(frames.t_ns.min()), int(frames.t_ns.max())
    wanted: NDArray[np.bool_] = np.zeros(len(frames), bool)
    for start_ns, stop_ns in spans:
        if start_ns <= last_ns and first_ns < stop_ns:
            wanted |= (frames.t_ns >= start_ns) & (frames.t_ns < stop_ns)
    return frames.select(wanted)


class _HopTable:
    """Losses block by block; of blocks without new losses only the first and the last are kept."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, ...]] = []
        self._t_ns = 0

    def add(self, block: JournalBlock) -> None:
        if len(block.frames):
            self._t_ns = max(self._t_ns, int(block.frames.t_ns.max()))
        row = (self._t_ns, *_counts(block.losses))
        # `HopCounts.between` uses the row before a span and the first one behind it: with both ends
        # of every level kept, it returns the same losses.
        if len(self._rows) >= 2 and self._rows[-1][1:] == row[1:] == self._rows[-2][1:]:
            self._rows[-1] = row
        else:
            self._rows.append(row)

    def counts(self) -> HopCounts:
        table = np.array(self._rows, np.int64).reshape(-1, 5)
        return HopCounts(read_only(table[:, 0]), read_only(table[:, 1:]))


class JournalReader:
    """Iterates once over the blocks of a recording; `lost` is exact after that.

    `paths`: the segments of one recording, in any order, also of several processes.  Raises
    InputError if a file cannot be read or is not a journal, if files belong to different
    recordings, or if none has a complete head.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._lost = JournalLoss()
        self._missing: list[tuple[str, int, int]] = []  # file, first number, number after the last
        self._gaps: dict[tuple[str, Gap], None] = {}
        self._open: list[JournalLoss] = []  # losses that the next segment may repair
        heads = {path: read_head(path) for path in paths}
        found = {path: head for path, head in heads.items() if head is not None}
        for path in heads.keys() - found.keys():
            # Usually killed while it was created: nothing in it was reported as written.
            note = f"{path.name}: has no complete beginning"
            cut = path.stat().st_size if holds_blocks(path) else 0
            self._lost = _plus(self._lost, JournalLoss(bytes_cut=cut, notes=(note,)))
        if not found:
            where = ", ".join(str(path) for path in paths) or "journal"
            raise InputError(where, "holds no recording", "name the files journal_*.mcap")
        self._paths = sorted(found, key=lambda path: found[path][1])
        self._heads = {path: found[path][0] for path in self._paths}
        self.head: JournalHead = self._heads[self._paths[0]]
        for path, head in self._heads.items():
            if head.identity != self.head.identity:
                raise InputError(
                    str(path),
                    f"belongs to another recording than {self._paths[0].name}",
                    "read one recording at a time",
                )

    @property
    def lost(self) -> JournalLoss:
        """The losses found; exact once all blocks have been read."""
        lost = self._lost
        gaps = [gap for _, gap in self._gaps]
        for name, first, stop in self._missing:
            missing = stop - first - _overlap(first, stop, gaps)
            if missing > 0:
                note = f"{name}: {missing} blocks missing before it"
                lost = _plus(lost, JournalLoss(blocks_missing=missing, notes=(note,)))
        for code, gap in self._gaps:
            text = f"{gap.file}: {gap.frames}" if gap.file else f"{gap.frames}"
            dropped = 0 if code == RETENTION else gap.frames
            note = f"{text} frames {_GAP_TEXTS[code]}"
            lost = _plus(lost, JournalLoss(frames_dropped=dropped, notes=(note,)))
        return lost

    def __iter__(self) -> Iterator[JournalBlock]:
        expected = 0
        losses = before = HopLosses()
        head = self.head
        for path in self._paths:
            if self._heads[path] != head:  # another process: it repeats no block
                self._settle()
                before, head = losses, self._heads[path]
            topics: dict[int, str] = {}
            for record in self._records(path):
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                if not isinstance(record, Message):
                    continue
                frames, counted = FrameBatch.empty(), losses
                events: tuple[Event, ...] = ()
                try:
                    if topics.get(record.channel_id) == FRAMES_TOPIC:
                        number, frames, since_start = unpack_frames(record.data)
                        counted = _sum(before, since_start)
                    elif topics.get(record.channel_id) == EVENTS_TOPIC:
                        number, events = unpack_events(record.data)
                    else:
                        raise ValueError("no such channel")
                except ValueError as error:
                    note = f"{path.name}: block after {expected} is corrupt: {error}"
                    self._open.append(JournalLoss(blocks_corrupt=1, notes=(note,)))
                    continue
                if number < expected:
                    continue  # written twice: the first time its fdatasync failed
                if number == expected:
                    self._open.clear()  # the block that was cut off before is this one
                corrupt = sum(lost.blocks_corrupt for lost in self._open)
                if number > expected + corrupt:
                    self._missing.append((path.name, expected + corrupt, number))
                self._settle()
                expected, losses = number + 1, counted
                for event in events:
                    if (gap := parse_gap(event)) and gap.recording == head.identity:
                        # Reported again before the segment with it was deleted: counts once.
                        self._gaps[event.code, gap] = None
                yield JournalBlock(frames, losses, events)
        self._settle()

    def _records(self, path: Path) -> Iterator[McapRecord]:
        size = path.stat().st_size
        good = 0
        in_body = False
        with path.open("rb") as file:
            try:
                for record in StreamReader(file, record_size_limit=LARGEST_RECORD_BYTES).records:
                    in_body |= isinstance(record, Message | DataEnd)
                    if in_body and file.tell() - good != _whole_bytes(record):
                        # The library skips records of an unknown kind.
                        note = f"{path.name}: a block is not one any more"
                        self._open.append(JournalLoss(blocks_corrupt=1, notes=(note,)))
                    if isinstance(record, DataEnd):
                        return  # a summary follows, which is not needed here
                    good = file.tell()
                    yield record
            except Exception:  # torn bytes raise any exception of the parser
                self._lost = _plus(self._lost, _unclosed(path))
                if size > good and not _is_end(path, good):
                    note = f"{path.name}: last {size - good} bytes torn"
                    self._open.append(JournalLoss(bytes_cut=size - good, notes=(note,)))

    def _settle(self) -> None:
        """Count the losses that no later block has repaired."""
        for lost in self._open:
            self._lost = _plus(self._lost, lost)
        self._open.clear()


def _is_end(path: Path, at: int) -> bool:
    """Return whether the record cut off belongs to the end of the file, not to a block."""
    with path.open("rb") as file:
        file.seek(at)
        return file.read(1) in (bytes([Opcode.METADATA]), bytes([Opcode.DATA_END]))


def _unclosed(path: Path) -> JournalLoss:
    return JournalLoss(segments_unclosed=1, notes=(f"{path.name}: not closed",))


def _plus(a: JournalLoss, b: JournalLoss) -> JournalLoss:
    return JournalLoss(*(x + y for x, y in zip(astuple(a), astuple(b), strict=True)))


def _sum(a: HopLosses, b: HopLosses) -> HopLosses:
    return HopLosses(*(x + y for x, y in zip(_counts(a), _counts(b), strict=True)))


def _counts(losses: HopLosses) -> tuple[int, ...]:
    return losses.bus_dropped, losses.bus_garbled, losses.restamped, losses.queue_dropped


def _overlap(first: int, stop: int, gaps: Sequence[Gap]) -> int:
    """Return how many block numbers of a span lie in gaps."""
    covered = 0
    for gap in sorted(gaps, key=lambda gap: gap.first):
        begin = max(first, gap.first)
        covered += max(0, min(stop, gap.stop) - begin)
        first = max(first, gap.stop)
    return covered


def _whole_bytes(record: McapRecord) -> int:
    """Return the size in the file of a record after the head, 0 for one of another kind."""
    if isinstance(record, Message):
        return 9 + 22 + len(record.data)
    if isinstance(record, Metadata):
        texts = (record.name, *record.metadata, *record.metadata.values())
        return 9 + 4 + sum(4 + len(text.encode()) for text in texts)
    return 9 + 4 if isinstance(record, DataEnd) else 0
