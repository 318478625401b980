"""Runs the reader threads, one for each bus, and the queue between them and the writer.

Readers only read, stamp and queue frames.  A delay of the writer (a slow disk, a long decode) fills
the queue and loses no frames; if the queue is full, the frames that do not fit are counted.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from dbc.frames import FrameBatch

from ..bus.source import BLOCK_FRAMES, HopLosses, Link, LinkFacts
from ..control.messages import QueueStatus, StorageStatus

DRAIN_S = 1.0
"""Longest time, s, for which a halted reader reads frames that arrived before."""
QUEUE_BLOCKS = 4096
"""Largest number of blocks in the queue: 10 s of four buses, with a block every 10 ms."""
QUEUE_FRAMES = 1_600_000
"""Largest number of frames in the queue: 128 MB with payloads of 64 bytes."""


class StorageWatch:
    """Compares the received frames with those on the disk; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._stored = 0
        # Arrival of the first frame since a frame was stored last; None if none has arrived.
        self._unstored_since_s: float | None = None

    def received(self, frames: int, now_s: float) -> None:
        """Count frames that a reader has received at a monotonic time, s."""
        with self._lock:
            self._received += frames
            if frames and self._unstored_since_s is None:
                self._unstored_since_s = now_s

    def stored(self, total: int) -> None:
        """Set the number of frames on the disk."""
        with self._lock:
            if total > self._stored:
                self._stored = total
                self._unstored_since_s = None  # the next frame that arrives is timed anew

    def status(self, now_s: float) -> StorageStatus:
        """Return the counts, and for how long frames have arrived without one being stored."""
        with self._lock:
            unstored_s = self._unstored_since_s
            late_s = 0.0 if unstored_s is None else max(now_s - unstored_s, 0.0)
            return StorageStatus(self._received, self._stored, late_s)


@dataclass(frozen=True, slots=True)
class Piece:
    """Frames of one reader, their time of arrival, and its losses up to and including them."""

    reader: int
    frames: FrameBatch
    losses: HopLosses
    received_s: float


class PieceQueue:
    """A queue that is bounded in blocks and in frames; `put` never waits."""

    def __init__(self, blocks: int = QUEUE_BLOCKS) -> None:
        self._most_pieces = blocks
        self._pieces: deque[Piece] = deque()
        self._frames = 0
        self._most_used = 0  # highest number of pieces until now
        self._lock = threading.Lock()

    def put(self, piece: Piece) -> bool:
        """Append a piece; return whether there was room."""
        with self._lock:
            is_full = len(self._pieces) >= self._most_pieces
            if is_full or self._frames + len(piece.frames) > QUEUE_FRAMES:
                return False
            self._pieces.append(piece)
            self._frames += len(piece.frames)
            self._most_used = max(self._most_used, len(self._pieces))
            return True

    def take(self, frames: int) -> list[Piece]:
        """Return the oldest pieces, until they have at least `frames` frames."""
        taken: list[Piece] = []
        count = 0
        with self._lock:
            while self._pieces and count < frames:
                piece = self._pieces.popleft()
                self._frames -= len(piece.frames)
                count += len(piece.frames)
                taken.append(piece)
        return taken

    @property
    def status(self) -> QueueStatus:
        """Present, highest and largest possible number of blocks."""
        return QueueStatus(len(self._pieces), self._most_used, self._most_pieces)


class Reader(threading.Thread):
    """Reads one link until it is halted."""

    def __init__(self, number: int, link: Link, pieces: PieceQueue, watch: StorageWatch) -> None:
        super().__init__(name=f"reader {link.facts().name}", daemon=True)
        self.link, self.number = link, number
        self._dropped = 0
        self._pieces, self._watch = pieces, watch
        self._halt, self._halted_s = threading.Event(), 0.0

    def run(self) -> None:
        """Read until halted; the link never raises."""
        queued_losses, frames = HopLosses(), FrameBatch.empty()
        while not self._halt.is_set() or (
            # More frames than the last block may have arrived before the halt.
            len(frames) >= BLOCK_FRAMES and time.monotonic() - self._halted_s < DRAIN_S
        ):
            frames = self.link.read(0.1)  # s: counts of losses are published at least so often
            now_s, losses = time.monotonic(), self.losses()
            self._watch.received(len(frames), now_s)
            if len(frames) or losses != queued_losses:
                if self._pieces.put(Piece(self.number, frames, losses, now_s)):
                    queued_losses = losses
                else:
                    self._dropped += len(frames)
        self.link.close()

    def halt(self) -> None:
        """Make it end when it has read the waiting frames."""
        self._halted_s = time.monotonic()
        self._halt.set()
        self.link.halt()

    def losses(self) -> HopLosses:
        """Return the losses until now."""
        return self.link.facts().losses._replace(queue_dropped=self._dropped)


class Readers:
    """All readers of a recorder, which fill one queue, and the sum of their losses."""

    def __init__(self, pieces: PieceQueue, watch: StorageWatch) -> None:
        self._pieces, self._watch = pieces, watch
        self._readers: list[Reader] = []
        self._losses: dict[int, HopLosses] = {}

    def start(self, links: Sequence[Link]) -> None:
        """Start a reader for each link."""
        queue, watch = self._pieces, self._watch
        self._readers = [Reader(n, link, queue, watch) for n, link in enumerate(links)]
        for reader in self._readers:
            reader.start()

    def halt(self, within_s: float) -> None:
        """End all readers; do not wait longer for one that hangs in its driver."""
        for reader in self._readers:
            reader.halt()
        deadline_s = time.monotonic() + within_s
        for reader in self._readers:
            reader.join(max(deadline_s - time.monotonic(), 0.0))

    def take(self, frames: int) -> list[Piece]:
        """Return the pieces read; `hops` then has the losses up to them."""
        taken = self._pieces.take(frames)
        self._losses.update((piece.reader, piece.losses) for piece in taken)
        return taken

    def settle(self) -> None:
        """Update the losses after all readers are halted and all pieces taken."""
        self._losses.update((reader.number, reader.losses()) for reader in self._readers)

    def hops(self) -> HopLosses:
        """Return the losses up to the pieces taken last, over all readers."""
        of_readers = [HopLosses(), *self._losses.values()]
        return HopLosses(*map(sum, zip(*of_readers, strict=True)))  # field by field

    def facts(self) -> tuple[LinkFacts, ...]:
        """Return the state of each link."""
        return tuple(reader.link.facts() for reader in self._readers)
