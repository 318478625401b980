"""The frames of a recorded session as a bus: they come at their own distances, or faster."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from dbc.frames import FrameBatch

from .replay import recorded_frames
from .runs import Session
from .source import BLOCK_FRAMES, GATHER_S, SourceLosses

LONGEST_GAP_S = 3.0
"""Between two runs of a session nothing was kept that is worth a longer wait."""


class RecordedSource:
    """A session as a `daq.source.FrameSource`.

    Time stamps keep their distances; the first is `start_ns`, and long gaps are shortened.

    Parameters
    ----------
    session : Session
        Its runs have their raw frames.
    bus : int
        Only this bus of it.
    speed : float
        How many seconds of the recording pass in one.
    start_ns : int
        Time stamp of the first frame, ns since 1970 UTC.
    """

    def __init__(self, session: Session, bus: int, speed: float, start_ns: int) -> None:
        frames = FrameBatch.concatenate(list(recorded_frames(session)))
        gap_ns = np.diff(frames.t_ns, prepend=frames.t_ns[:1])
        t_ns = start_ns + np.cumsum(np.clip(gap_ns, 0, round(LONGEST_GAP_S * 1e9)))
        mine = frames.bus == bus
        self._frames = replace(frames, t_ns=t_ns).select(mine)
        self._after_s = (t_ns[mine] - start_ns) * 1e-9 / speed
        self._next = 0
        self._begun_s = time.monotonic()

    @property
    def name(self) -> str:
        """The bus, for messages to the operator."""
        return "recorded session"

    @property
    def done(self) -> bool:
        """Whether all frames were read."""
        return self._next >= len(self._frames)

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames whose time has come; wait up to `timeout_s` for the first."""
        passed_s = time.monotonic() - self._begun_s
        wait_s = timeout_s
        if not self.done:
            wait_s = min(max(float(self._after_s[self._next]) - passed_s, GATHER_S), timeout_s)
        time.sleep(wait_s)
        first = self._next
        stop = int(np.searchsorted(self._after_s, time.monotonic() - self._begun_s, "right"))
        self._next = min(max(stop, first), first + BLOCK_FRAMES)
        return self._frames.select(slice(first, self._next))

    def losses(self) -> SourceLosses:
        """Return none: what was lost is in the session."""
        return SourceLosses()

    def close(self) -> None:
        """Nothing is held."""
