"""What a reader hands over, counts and drops, read by read; the sum over all readers."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from daq.bench.config import BusConfig
from daq.bus.link import Link
from daq.bus.source import HopLosses, SourceLosses
from daq.recorder.readers import Piece, PieceQueue, Reader, Readers, StorageWatch
from dbc import FrameBatch

from ..crash_frames import block

Step = tuple[int, SourceLosses] | Callable[[], object]


class Scripted:
    """A source that has so many frames and losses at each read, then ends its reader."""

    name = "scripted"

    def __init__(self, steps: list[Step]) -> None:
        self.steps = steps
        self.counted = SourceLosses()
        self.at_end: Callable[[], object] = lambda: None
        self.closed = False

    def read(self, timeout_s: float) -> FrameBatch:
        while self.steps and callable(self.steps[0]):
            step = self.steps.pop(0)
            assert callable(step)
            step()
        if not self.steps:
            self.at_end()
            return FrameBatch.empty()
        step = self.steps.pop(0)
        assert not callable(step)
        n, self.counted = step
        return block(0, n) if n else FrameBatch.empty()

    def losses(self) -> SourceLosses:
        return self.counted

    def close(self) -> None:
        self.closed = True


NONE = SourceLosses()


def run(source: Scripted, pieces: PieceQueue) -> tuple[Reader, StorageWatch]:
    """Run a reader in this thread to the end of its script."""
    watch = StorageWatch()
    link = Link(BusConfig("test", "0", 500_000), 0, lambda *_: source)
    reader = Reader(3, link, pieces, watch)
    source.at_end = reader.halt
    reader.run()
    assert source.closed
    return reader, watch


def seen(pieces: list[Piece]) -> list[tuple[int, int, int]]:
    """Return frames, garbled ones and dropped ones of each piece."""
    return [(len(p.frames), p.losses.garbled, p.dropped) for p in pieces]


def test_a_reader_hands_over_frames_and_counts_that_are_new() -> None:
    pieces = PieceQueue()
    one = SourceLosses(0, 1, 0)
    reader, watch = run(Scripted([(5, NONE), (0, NONE), (0, one), (0, one), (7, one)]), pieces)
    assert pieces.status.blocks == 3
    taken = pieces.take(10**9)
    assert seen(taken) == [(5, 0, 0), (0, 1, 0), (7, 1, 0)]
    assert {piece.reader for piece in taken} == {3}
    assert watch.status(0.0).received_frames == 12
    assert reader.dropped == 0


def test_frames_for_which_the_queue_has_no_room_are_counted_with_the_next_that_have() -> None:
    pieces = PieceQueue(blocks=1)
    taken: list[Piece] = []

    def take() -> None:
        taken.extend(pieces.take(10**9))

    script: list[Step] = [(5, NONE), (7, NONE), (9, NONE), take, (0, NONE), take, (0, NONE), take]
    reader, watch = run(Scripted(script), pieces)
    assert seen(taken) == [(5, 0, 0), (0, 0, 16)]
    assert reader.dropped == 16
    assert watch.status(0.0).received_frames == 21
    assert reader.counts().counts == HopLosses(0, 0, 0, 16)


@pytest.mark.parametrize(("size", "taken"), [(4, 1), (5, 1), (6, 2), (11, 3), (99, 3)])
def test_the_oldest_pieces_are_taken_until_there_are_enough(size: int, taken: int) -> None:
    pieces = PieceQueue()
    for _ in range(3):
        assert pieces.put(Piece(0, block(0, 5), NONE, 0, 0.0))
    assert (pieces.status.blocks, pieces.status.high, pieces.status.room) == (3, 3, 4096)
    assert len(pieces.take(size)) == taken
    assert (pieces.status.blocks, pieces.status.high) == (3 - taken, 3)


def test_the_room_of_what_was_taken_is_free_again() -> None:
    """Five frames take 5 (8 + 16) bytes."""
    piece = Piece(0, block(0, 5), NONE, 0, 0.0)
    assert piece.size == 120
    for room, fits in ((239, 1), (240, 2)):
        pieces = PieceQueue(size=room)
        assert [pieces.put(piece) for _ in range(2)] == [True, fits == 2]
        pieces.take(1)
        assert pieces.put(piece)


def test_losses_are_the_sum_of_the_last_counts_of_all_readers() -> None:
    pieces = PieceQueue()
    readers = Readers(pieces)
    empty = FrameBatch.empty()
    assert readers.hops() == HopLosses()
    for number, losses, dropped in (
        (0, SourceLosses(1, 2, 3), 4),
        (1, SourceLosses(10, 20, 30), 40),
        (0, SourceLosses(2, 4, 6), 8),
    ):
        pieces.put(Piece(number, empty, losses, dropped, 0.0))
    assert readers.hops() == HopLosses()  # not before they are taken
    readers.take(10**9)
    assert readers.hops() == HopLosses(12, 24, 36, 48)
    readers.settle()  # later readers count from nothing
    pieces.put(Piece(0, empty, SourceLosses(1, 1, 1), 1, 0.0))
    readers.take(10**9)
    assert readers.hops() == HopLosses(13, 25, 37, 49)
    assert readers.facts() == ()
