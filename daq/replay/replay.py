"""Sends frames on a bus, at their own times or as fast as the bus accepts them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import can
import numpy as np

from dbc import FrameBatch, FrameFlag

from ..errors import BusError
from ..sessions import Session

BLOCK_FRAMES = 256
"""Number of frames between two reports of progress, at which a caller can stop."""
FIRST_PAUSE_S = 0.0005
"""First pause after a refused frame, s; each pause is twice the one before."""
PATIENCE_S = 2.0
"""Time of refusals, s, after which the replay ends with an error."""
LONGEST_GAP_S = 10.0
"""Longest silence that is replayed, s: longer ones, and time stamps that go back, are between two
runs of a session or two logs."""


def play(
    batches: Iterable[FrameBatch], bus: can.BusABC, speed: float | None, *more: can.BusABC
) -> Iterator[int]:
    """Send frames in the order given.

    Frames are sent while the result is iterated; a caller stops by ending the iteration.  Error
    frames are left out, because no controller can be made to send one.

    `batches`: blocks that are made quickly, because no frame is sent while the next one is made.
    `bus` and `more`: any buses of python-can; a frame is sent on the bus of its number, or on the
    first one if there is no bus of that number.  Each message has its own time stamp, which a
    virtual bus opened with ``preserve_timestamps=True`` passes on.  `speed`: 1 sends each frame at
    its own time after the first one, 2 in half that time; None as fast as the bus accepts them.
    Yields the number of frames sent.  Raises BusError if the bus refuses a frame for `PATIENCE_S`.
    """
    buses = (bus, *more)
    pace = _Pace(speed) if speed else None
    sent = 0
    for batch in batches:
        frames = batch.select((batch.flags & FrameFlag.ERROR) == 0)
        for start in range(0, len(frames), BLOCK_FRAMES):
            block = frames.select(slice(start, start + BLOCK_FRAMES))
            numbers = np.where(block.bus < len(buses), block.bus, 0).tolist()
            for number, (t_ns, message) in zip(numbers, _messages(block), strict=True):
                if pace:
                    pace.wait_for(t_ns)
                _send(buses[number], message)
                sent += 1
            yield sent


def recorded_frames(session: Session) -> Iterator[FrameBatch]:
    """Yield the raw frames of a session run by run, in order of time.

    Runs may overlap (the rest before a bump extends into the previous run); each frame is yielded
    once.
    """
    end_ns: int | None = None
    for run in sorted(session.runs, key=lambda run: run.t0_ns):
        frames = run.frames
        if end_ns is not None:
            frames = frames.select(frames.t_ns > end_ns)
        if len(frames):
            end_ns = int(frames.t_ns.max())
            yield frames


class _Message(can.Message):
    """A message whose data are never changed, so that its copies can share them.

    A virtual bus copies each message for each receiver; to copy the data as well takes a third of
    the CPU that a frame costs.
    """

    __slots__ = ()

    def __deepcopy__(self, _: object) -> can.Message:
        return self.__copy__()


class _Pace:
    """Waits until a frame is due; deadlines count from the first frame, so errors do not add up."""

    def __init__(self, speed: float) -> None:
        self._s_per_ns = 1e-9 / speed
        self._first_ns: int | None = None
        self._last_ns = 0
        self._origin_s = 0.0

    def wait_for(self, t_ns: int) -> None:
        step_s = (t_ns - self._last_ns) * 1e-9
        if self._first_ns is None or not -1.0 < step_s < LONGEST_GAP_S:
            self._first_ns, self._origin_s = t_ns, time.monotonic()
        self._last_ns = t_ns
        left_s = self._origin_s + (t_ns - self._first_ns) * self._s_per_ns - time.monotonic()
        if left_s > 0:
            time.sleep(left_s)


def _messages(block: FrameBatch) -> Iterator[tuple[int, can.Message]]:
    payload, width = block.data.tobytes(), block.data.shape[1]
    marks = [
        ((block.flags & flag) != 0).tolist()
        for flag in (
            FrameFlag.EXTENDED,
            FrameFlag.REMOTE,
            FrameFlag.FD,
            FrameFlag.BITRATE_SWITCH,
            FrameFlag.ERROR_STATE,
        )
    ]
    columns = (block.t_ns.tolist(), block.can_id.tolist(), block.length.tolist(), *marks)
    rows = enumerate(zip(*columns, strict=True))
    for row, (t_ns, can_id, length, extended, remote, fd, switched, passive) in rows:
        data = None if remote else payload[row * width : row * width + length]
        message = _Message(
            timestamp=t_ns * 1e-9,
            arbitration_id=can_id,
            is_extended_id=extended,
            is_remote_frame=remote,
            is_fd=fd,
            bitrate_switch=switched,
            error_state_indicator=passive,
            dlc=length,
            data=data,
            check=False,
        )
        yield t_ns, message


def _send(bus: can.BusABC, message: can.Message) -> None:
    """Send one frame, with growing pauses while the buffer of the bus is full."""
    pause_s = FIRST_PAUSE_S
    waited_s = 0.0
    while True:
        try:
            bus.send(message)
            return
        except (can.CanError, OSError, ValueError) as error:
            # Backends raise ValueError for a frame that this bus can never take.
            if waited_s >= PATIENCE_S or isinstance(error, ValueError):
                raise BusError(
                    bus.channel_info,
                    f"takes no frame: {error}",
                    "check that the interface is up and that another node acknowledges",
                ) from error
        time.sleep(pause_s)
        waited_s += pause_s
        pause_s *= 2
