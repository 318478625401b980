"""Replays the frames of a recording as a bus, at their original intervals or faster."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from dbc.frames import FrameBatch

from ..bus.source import BLOCK_FRAMES, GATHER_S, SourceLosses
from ..errors import InputError
from ..journal.folder import recordings
from ..journal.reader import read_windows
from ..sessions import Session

AROUND_NS = 2_000_000_000
"""Time before the first and after the last run that is also replayed, ns: the trigger needs the
rest before a run, and the recorder ends a run at the first frame after it."""
START_S = 1.0
"""Pause before the first frame, s, in which the recorder is armed, also for an early first bump."""
LONGEST_GAP_S = 3.0
"""Longest pause between two frames, s: longer pauses are between runs, and are shortened."""


def whole_frames(session: Session, path: Path) -> FrameBatch:
    """Return the frames of a session and those between its runs.

    A session file has only the runs.  Without the frames between them the counters of the sensors
    would report losses, which would be attributed to the run before each gap.

    `path`: its file; the journal from which it was built is in the folder `journal` in its folder.
    Raises InputError if the journal is missing or incomplete.
    """
    runs = session.frames
    if len(runs):
        span = (int(runs.t_ns.min()) - AROUND_NS, int(runs.t_ns.max()) + AROUND_NS)
        for recording in recordings(path.parent / "journal"):
            _, (whole,) = read_windows(recording.segments, [span])
            if len(whole) >= len(runs):
                return whole
    problem = "cannot be replayed alone: it has the runs, but not the frames between them"
    advice = "name a session next to its journal, or replay it on a bus with `bumpbench replay`"
    raise InputError(str(path), problem, advice)


class RecordedSource:
    """A recording as a `daq.bus.source.FrameSource`.

    Time stamps keep their intervals; gaps longer than `LONGEST_GAP_S` are shortened to it.

    `speed`: seconds of the recording that pass in one second.  `start_ns`: time stamp of the first
    frame, ns since 1970 UTC.
    """

    def __init__(self, frames: FrameBatch, bus: int, speed: float, start_ns: int) -> None:
        gap_ns = np.diff(frames.t_ns, prepend=frames.t_ns[:1])
        t_ns = start_ns + np.cumsum(np.clip(gap_ns, 0, round(LONGEST_GAP_S * 1e9)))
        on_bus = frames.bus == bus
        self._frames = replace(frames, t_ns=t_ns).select(on_bus)
        self._after_s = (t_ns[on_bus] - start_ns) * 1e-9 / speed  # due, after `_begun_s`
        self._next = 0  # row of the first frame that is not read
        self._begun_s = time.monotonic() + START_S

    @property
    def name(self) -> str:
        """Name of the bus for the operator."""
        return "recording"

    @property
    def done(self) -> bool:
        """True once all frames were read."""
        return self._next >= len(self._frames)

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames that are due, at most `BLOCK_FRAMES`; empty once `done`.

        It waits until the next frame is due, and at least `GATHER_S`, so that frames gather in a
        block; but never longer than `timeout_s`.
        """
        wait_s = timeout_s
        if not self.done:
            due_in_s = self._begun_s + float(self._after_s[self._next]) - time.monotonic()
            wait_s = min(max(due_in_s, GATHER_S), timeout_s)
        time.sleep(wait_s)
        first = self._next
        due = int(np.searchsorted(self._after_s, time.monotonic() - self._begun_s, "right"))
        self._next = min(due, first + BLOCK_FRAMES)
        return self._frames.select(slice(first, self._next))

    def losses(self) -> SourceLosses:
        """Return no losses: frames lost when recorded are missing from the recording."""
        return SourceLosses()

    def close(self) -> None:
        """Do nothing: no resource is held."""
