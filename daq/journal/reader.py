"""Reads journals up to the place where a crash cut them, with an exact account of all losses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import counted, plural

from ..bus.source import HopLosses
from ..errors import InputError
from ..runs import Event
from .contents import HopCounts, JournalBlock, JournalContents, JournalLoss
from .format import (
    DISK_GAP,
    FILE_GONE,
    RETENTION,
    EventBlock,
    FrameBlock,
    Gap,
    JournalHead,
    overlap,
    parse_gap,
)
from .segment_reader import CorruptBlock, SegmentReader

_GROUP_FRAMES = 4096
"""Approximate number of frames that are unpacked together: the cost of a call is shared by them."""
_GAP_TEXTS = {
    DISK_GAP: "found no room on the disk or in memory",
    FILE_GONE: "lost: the file was removed while it was written",
    RETENTION: "between the runs deleted to make room",
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
        hops.add(block, block.t_ns)
        events += block.events
        if block.stored:
            kept = block.frames if spans is None else block.frames.within(spans)
            if len(kept):
                frames.append(kept)
    return JournalContents(
        reader.head, FrameBatch.concatenate(frames), tuple(events), hops.counts(), reader.lost
    )


def read_windows(
    paths: Sequence[Path], windows: Sequence[tuple[int, int]]
) -> tuple[JournalContents, tuple[FrameBatch, ...]]:
    """Read the frames in windows of time, which may overlap, from segments of a recording.

    `windows`: start <= t < stop, ns.  Returns all else that is in the segments, and the frames of
    each window.  Raises InputError as `JournalReader`.
    """
    reader = JournalReader(paths)
    pieces: list[list[FrameBatch]] = [[] for _ in windows]
    events: list[Event] = []
    hops = _HopTable()
    starts_ns, stops_ns = np.array(windows, np.int64).reshape(-1, 2).T
    for block in reader:
        t_ns = block.t_ns
        hops.add(block, t_ns)
        events += block.events
        if not len(t_ns):
            continue
        touched = np.flatnonzero((starts_ns <= t_ns.max()) & (t_ns.min() < stops_ns)).tolist()
        frames = block.frames if touched else FrameBatch.empty()  # most frames are in no window
        for k in touched:
            pieces[k].append(frames.within([windows[k]]))
    none = FrameBatch.empty()
    contents = JournalContents(reader.head, none, tuple(events), hops.counts(), reader.lost)
    joined = []
    while pieces:  # joined one after another, so that not all of them are in memory twice
        joined.append(FrameBatch.concatenate(pieces.pop(0)))
    return contents, tuple(joined)


class _HopTable:
    """Losses block by block; of blocks without new losses only the first and the last are kept."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, ...]] = []
        self._t_ns = 0

    def add(self, block: JournalBlock, t_ns: NDArray[np.int64]) -> None:
        first = block.stored[0].frames if block.stored else 0
        for part in (t_ns[:first], t_ns[first:]) if len(t_ns) else (t_ns,):
            if len(part):
                self._t_ns = max(self._t_ns, int(part.max()))
            self._add_row((self._t_ns, *block.losses.counts))

    def _add_row(self, row: tuple[int, ...]) -> None:
        # `HopCounts.between` uses the row before a span and the first one after it.  Because both
        # ends of every level are kept, it returns the same losses.
        if len(self._rows) >= 2 and self._rows[-1][1:] == row[1:] == self._rows[-2][1:]:
            self._rows[-1] = row
        else:
            self._rows.append(row)

    def counts(self) -> HopCounts:
        table = np.array(self._rows, np.int64).reshape(-1, 5)
        return HopCounts(table[:, 0], table[:, 1:])


