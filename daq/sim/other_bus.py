"""Simulates a further bus of the bench: delivers frames that the first bus's reader sampled."""

from __future__ import annotations

import time
from collections import deque

from dbc import FrameBatch

from ..bus.source import SourceLosses

_LOOK_S = 0.01


class OtherBus:
    """The frames of one bus of a simulated bench, as a `daq.bus.source.FrameSource`.

    `name`: name of the bus.  `waiting`: its frames, which the bench adds from another thread.
    """

    def __init__(self, name: str, waiting: deque[FrameBatch]) -> None:
        self._name, self._waiting = name, waiting

    @property
    def name(self) -> str:
        """The bus, for messages to the operator."""
        return self._name

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames that wait; wait up to `timeout_s` for the first."""
        end_s = time.monotonic() + timeout_s
        while not self._waiting and (left_s := end_s - time.monotonic()) > 0:
            time.sleep(min(_LOOK_S, left_s))
        batches = [self._waiting.popleft() for _ in range(len(self._waiting))]
        return FrameBatch.concatenate(batches)

    def losses(self) -> SourceLosses:
        """Return no losses: the counters in the frames show the losses of this bus."""
        return SourceLosses()

    def close(self) -> None:
        """Leave the bus; the car is not changed."""
