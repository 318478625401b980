"""Frames that wait in an interface when the recorder is stopped are read, for a second at most."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterable

import pytest

from daq.bench.config import BusConfig
from daq.bus.link import Link
from daq.bus.source import SourceLosses
from daq.recorder.readers import DRAIN_S, PieceQueue, Reader, StorageWatch
from daq.recorder.recorder import HALT_S
from dbc import FrameBatch

from ..crash_frames import block
from ..recorder_run import PATIENCE_S


class Late:
    """A bus whose reader gets no processor until the recorder was stopped."""

    name = "late"

    def __init__(self, counts: Iterable[int]) -> None:
        self.counts = iter(counts)
        self.begun, self.awake = threading.Event(), threading.Event()

    def read(self, timeout_s: float) -> FrameBatch:
        self.begun.set()
        assert self.awake.wait(PATIENCE_S)
        time.sleep(0.01)
        return block(0, next(self.counts))

    def losses(self) -> SourceLosses:
        return SourceLosses()

    def close(self) -> None:
        pass


def read_after_the_stop(source: Late) -> list[int]:
    """Return the sizes of the blocks that a reader reads after it was stopped."""
    pieces = PieceQueue()
    link = Link(BusConfig("test", "late", 1_000_000), 0, lambda *_: source)
    reader = Reader(0, link, pieces, StorageWatch())
    reader.start()
    assert source.begun.wait(PATIENCE_S)
    reader.halt()
    source.awake.set()
    reader.join(PATIENCE_S)
    assert not reader.is_alive()
    return [len(piece.frames) for piece in pieces.take(10**9)]


@pytest.mark.parametrize(
    ("waiting", "read"),
    [
        ([2048, 2048, 2047, 5], [2048, 2048, 2047]),  # what comes after a block with room is new
        ([2047, 5], [2047]),
    ],
)
def test_what_had_arrived_is_read(waiting: list[int], read: list[int]) -> None:
    assert read_after_the_stop(Late(waiting)) == read


def test_a_bus_that_is_never_empty_holds_nothing_up() -> None:
    begun_s = time.monotonic()
    sizes = read_after_the_stop(Late(itertools.repeat(2048)))
    assert len(sizes) > 1
    assert 0.99 < time.monotonic() - begun_s < 4.0  # and room for a busy machine
    assert DRAIN_S < HALT_S