class JournalReader:
    """Iterates once over the blocks of a recording; `lost` is exact after that.

    `paths`: the segments of one recording, in any order, also of several processes.  Raises
    InputError if files belong to different recordings, or if none can be read and has a complete
    head.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._lost = JournalLoss()
        self._missing: list[tuple[str, int, int]] = []  # file, first block, block after the last
        self._gaps: dict[tuple[str, Gap], None] = {}
        self._open: list[JournalLoss] = []  # losses that the next segment may cancel
        found: dict[Path, tuple[JournalHead, int]] = {}
        refused: list[InputError] = []
        for path in paths:
            try:
                with SegmentReader(path) as segment:
                    if segment.head is not None:
                        found[path] = segment.head
                        continue
                    # Usually killed while it was created: nothing in it was reported as written.
                    note = f"{path.name}: has no complete beginning"
                    cut = segment.file.size if segment.holds_blocks() else 0
            except InputError as error:  # its beginning may be overwritten
                refused.append(error)
                note = f"{path.name}: {error.what}"
                cut = path.stat().st_size if path.is_file() else 0
            self._lost = _plus(self._lost, JournalLoss(bytes_cut=cut, notes=(note,)))
        if refused and not found:
            raise refused[0]
        if not found:
            where = ", ".join(str(path) for path in paths) or "journal"
            advice = "it is damaged at its beginning, or not a journal; journals are journal_*.mcap"
            raise InputError(where, "holds no recording", advice)
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
            missing = stop - first - overlap(first, stop, gaps)
            if missing > 0:
                note = f"{name}: {counted(missing, 'block')} missing before it"
                lost = _plus(lost, JournalLoss(blocks_missing=missing, notes=(note,)))
        for code, gap in self._gaps:
            text = f"{gap.file}: {gap.frames}" if gap.file else f"{gap.frames}"
            dropped = 0 if code == RETENTION else gap.frames
            note = f"{text} {plural(gap.frames, 'frame')} {_GAP_TEXTS[code]}"
            lost = _plus(lost, JournalLoss(frames_dropped=dropped, notes=(note,)))
        return lost

    def __iter__(self) -> Iterator[JournalBlock]:
        expected = 0
        losses = before = HopLosses()
        head = self.head
        group: list[FrameBlock] = []
        for path in self._paths:
            if self._heads[path] != head:  # another process, which repeats no block
                self._settle()
                if group:
                    yield JournalBlock(losses, tuple(group))
                    group = []
                before, head = losses, self._heads[path]
            for block in self._blocks(path):
                if isinstance(block, CorruptBlock):
                    note = f"{path.name}: block after {expected} is corrupt: {block.text}"
                    self._open.append(JournalLoss(blocks_corrupt=1, notes=(note,)))
                    continue
                if block.number < expected:
                    continue  # written twice: the first time its fdatasync failed
                if block.number != expected or self._open:
                    self._account(path, expected, block.number)
                expected = block.number + 1
                if group and (isinstance(block, EventBlock) or not _belongs(block, group)):
                    yield JournalBlock(losses, tuple(group))
                    group = []
                if isinstance(block, FrameBlock):
                    if not group:
                        losses = _sum(before, block.counts)
                    group.append(block)
                    continue
                for event in block.events:
                    if (gap := parse_gap(event)) and gap.recording == head.identity:
                        # Reported again before the segment with this event was deleted: counts
                        # once.
                        self._gaps[event.code, gap] = None
                yield JournalBlock(losses, events=block.events)
        if group:
            yield JournalBlock(losses, tuple(group))
        self._settle()

    def _account(self, path: Path, expected: int, number: int) -> None:
        """Note the blocks that are missing between two blocks, and settle earlier open losses."""
        if number == expected:
            self._open.clear()  # the block that was cut off before is this one
        corrupt = sum(lost.blocks_corrupt for lost in self._open)
        self._missing.append((path.name, expected + corrupt, number))  # often nothing is missing
        self._settle()

    def _blocks(self, path: Path) -> Iterator[FrameBlock | EventBlock | CorruptBlock]:
        """Yield the blocks of a segment, and count the losses at its end."""
        with SegmentReader(path) as segment:
            yield from segment.blocks()
            if segment.sealed:
                return
            note = f"{path.name}: not closed"
            self._lost = _plus(self._lost, JournalLoss(segments_unclosed=1, notes=(note,)))
            if cut := segment.bytes_cut:
                note = f"{path.name}: last {counted(cut, 'byte')} {segment.file.why_stopped}"
                self._open.append(JournalLoss(bytes_cut=cut, notes=(note,)))

    def _settle(self) -> None:
        """Count the losses that no later block has cancelled."""
        for lost in self._open:
            self._lost = _plus(self._lost, lost)
        self._open.clear()


def _belongs(block: FrameBlock, group: Sequence[FrameBlock]) -> bool:
    """Return whether a block of frames is unpacked together with the blocks before it."""
    first = group[0]
    alike = block.width == first.width and block.counts == first.counts
    return alike and len(group) * max(block.frames, 1) < _GROUP_FRAMES


def _plus(a: JournalLoss, b: JournalLoss) -> JournalLoss:
    return JournalLoss(*(x + y for x, y in zip(astuple(a), astuple(b), strict=True)))


def _sum(a: HopLosses, counts: Sequence[int]) -> HopLosses:
    return HopLosses(*(x + y for x, y in zip(a.counts, counts, strict=True)))
