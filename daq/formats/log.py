"""Reads logs of raw frames of any format, in blocks, with an account of the losses."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from dbc.frames import FrameBatch

from ..bench.origin import Origin
from ..bus.source import HopLosses
from ..errors import InputError
from ..journal.reader import JournalReader
from . import blf, capture, mf4_log, ros2_mcap
from .detect import BLF, JOURNAL, MF4, PCAP, ROS2, LogFormat, detect
from .losses import Ledger, LogLoss
from .text import LastLine, read_lines
from .unpacked import Unpacked, on_disk


class Log:
    """A log to be iterated once, block by block; memory does not grow with its length.

    Iterating raises InputError if the file is found not to be a log of its format; damaged or
    missing parts of a log are skipped and counted.

    `paths`: one file; of a journal, all its segments.  `form`: the format; detected if it is not
    given.  Raises InputError if a file is missing, empty or of no known format.
    """

    def __init__(self, paths: Sequence[Path], form: LogFormat | None = None) -> None:
        self.paths = tuple(paths)
        self.format = form or detect(paths[0])
        self.frames = 0
        """Number of frames returned so far."""
        self._bytes = sum(path.stat().st_size for path in paths)
        self._position: Callable[[], int] = int
        self._ledger = Ledger()
        self._hops = HopLosses()
        self._journal = JournalReader(self.paths) if self.format is JOURNAL else None

    @property
    def name(self) -> str:
        """The file, for messages."""
        return ", ".join(str(path) for path in self.paths)

    @property
    def origin(self) -> str:
        """Origin of its frames, a value of `Origin`; real for a log without a description.

        Raises InputError if the description beside an export is damaged.
        """
        if self._journal is not None:
            return self._journal.head.origin
        from .description import description_of, sidecar_of  # slow to load, for an import alone

        sidecar = sidecar_of(self.paths[0])
        if not sidecar.is_file():
            return Origin.REAL
        about = description_of(sidecar.read_bytes(), str(sidecar)).provenance
        return str(about.get("origin", Origin.REAL))

    @property
    def loss(self) -> LogLoss:
        """Losses found so far."""
        if self._journal is None:
            return self._ledger.loss
        lost = self._journal.lost
        return LogLoss(lost.blocks_corrupt + lost.blocks_missing, lost.bytes_cut, lost.notes)

    @property
    def hops(self) -> HopLosses:
        """Losses before the log was written, as stated in it, and unreadable parts of it."""
        if self._journal is None:
            return HopLosses(bus_garbled=self._ledger.loss.garbled)
        return self._hops

    @property
    def share(self) -> float:
        """Share of the file that has been read, 0..1."""
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
            raise InputError(self.name, what, "check that it is the right log")

    def _batches(self) -> Iterator[FrameBatch]:
        if self._journal is not None:
            for block in self._journal:
                self._hops = block.losses
                yield block.frames
        elif self.format is MF4:
            with on_disk(self.paths[0], self._ledger) as path, path.open("rb") as file:
                self._position = file.tell
                yield from mf4_log.read_mf4(file, self.name, self._ledger)
                self._position = lambda: self._bytes
        else:
            with self.paths[0].open("rb") as file:
                self._position = file.tell
                yield from self._forwards(Unpacked(file, self._ledger))
                self._position = lambda: self._bytes

    def _forwards(self, file: Unpacked) -> Iterator[FrameBatch]:
        """Read a format that can be read forwards only."""
        if self.format is BLF:
            size = None if file.packed else self._bytes
            return blf.read_blf(file, self.name, size, self._ledger)
        if self.format is PCAP:
            return capture.read_capture(file, self.name, self._ledger)
        if self.format is ROS2:
            return ros2_mcap.read_ros2(file, self.name, self._ledger)
        assert self.format.parser is not None
        last = LastLine(self.format.states_length, self.format.spaced)
        return read_lines(file, self.name, self.format.parser(), self._ledger, last)


def read_log(path: Path) -> Log:
    """Return the log in a file; its content decides the format.

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
    rows: list[tuple[LogFormat, list[Path]]] = []
    for path in paths:
        form = detect(path)
        if form is JOURNAL and rows and rows[-1][0] is JOURNAL:
            rows[-1][1].append(path)
        else:
            rows.append((form, [path]))
    return [Log(row, form) for form, row in rows]
