"""Replays recorded frames: sent on a bus, or as a source that a recorder reads."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dbc import FrameBatch, FrameFlag
from dbc.words import InputError

from .bus.source import BLOCK_FRAMES, GATHER_S, BusError, FrameSource
from .journal.reader import read_windows, recordings
from .sessions import Session

if TYPE_CHECKING:
    import can

SENT_FRAMES = 256
"""Number of frames sent between two reports of progress, at which a caller can stop."""
LONGEST_SILENCE_S = 10.0
"""Longest silence that `play` keeps, s: longer ones, and time stamps that go back, are between two
runs of a session or two logs."""
LONGEST_GAP_S = 3.0
"""Longest pause between two frames of a `RecordedSource`, s: longer ones are shortened."""


def play(
    batches: Iterable[FrameBatch], bus: can.BusABC, speed: float | None, *others: can.BusABC
) -> Iterator[int]:
    """Send frames in the order given; yield the number sent so far, after each block.

    Frames are sent while the result is iterated.  Error frames are left out: no controller can be
    made to send one.  `bus`, `others`: a frame is sent on the bus of its number, or on the first.
    `speed`: 1 sends each frame at its own time after the first one; None as fast as the bus accepts
    them.  Raises BusError if the bus refuses a frame for 2 s.
    """
    from .bus.interfaces import messages_of

    buses = (bus, *others)
    first_ns = last_ns = sent = 0
    first_sent_s: float | None = None
    for batch in batches:
        frames = batch.select((batch.flags & FrameFlag.ERROR) == 0)
        for start in range(0, len(frames), SENT_FRAMES):
            block = frames.select(slice(start, start + SENT_FRAMES))
            numbers = np.where(block.bus < len(buses), block.bus, 0).tolist()
            rows = zip(numbers, block.t_ns.tolist(), messages_of(block), strict=True)
            for number, t_ns, message in rows:
                if speed:
                    since_last_s = (t_ns - last_ns) * 1e-9
                    # Stamps that go back by less than 1 s are disorder between buses.
                    if first_sent_s is None or not -1.0 < since_last_s < LONGEST_SILENCE_S:
                        first_ns, first_sent_s = t_ns, time.monotonic()
                    last_ns = t_ns
                    # Deadlines count from the first frame, so that errors do not add up.
                    due_s = first_sent_s + (t_ns - first_ns) * 1e-9 / speed
                    if (remaining_s := due_s - time.monotonic()) > 0:
                        time.sleep(remaining_s)
                _send(buses[number], message)
                sent += 1
            yield sent


def _send(bus: can.BusABC, message: can.Message) -> None:
    """Send one frame; raises BusError if the bus can never take it, or not within 2 s."""
    from can import CanError

    pauses_s = (
        0.0005 * 2**k for k in range(12)
    )  # 2 s in all, for a full buffer of the bus to empty
    while True:
        try:
            bus.send(message)
            return
        except (CanError, OSError, ValueError) as error:
            is_impossible = isinstance(error, ValueError)  # on this bus, as backends say
            pause_s = None if is_impossible else next(pauses_s, None)
            if pause_s is None:
                what = f"takes no frame: {error}"
                advice = "check that the interface is up and that another node acknowledges"
                advice = "name a bus that carries such frames" if is_impossible else advice
                raise BusError(bus.channel_info, what, advice) from error
        time.sleep(pause_s)


def whole_frames(session: Session, path: Path) -> FrameBatch:
    """Return the frames of a session and those between its runs.

    A session file has only the runs.  Without the frames between them the counters of the sensors
    would report losses, which would be attributed to the run before each gap.
    `path`: the session's file; the journal from which it was built is in `journal` beside it.
    Raises InputError if the journal is missing or incomplete.
    """
    of_runs = session.frames
    if len(of_runs):
        # 2 s: the trigger needs the rest before a run, and a run ends at the first frame after it.
        span_ns = (int(of_runs.t_ns.min()) - 2_000_000_000, int(of_runs.t_ns.max()) + 2_000_000_000)
        for recording in recordings(path.parent / "journal"):
            (recorded,) = read_windows(recording, [span_ns]).windows
            if len(recorded) >= len(of_runs):
                return recorded
    problem = "cannot be replayed alone: it has the runs, but not the frames between them"
    advice = "name a session next to its journal, or replay it on a bus with `bumpbench replay`"
    raise InputError(str(path), problem, advice)


class RecordedSource(FrameSource):
    """A recording read as if it came from a bus; frames that it lost are missing, not `losses`.

    Time stamps keep their intervals; gaps longer than `LONGEST_GAP_S` are shortened to it.
    `frames`: of all buses, in order of time.  `bus`: number of the bus that is read.  `speed`:
    seconds of the recording that pass in one second.  `start_ns`: first stamp, ns UTC.
    """

    def __init__(self, frames: FrameBatch, bus: int, speed: float, start_ns: int) -> None:
        gap_ns = np.diff(frames.t_ns, prepend=frames.t_ns[:1])
        t_ns = start_ns + np.cumsum(np.clip(gap_ns, 0, round(LONGEST_GAP_S * 1e9)))
        on_bus = frames.bus == bus
        self._frames = replace(frames, t_ns=t_ns).select(on_bus)
        self._due_s = (t_ns[on_bus] - start_ns) * 1e-9 / speed  # after `_start_s`
        self._next = 0  # row of the first frame that is not read
        # A pause of 1 s, in which the recorder is armed, also for an early first bump.
        self._start_s = time.monotonic() + 1.0

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
            due_in_s = self._start_s + float(self._due_s[self._next]) - time.monotonic()
            wait_s = min(max(due_in_s, GATHER_S), timeout_s)
        time.sleep(wait_s)
        begin = self._next
        stop = int(np.searchsorted(self._due_s, time.monotonic() - self._start_s, "right"))
        self._next = min(stop, begin + BLOCK_FRAMES)
        return self._frames.select(slice(begin, self._next))
