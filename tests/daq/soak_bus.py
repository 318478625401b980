"""A bench that is bumped again and again, as fast as its recorder takes it."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np

from daq.bus.source import SourceLosses
from daq.recorder.readers import PieceQueue
from dbc import Codec, FrameBatch

PERIOD_S = 1.024
"""A whole number of turns of every counter, so one bump can follow itself."""
START_NS = 1_800_000_000_000_000_000
CHUNK = 1024
_BUMP_S, _DECAY_S, _RATE_HZ = 0.2, 0.06, 4.0
_HEIGHT = {"acc_f": 2.0, "acc_r": 2.0, "trave": 30.0, "acc_z": 5.0}
"""By the first letters of a signal: of hubs in g, of travel in mm, of the body in m/s2."""
_QUEUED = 4
_PAUSE_S = 0.002


def one_bump(codec: Codec, seed: int = 1) -> FrameBatch:
    """Return all frames of one period: rest, the car on all wheels up and down, and rest."""
    rng = np.random.default_rng(seed)
    parts = []
    for place, layout in enumerate(codec.messages):
        assert layout.cycle_s is not None
        n = round(PERIOD_S / layout.cycle_s)
        t_s = np.arange(n) * layout.cycle_s
        since_s = np.maximum(t_s - _BUMP_S, 0.0)
        bump = 2 * np.exp(-since_s / _DECAY_S) * np.sin(2 * np.pi * _RATE_HZ * since_s)
        values = {
            signal.name: _HEIGHT.get(signal.name[:5], 0.0) * bump
            + 5 * signal.factor * rng.standard_normal(n)
            for signal in layout.signals
            if signal.name not in ("counter", "crc")
        }
        parts.append(
            FrameBatch(
                np.rint(t_s * 1e9).astype(np.int64) + place * 100_000,
                np.full(n, layout.can_id, np.uint32),
                np.zeros(n, np.uint16),
                np.zeros(n, np.uint8),
                np.full(n, layout.length, np.uint8),
                codec.encode(layout.name, values),
            )
        )
    frames = FrameBatch.concatenate(parts)
    return frames.by_time()


class TirelessBench:
    """The same bump for ever, each with stamps of its own, while it is let run.

    Parameters
    ----------
    bump : FrameBatch
        Of one period.
    pieces : PieceQueue
        The recorder's; the bench waits while some pieces are in it.
    """

    name = "tireless"

    def __init__(self, bump: FrameBatch, pieces: PieceQueue) -> None:
        self.given = 0
        self.resting = threading.Event()
        self._bump, self._pieces = bump, pieces
        self._limit = 0
        self._run = threading.Event()
        self._closed = threading.Event()

    def run(self, limit: int) -> None:
        """Bump until so many frames were given in all, or ordered to rest."""
        self._limit = limit
        self.resting.clear()
        self._run.set()

    def rest(self, patience_s: float) -> None:
        """Give no more frames; return when the last one was given."""
        self._run.clear()
        assert self.resting.wait(patience_s)

    def read(self, timeout_s: float) -> FrameBatch:
        if self.given == self._limit:
            self._run.clear()
        if not self._run.is_set():
            self.resting.set()
            self._run.wait(timeout_s)
            return FrameBatch.empty()
        if self._pieces.status.blocks >= _QUEUED:
            self._closed.wait(min(timeout_s, _PAUSE_S))
            return FrameBatch.empty()
        turn, first = divmod(self.given, len(self._bump))
        part = self._bump.select(slice(first, first + min(CHUNK, self._limit - self.given)))
        self.given += len(part)
        return replace(part, t_ns=part.t_ns + START_NS + turn * round(PERIOD_S * 1e9))

    def losses(self) -> SourceLosses:
        return SourceLosses()

    def close(self) -> None:
        self._closed.set()
