"""Reads logs of raw frames of any format, in blocks, with an account of the losses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from dbc.frames import FrameBatch, read_only
from dbc.words import InputError, counted, plural, printable

from ..bench.campaign import Origin
from ..bus.source import HopLosses
from ..files import input_bytes
from ..journal.reader import JournalReader, recording_of
from ..journal.segment import MAGIC
from .asc import AscParser
from .blf import read_blf
from .mf4 import read_mf4
from .reader import LineParser, LogLoss, head_of, parsed, read_lines
from .text_logs import CandumpParser, CsvParser, TrcParser

RESTART_NS = 1_000_000_000
"""Time, ns, by which stamps go back where a clock began anew, and not where a frame came late."""
PAUSE_NS = 10_000_000_000
"""Time, ns, that is put between two parts of a log whose clocks have nothing to do with each
other: enough for the trigger to wait for rest again."""
MOST_PARTS = 50
"""Largest number of parts: two clocks whose frames are mixed are no parts."""


@dataclass(frozen=True, slots=True)
class LogFormat:
    """A format of logs."""

    name: str
    lacks: str
    """Parts of a frame that it cannot hold; empty if it holds everything."""


BLF = LogFormat("BLF", "the direction of error frames")
MF4 = LogFormat("MF4", "")
JOURNAL = LogFormat("journal", "")
_PARSERS: dict[LogFormat, Callable[[], LineParser]] = {
    LogFormat("candump", ""): CandumpParser,
    LogFormat("ASC", "the payload of error frames"): AscParser,
    LogFormat("CSV of python-can", "CAN FD (BRS, ESI), bus and direction"): CsvParser,
    LogFormat("TRC", "the payload of error frames"): TrcParser,
}
"""Maker of the parser of each text format."""
NAMES = "BLF, ASC, TRC, candump -L, CSV of python-can, MF4, journal"
"""Names of the formats, for messages."""
_MAGIC = {b"LOGG": BLF, b"MDF     ": MF4, b"UnFinMF ": MF4, MAGIC: JOURNAL}


def detect(path: Path) -> LogFormat:
    """Return the format of a log by its content.

    A text log has the format that reads most of its first lines, and at least half of them; a
    header decides between formats that read as many.  Raises InputError if the file is missing,
    empty or not a known log.
    """
    head = input_bytes(path, f"name a log: {NAMES}", 1 << 16)  # that of a text log is shorter
    for magic, form in _MAGIC.items():
        if head.startswith(magic):
            return form
    lines, best, best_score = head_of(head), None, 0.0
    for form, make_parser in _PARSERS.items():
        parser = make_parser()
        result = parsed(lines, parser)
        # Half a frame for a header, which decides only between formats that read as many frames.
        score = len(result.frames) + (0.5 if parser.has_header else 0.0)
        if score > best_score and len(result.bad) <= score:
            best, best_score = form, score
    if best is None:
        first_line = next((line for line in lines.splitlines() if line.strip()), b"")
        excerpt = printable(first_line.strip().decode("ascii", "backslashreplace"), 40)
        what = f"begins with no line of a known log: {excerpt!r}"
        raise InputError(str(path), what, f"use {NAMES}")
    return best


class Log:
    """A log to be iterated once, block by block; memory does not grow with its length.

    Frames come in the order of the file.  Where its times begin again, as in two logs one after
    the other, what follows is a later part: its stamps are moved behind the part before it, and
    `remarks` says so.  Iterating raises InputError if the file is found not to be a log of its
    format; damaged or missing parts of a log are skipped and counted.

    `paths`: one file; of a journal, all its segments.  `form`: the format; detected if it is not
    given.  Raises InputError if a file is missing, empty or of no known format.
    """

    def __init__(self, paths: Sequence[Path], form: LogFormat | None = None) -> None:
        self.paths = tuple(paths)
        self.name = ", ".join(map(str, paths))
        self.format = form or detect(paths[0])
        self._journal = JournalReader(recording_of(self.paths)) if self.format is JOURNAL else None
        self.origin = Origin.REAL if self._journal is None else self._journal.head.origin
        """Origin of its frames, a value of `Origin`; only a journal states another than real."""
        self.loss = LogLoss()
        """Losses found; of a journal once all of it was read."""
        self.frames = 0
        """Number of frames returned so far."""
        self.remarks: list[str] = []
        """Corrections of the times so far."""
        self._bytes = sum(path.stat().st_size for path in paths)
        self._position: Callable[[], int] = int  # returns 0, as for a journal
        self._journal_hops = HopLosses()
        self._held = FrameBatch.empty()  # last frame read: the one after it shows if it is a stray
        self._last_ns: int | None = None
        self._strays = 0  # number of frames that were left out
        self._first_frame: tuple[int, int, bytes] | None = None
        self._shift_ns = 0  # is added to the time stamps of the present part

    @property
    def hops(self) -> HopLosses:
        """Losses so far: before the log was written, as it states, and its unreadable records."""
        if self._journal is None:
            return HopLosses(bus_dropped=self.loss.dropped, bus_garbled=self.loss.garbled)
        return self._journal_hops

    @property
    def read_fraction(self) -> float:
        """Part of the file that has been read, 0..1; 0 for a journal."""
        return min(self._position() / max(self._bytes, 1), 1.0)

    def __iter__(self) -> Iterator[FrameBatch]:
        """Yield the blocks that have frames; raises InputError if there is none at the end."""
        try:
            for batch in chain(self._batches(), [FrameBatch.empty()]):
                # Events of a journal have the stamps of its frames, which therefore stay.
                in_order = self._in_order(batch) if self._journal is None else batch
                if len(in_order):
                    self.frames += len(in_order)
                    yield in_order
        except OSError as error:
            what = f"cannot be read: {error.strerror or error}"
            raise InputError(self.name, what, "check the disk") from error
        if not self.frames:
            what = f"holds no frame ({self.format.name}); {self.loss.text}".removesuffix("; ")
            raise InputError(self.name, what, "check that it is the right log")

    def _batches(self) -> Iterator[FrameBatch]:
        """Yield the frames as they are in the file, block by block."""
        if self._journal is not None:
            for losses, block in self._journal:
                self._journal_hops = losses
                yield block.frames
            lost = self._journal.lost
            self.loss = LogLoss(lost.blocks_missing, lost.bytes_cut, notes=list(lost.notes))
            return
        with self.paths[0].open("rb") as file:
            self._position = file.tell
            if self.format is MF4:
                yield from read_mf4(file, self.name, self.loss)
            elif self.format is BLF:
                yield from read_blf(file, self.name, self._bytes, self.loss)
            else:
                yield from read_lines(file, self.name, _PARSERS[self.format](), self.loss)
            self._position = lambda: self._bytes

    def _in_order(self, batch: FrameBatch) -> FrameBatch:
        """Return frames without those whose stamp is out of line, each part after the one before.

        The last frame of a block is returned with the next block, which shows if it is a stray, or
        with an empty one.  Where stamps go back by more than `RESTART_NS` a part begins: its stamps
        are moved behind the part before it.  Raises InputError if the part repeats the log from its
        first frame, or there are too many parts.
        """
        read = FrameBatch.concatenate([self._held, batch])
        if not len(read):
            return read
        last_ns = int(read.t_ns[0]) if self._last_ns is None else self._last_ns
        self._first_frame = self._first_frame or _frame(read, 0)
        read = self._without_strays(read, last_ns)
        n = len(read) - 1 if len(batch) else len(read)  # after an empty block all
        batch, self._held = read.select(slice(n)), read.select(slice(n, None))
        raw_ns = batch.t_ns  # as in the file
        t_ns = raw_ns + self._shift_ns
        for row in np.flatnonzero(np.diff(raw_ns, prepend=last_ns) < -RESTART_NS).tolist():
            restart_ns, frames = int(raw_ns[row]), self.frames + row
            end_ns = int(raw_ns[row - 1]) if row else last_ns  # of the part before
            step_back = f"its times go back from {end_ns * 1e-9:.3f} to {restart_ns * 1e-9:.3f} s"
            step_back = f"{step_back} after frame {frames}"
            if _frame(batch, row) == self._first_frame:
                what = f"stores the same frames twice: they begin again after frame {frames}"
                raise InputError(self.name, what, "cut the log there")
            if len(self.remarks) >= MOST_PARTS:
                what = f"{step_back}, and {MOST_PARTS} times before"
                raise InputError(self.name, what, "record with one clock, or cut the log there")
            self._shift_ns += end_ns + PAUSE_NS - restart_ns
            t_ns[row:] = raw_ns[row:] + self._shift_ns
            later = f"the rest is taken as a later part, {self._shift_ns * 1e-9:.3f} s later"
            self.remarks.append(f"{step_back}: {later}")
        self._last_ns = int(raw_ns[-1]) if n else self._last_ns
        return replace(batch, t_ns=read_only(t_ns)) if self._shift_ns else batch

    def _without_strays(self, batch: FrameBatch, last_ns: int) -> FrameBatch:
        """Return a block without, and count, frames far from two neighbours that are near in time.

        `last_ns`: time stamp of the frame before the block.
        """
        previous_ns = np.concatenate([[last_ns], batch.t_ns[:-1]])
        next_ns = np.append(batch.t_ns[1:], batch.t_ns[-1])
        is_stray = np.abs(previous_ns - next_ns) <= RESTART_NS
        is_stray &= np.abs(batch.t_ns - previous_ns) > RESTART_NS
        is_stray &= np.abs(batch.t_ns - next_ns) > RESTART_NS
        for row in np.flatnonzero(is_stray).tolist():  # between two strays a frame is in line
            is_stray[row] = not is_stray[row - 1]
        n = int(is_stray.sum())
        if not n:
            return batch
        what = f"{counted(n, 'time stamp')} out of line with {plural(n, 'its', 'their')}"
        frame_number = self.frames + self._strays + int(np.argmax(is_stray)) + 1  # counted from 1
        self.loss.add(f"{what} neighbours, the first at frame {frame_number}", garbled=n)
        self._strays += n
        return batch.select(~is_stray)


def _frame(batch: FrameBatch, row: int) -> tuple[int, int, bytes]:
    """Return time stamp, identifier and payload of a frame."""
    payload = batch.data[row, : batch.length[row]].tobytes()
    return int(batch.t_ns[row]), int(batch.can_id[row]), payload


def read_logs(paths: Sequence[Path]) -> list[Log]:
    """Return the logs in files; neighbouring segments of a journal are one.  Raises as `Log`."""
    files_of_logs: list[tuple[LogFormat, list[Path]]] = []
    for path in paths:
        form = detect(path)
        if form is JOURNAL and files_of_logs and files_of_logs[-1][0] is JOURNAL:
            files_of_logs[-1][1].append(path)
        else:
            files_of_logs.append((form, [path]))
    return [Log(files, form) for form, files in files_of_logs]
