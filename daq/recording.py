"""A recording with its threads: a reader for each bus, a bounded queue, one writer to the disk.

Readers only read and stamp.  The writer, in the caller's thread, gathers their blocks ten times a
second and hands them to `Recorder.step`; whatever holds it up (a slow disk, a long decode) costs
queue, not frames, and if the queue is full the frames that did not fit are counted.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from dbc.frames import FrameBatch

from .errors import BusError
from .recorder import Recorder, RecorderStatus
from .source import FrameSource, HopLosses, SourceLosses

BLOCK_S = 0.1
"""The journal gets a block so often; what was not yet in one is lost to a power cut."""
BLOCK_FRAMES = 65_536
READ_TIMEOUT_S = 0.1
QUEUE_BLOCKS = 600
"""Readers hand over a block every 10 ms or 2048 frames: 6 s of a full bus, 100 MB at most."""
JOIN_S = 5.0

BUS_GONE = "bus_gone"


@dataclass(frozen=True, slots=True)
class _Piece:
    """What a reader hands over: frames, and its counts up to and with them."""

    reader: int
    frames: FrameBatch
    losses: SourceLosses
    dropped: int


class _Reader(threading.Thread):
    """Reads one source until it is halted or the source fails."""

    def __init__(
        self,
        number: int,
        source: FrameSource,
        pieces: queue.Queue[_Piece],
        halt: threading.Event,
    ) -> None:
        super().__init__(name=f"reader {source.name}", daemon=True)
        self.error: BusError | None = None
        self.source = source
        self._number = number
        self._pieces = pieces
        self._halt = halt
        self._dropped = 0

    def run(self) -> None:
        told = SourceLosses()
        try:
            while not self._halt.is_set():
                frames = self.source.read(READ_TIMEOUT_S)
                losses = self.source.losses()
                if len(frames) or losses != told:
                    told = losses
                    try:
                        self._pieces.put_nowait(self._piece(frames, losses))
                    except queue.Full:
                        self._dropped += len(frames)
        except BusError as error:
            self.error = error
        except Exception as error:  # a thread that ends without a word is the worst of all
            self.error = BusError(
                self.source.name, f"reader failed: {error!r}", "please report this"
            )

    def counts(self) -> _Piece:
        """Return the counts once the thread has ended."""
        return self._piece(FrameBatch.empty(), self.source.losses())

    def _piece(self, frames: FrameBatch, losses: SourceLosses) -> _Piece:
        return _Piece(self._number, frames, losses, self._dropped)


def record(
    recorder: Recorder,
    sources: Sequence[FrameSource],
    stop: threading.Event,
    progress: Callable[[RecorderStatus], None],
) -> None:
    """Record until the campaign is complete, `stop` is set, or no source is left.

    On return all sources are closed and every frame that was read is in the journal.  A source
    that fails while others go on is an event `bus_gone`.

    Parameters
    ----------
    recorder : Recorder
        What is done with each block.
    sources : sequence of FrameSource
        Open; closed here.
    stop : threading.Event
        Set by the caller (from a signal handler, say) to end the recording.
    progress : callable
        Called about ten times a second with the status, also when the buses are silent.

    Raises
    ------
    BusError
        If no source is left.  What had been received is in the journal.
    JournalError
        If the journal cannot be written.
    """
    halt = threading.Event()
    pieces: queue.Queue[_Piece] = queue.Queue(QUEUE_BLOCKS)
    readers = [_Reader(i, source, pieces, halt) for i, source in enumerate(sources)]
    writer = _Writer(recorder, readers, progress)
    try:
        for reader in readers:
            reader.start()
        while not stop.is_set() and not recorder.complete and any(r.is_alive() for r in readers):
            writer.store(_gather(pieces, BLOCK_S))
        _end(readers, halt)
        while not pieces.empty():
            writer.store(_gather(pieces, 0.0))
        writer.store([reader.counts() for reader in readers])
    finally:
        _end(readers, halt)
        for source in sources:
            source.close()
    errors = [reader.error for reader in readers if reader.error]
    if errors and len(errors) == len(readers):
        raise errors[0]


def _end(readers: Sequence[_Reader], halt: threading.Event) -> None:
    halt.set()
    for reader in readers:
        if reader.ident is not None:
            reader.join(JOIN_S)


def _gather(pieces: queue.Queue[_Piece], wait_s: float) -> list[_Piece]:
    """Return what comes in within `wait_s`, and what is there already in any case."""
    gathered: list[_Piece] = []
    count = 0
    deadline_s = time.monotonic() + wait_s
    with suppress(queue.Empty):
        while count < BLOCK_FRAMES:
            left_s = deadline_s - time.monotonic()
            piece = pieces.get(timeout=left_s) if left_s > 0 else pieces.get_nowait()
            gathered.append(piece)
            count += len(piece.frames)
    return gathered


class _Writer:
    """Adds up what the readers hand over and passes it on."""

    def __init__(
        self,
        recorder: Recorder,
        readers: Sequence[_Reader],
        progress: Callable[[RecorderStatus], None],
    ) -> None:
        self._recorder = recorder
        self._readers = readers
        self._progress = progress
        self._counts: dict[int, _Piece] = {}
        self._hops = HopLosses()
        self._gone: set[str] = set()

    def store(self, pieces: Sequence[_Piece]) -> None:
        """Store the pieces as one block and report."""
        self._counts.update((piece.reader, piece) for piece in pieces)
        counts = self._counts.values()
        hops = HopLosses(
            sum(c.losses.dropped for c in counts),
            sum(c.losses.garbled for c in counts),
            sum(c.losses.restamped for c in counts),
            sum(c.dropped for c in counts),
        )
        batch = FrameBatch.concatenate([piece.frames for piece in pieces])
        events = list(self._recorder.step(batch, hops)) if len(batch) or hops != self._hops else []
        self._hops = hops
        for number, reader in enumerate(self._readers):
            if reader.error and reader.name not in self._gone:
                self._gone.add(reader.name)
                events.append(self._recorder.note(BUS_GONE, number, str(reader.error)))
        self._progress(self._recorder.status(events))
