"""The frames of a recording as a bus: they come at their own distances, or faster."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dbc.frames import FrameBatch

from ..bus.source import BLOCK_FRAMES, GATHER_S, SourceLosses
from ..errors import InputError
from ..journal.folder import recordings
from ..journal.reader import read_journal
from ..sessions import Session
from .replay import recorded_frames

AROUND_NS = 2_000_000_000
START_S = 1.0
"""By then the recorder is armed, also for a first bump that comes early."""
LONGEST_GAP_S = 3.0
"""Between two runs of a session nothing was kept that is worth a longer wait."""


def whole_frames(session: Session, path: Path) -> FrameBatch:
    """Return the frames of a session and those between its runs.

    A session file keeps the runs only.  Without what lay between, the counters of the sensors
    would tell of losses, and the run before each gap would be judged by them.

    Parameters
    ----------
    session : Session
        What is to be played.
    path : Path
        Its file; the journal that it was derived from is in the folder beside it.

    Raises
    ------
    InputError
        If the journal is not there, or no longer whole.
    """
    runs = FrameBatch.concatenate(list(recorded_frames(session)))
    if len(runs):
        # Rest before the first run, for the trigger; and the recorder ends a run at the first
        # frame after it.
        span = (int(runs.t_ns.min()) - AROUND_NS, int(runs.t_ns.max()) + AROUND_NS)
        for recording in recordings(path.parent / "journal"):
            whole = read_journal(recording.segments, [span]).frames
            if len(whole) >= len(runs):
                return whole
    what = "cannot be played alone: it has the runs, and not what lay between them"
    advice = "name a session beside its journal, or play it onto a bus with `bumpbench replay`"
    raise InputError(str(path), what, advice)


class RecordedSource:
    """A recording as a `daq.bus.source.FrameSource`.

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
        self._begun_s = time.monotonic() + START_S

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
