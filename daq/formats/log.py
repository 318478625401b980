"""Logs of raw frames, whatever wrote them: read in blocks, with an account of what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from dbc.frames import FrameBatch

from ..bus.source import HopLosses
from ..errors import InputError
from ..journal.reader import JournalReader
from . import asc, blf, can_csv, candump, mf4_log, trc
from .losses import Ledger, LogLoss
from .text import Parsed, read_lines

JOURNAL_SUFFIX = ".mcap"


@dataclass(frozen=True, slots=True)
class LogFormat:
    """A format of logs."""

    name: str
    """As people call it."""
    lacks: str
    """Parts of a frame that it cannot hold; empty if it holds everything."""


FORMATS = {
    ".blf": LogFormat("BLF", blf.LACKS),
    ".asc": LogFormat("ASC", asc.LACKS),
    ".trc": LogFormat("TRC", trc.LACKS),
    ".log": LogFormat("candump", candump.LACKS),
    ".csv": LogFormat("CSV of python-can", can_csv.LACKS),
    ".mf4": LogFormat("MF4", mf4_log.LACKS),
    JOURNAL_SUFFIX: LogFormat("MCAP journal", ""),
}


class Log:
    """A log to be iterated once, block by block; memory does not grow with its length.

    Iterating raises InputError where the file turns out to be no log of its format; what is
    damaged or cut off within one is passed over and counted.

    `paths`: one file; of a journal, all its segments.  Raises InputError if a file is missing or
    empty, or its suffix is that of no format.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        for path in paths:
            _check(path)
        self.paths = tuple(paths)
        self.format = FORMATS[paths[0].suffix.lower()]
        self.frames = 0
        """Frames handed out so far."""
        self._bytes = sum(path.stat().st_size for path in paths)
        self._position: Callable[[], int] = int
        self._ledger = Ledger()
        self._hops = HopLosses()
        self._journal = (
            JournalReader(self.paths) if self.format is FORMATS[JOURNAL_SUFFIX] else None
        )

    @property
    def name(self) -> str:
        """The file, for messages."""
        return ", ".join(str(path) for path in self.paths)

    @property
    def loss(self) -> LogLoss:
        """Losses found so far."""
        if self._journal is None:
            return self._ledger.loss
        lost = self._journal.lost
        return LogLoss(lost.blocks_corrupt + lost.blocks_missing, lost.bytes_cut, lost.notes)

    @property
    def hops(self) -> HopLosses:
        """Losses before the log was written, as it states them, and what cannot be read in it."""
        if self._journal is None:
            return HopLosses(bus_garbled=self._ledger.loss.garbled)
        return self._hops

    @property
    def share(self) -> float:
        """Which part of the file has been read, 0..1."""
        return min(self._position() / max(self._bytes, 1), 1.0)

    def __iter__(self) -> Iterator[FrameBatch]:
        try:
            for batch in self._batches():
                if len(batch):
                    self.frames += len(batch)
                    yield batch
        except OSError as error:
            what = f"cannot be read: {error.strerror or error}"
            raise InputError(self.name, what, "check the disk") from error
        if not self.frames:
            what = f"holds no frame ({self.format.name}); {self.loss.text}".removesuffix("; ")
            raise InputError(self.name, what, "check that it is the log you mean")

    def _batches(self) -> Iterator[FrameBatch]:
        path, suffix = self.paths[0], self.paths[0].suffix.lower()
        if self._journal is not None:
            for block in self._journal:
                self._hops = block.losses
                yield block.frames
        elif suffix == ".mf4":
            yield from mf4_log.read_mf4(path, self._ledger)
        else:
            with path.open("rb") as file:
                self._position = file.tell
                yield from self._parsed(file, suffix)
                self._position = lambda: self._bytes

    def _parsed(self, file: BinaryIO, suffix: str) -> Iterator[FrameBatch]:
        if suffix == ".blf":
            return blf.read_blf(file, self.name, self._bytes, self._ledger)
        parsers: dict[str, Callable[[bytes], Parsed]] = {
            ".asc": asc.AscParser(),
            ".trc": trc.TrcParser(),
            ".log": candump.parse_candump,
            ".csv": can_csv.parse_csv,
        }
        return read_lines(file, self.name, parsers[suffix], self._ledger)


def read_log(path: Path) -> Log:
    """Return the log in a file; its suffix decides the format.

    Raises
    ------
    InputError
        As `Log`.
    """
    return Log([path])


def read_logs(paths: Sequence[Path]) -> list[Log]:
    """Return the logs in files; neighbouring segments of a journal are one log.

    Raises InputError as `Log`.
    """
    rows: list[list[Path]] = []
    for path in paths:
        segment = path.suffix.lower() == JOURNAL_SUFFIX
        if segment and rows and rows[-1][0].suffix.lower() == JOURNAL_SUFFIX:
            rows[-1].append(path)
        else:
            rows.append([path])
    return [Log(row) for row in rows]


def _check(path: Path) -> None:
    where, known = str(path), ", ".join(FORMATS)
    if not path.is_file():
        other = "is a directory" if path.is_dir() else "is no regular file"
        what = other if path.exists() else "no such file"
        raise InputError(where, what, f"name a log: {known}")
    if path.suffix.lower() not in FORMATS:
        raise InputError(where, f"{path.suffix or 'no suffix'} is no log format", f"use {known}")
    if not path.stat().st_size:
        raise InputError(where, "is empty", "check that it is the log you mean")
