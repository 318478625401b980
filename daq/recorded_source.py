"""The frames of a recording as a bus: they come at their own distances, or faster."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dbc.frames import FrameBatch

from .journal_folder import recordings
from .journal_reader import read_journal
from .replay import recorded_frames
from .runs import Session
from .source import BLOCK_FRAMES, GATHER_S, SourceLosses

AFTER_NS = 2_000_000_000
LONGEST_GAP_S = 3.0
"""Between two runs of a session nothing was kept that is worth a longer wait."""


def whole_frames(session: Session, folder: Path) -> FrameBatch:
    """Return the frames of a session, also those between its runs if the journal is still there.

    A session keeps the runs only, and where a piece is missing the counters of the sensors tell of
    losses: the run before it would be judged by them.

    Parameters
    ----------
    session : Session
        What is to be played.
    folder : Path
        Where it was derived: its journal is beside it.
    """
    runs = FrameBatch.concatenate(list(recorded_frames(session)))
    if not len(runs):
        return runs
    # A little more than the last run: the recorder ends a run at the first frame after it.
    span = (int(runs.t_ns.min()), int(runs.t_ns.max()) + AFTER_NS)
    for recording in recordings(folder / "journal"):
        whole = read_journal(recording.segments, [span]).frames
        if len(whole) >= len(runs):
            return whole
    return runs


class RecordedSource:
    """A recording as a `daq.source.FrameSource`.

    Time stamps keep their distances; the first is `start_ns`, and long gaps are shortened.

    Parameters
    ----------
    frames : FrameBatch
        As they were recorded.
    bus : int
        Only this bus of it.
    speed : float
        How many seconds of the recording pass in one.
    start_ns : int
        Time stamp of the first frame, ns since 1970 UTC.
    """

    def __init__(self, frames: FrameBatch, bus: int, speed: float, start_ns: int) -> None:
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
        return "recording"

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
        """Return none: what was lost is missing from the frames."""
        return SourceLosses()

    def close(self) -> None:
        """Nothing is held."""
