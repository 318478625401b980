"""Reads journals: every block that is whole, with an exact account of all losses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import counted, plural

from ..bus.source import HopLosses
from ..errors import InputError
from ..runs import Event
from .contents import HopCounts, JournalBlock, JournalContents, JournalLoss
from .folder import no_head, scan
from .format import (
    DISK_GAP,
    FILE_GONE,
    RETENTION,
    Block,
    Gap,
    JournalHead,
    Kind,
    parse_gap,
    segment_number,
    stored_frames,
    unpack_events,
    unpack_head,
)
from .segment_reader import ADVICE, SegmentFile

_GAP_TEXTS = {
    DISK_GAP: "found no room on the disk or in memory",
    FILE_GONE: "lost: the file was removed while it was written",
    RETENTION: "between the runs deleted to make room",
}
_ALWAYS = (-(2**63), 2**63 - 1)


def read_journal(paths: Sequence[Path]) -> JournalContents:
    """Read all segments of a recording.

    `paths`: as for `JournalReader`.  Raises InputError as `JournalReader`.
    """
    contents, (frames,) = read_windows(paths, [_ALWAYS])
    return replace(contents, frames=frames)


def read_windows(
    paths: Sequence[Path], windows: Sequence[tuple[int, int]]
) -> tuple[JournalContents, tuple[FrameBatch, ...]]:
    """Read the frames in windows of time, which may overlap, from segments of a recording.

    `windows`: start <= t < stop, ns; memory grows with them, not with the recording.  Returns all
    else that is in the segments, and the frames of each window.  Raises InputError as
    `JournalReader`.
    """
    reader = JournalReader(paths)
    pieces: list[list[FrameBatch]] = [[] for _ in windows]
    events: list[Event] = []
    hops = _HopTable()
    starts_ns, stops_ns = np.array(windows, np.int64).reshape(-1, 2).T
    for block in reader:
        t_ns = block.stored.t_ns if block.stored else np.zeros(0, np.int64)
        hops.add(t_ns, block.losses)
        events += block.events
        if not len(t_ns):
            continue
        touched = np.flatnonzero((starts_ns <= t_ns.max()) & (t_ns.min() < stops_ns)).tolist()
        frames = block.frames if touched else FrameBatch.empty()  # most frames are in no window
        for k in touched:
            pieces[k].append(frames if windows[k] is _ALWAYS else frames.within([windows[k]]))
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

    def add(self, t_ns: NDArray[np.int64], losses: HopLosses) -> None:
        if len(t_ns):
            self._t_ns = max(self._t_ns, int(t_ns.max()))
        row = (self._t_ns, *losses.counts)
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

    `paths`: the segments of one recording, in any order, also of several processes.  `head`: that
    of the recording.  Raises InputError if files belong to different recordings, or if none can be
    read and has a head.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._lost: list[JournalLoss] = []
        self._open: list[JournalLoss] = []  # losses that the next block may cancel
        self._missing: list[tuple[str, int, int]] = []  # file, first block, block after the last
        self._gaps: dict[tuple[str, Gap], None] = {}
        firsts: dict[Path, Block] = {}
        refused: list[InputError] = []
        for path in paths:
            try:
                with SegmentFile(path) as file:
                    first = file.first()
                    if first is not None:
                        firsts[path] = first
                        continue
                    size, why = file.size, "has no whole block"
            except InputError as error:
                refused.append(error)
                size, why = path.stat().st_size if path.is_file() else 0, error.what
            self._lost.append(JournalLoss(bytes_cut=size, notes=(f"{path.name}: {why}",)))
        if not firsts:
            where = ", ".join(str(path) for path in paths) or "journal"
            raise refused[0] if refused else InputError(where, "holds no recording", ADVICE)
        self._sort(firsts)

    def _sort(self, firsts: dict[Path, Block]) -> None:
        """Find the head, and the order of the segments, from the first block of each."""
        heads: dict[Path, JournalHead] = {}
        for path, block in firsts.items():
            if block.kind == Kind.HEAD:
                heads[path] = unpack_head(block.content)[0]
            elif (info := scan(path)) and info.head:  # only its beginning is damaged
                heads[path] = info.head
        if not heads:
            raise no_head(next(iter(firsts)))
        (one, head), *others = heads.items()
        for path, other in others:
            if other.recording != head.recording:
                what = f"belongs to another recording than {one.name}"
                raise InputError(str(path), what, "read one recording at a time")
        for path in [path for path in firsts if firsts[path].recording != head.recording]:
            note = f"{path.name}: has lost every copy of its bench.toml and DBC"
            self._lost.append(JournalLoss(bytes_cut=path.stat().st_size, notes=(note,)))
            del firsts[path]
        self._paths = sorted(firsts, key=lambda p: (firsts[p].number, segment_number(p)))
        self._writers = {path: block.writer for path, block in firsts.items()}
        earliest = next(heads[path] for path in self._paths if path in heads)
        self.head = replace(earliest, wall_ns=self._writers[self._paths[0]])

    @property
    def lost(self) -> JournalLoss:
        """The losses found; exact once all blocks have been read."""
        lost = [*self._lost]
        gaps = sorted((gap for _, gap in self._gaps), key=lambda gap: gap.first)
        for name, first, stop in self._missing:
            missing = stop - first
            for gap in gaps:
                missing -= max(0, min(stop, gap.stop) - max(first, gap.first))
                first = max(first, gap.stop)
            if missing > 0:
                note = f"{name}: {counted(missing, 'block')} missing before it"
                lost.append(JournalLoss(blocks_missing=missing, notes=(note,)))
        for code, gap in self._gaps:
            text = f"{gap.file}: {gap.frames}" if gap.file else f"{gap.frames}"
            dropped = 0 if code == RETENTION else gap.frames
            note = f"{text} {plural(gap.frames, 'frame')} {_GAP_TEXTS[code]}"
            lost.append(JournalLoss(frames_dropped=dropped, notes=(note,)))
        return JournalLoss(
            sum(each.bytes_cut for each in lost),
            sum(each.blocks_corrupt for each in lost),
            sum(each.blocks_missing for each in lost),
            sum(each.frames_dropped for each in lost),
            tuple(note for each in lost for note in each.notes),
        )

    def __iter__(self) -> Iterator[JournalBlock]:
        expected, writer = 0, self._writers[self._paths[0]]
        losses = before = HopLosses()
        for path in self._paths:
            if self._writers[path] != writer:  # another process, which repeats no block
                self._settle()
                before, writer = losses, self._writers[path]
            for block in self._blocks(path):
                if block.number < expected:
                    continue  # written twice: the first time its fdatasync failed
                if block.kind == Kind.END and block.number == expected:  # only heads are damaged
                    self._open = [lost for lost in self._open if lost.bytes_cut]
                elif block.number == expected:
                    self._open.clear()  # the block that was cut off before is this one
                else:
                    corrupt = sum(lost.blocks_corrupt for lost in self._open)
                    self._missing.append((path.name, expected + corrupt, block.number))
                    self._settle()
                expected = block.number + (block.kind != Kind.END)
                if block.kind == Kind.FRAMES:
                    stored = stored_frames(block.content)
                    counts = zip(before.counts, stored.losses.counts, strict=True)
                    losses = HopLosses(*(x + y for x, y in counts))
                    yield JournalBlock(losses, stored)
                elif block.kind == Kind.EVENTS:
                    events = unpack_events(block.content)
                    for event in events:
                        if (gap := parse_gap(event)) and gap.recording == self.head.recording:
                            # Reported again before the segment with this event was deleted:
                            # counts once.
                            self._gaps[event.code, gap] = None
                    yield JournalBlock(losses, events=events)
        self._settle()

    def _blocks(self, path: Path) -> Iterator[Block]:
        """Yield the numbered blocks of a segment, and note what is damaged."""
        with SegmentFile(path) as file:
            for block in file.blocks():
                if isinstance(block, Block):
                    if block.kind in (Kind.FRAMES, Kind.EVENTS, Kind.END):
                        yield block
                    continue
                span = f"{path.name}: {counted(block.bytes, 'byte')} from byte {block.offset}"
                if not block.at_end:
                    self._open.append(JournalLoss(blocks_corrupt=1, notes=(f"{span} are damaged",)))
                elif block.kind not in (Kind.HEAD, Kind.END):  # nothing is lost with those
                    note = f"{span} {file.fault or 'are no whole block'}"
                    self._open.append(JournalLoss(bytes_cut=block.bytes, notes=(note,)))

    def _settle(self) -> None:
        """Count the losses that no later block has cancelled."""
        self._lost += self._open
        self._open.clear()
