"""Sends frames on a bus, at their own times or as fast as the bus accepts them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import can
import numpy as np

from dbc import FrameBatch, FrameFlag

from ..bus.interfaces import messages_of
from ..errors import BusError

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
    """Send frames in the order given; yield the number sent, after each block.

    Frames are sent while the result is iterated.  Error frames are left out: no controller can be
    made to send one.  `bus`, `more`: a frame is sent on the bus of its number, or on the first.
    `speed`: 1 sends each frame at its own time after the first one; None as fast as the bus accepts
    them.  Raises BusError if the bus refuses a frame for `PATIENCE_S`.
    """
    buses = (bus, *more)
    first_ns = last_ns = sent = 0
    origin_s: float | None = None
    for batch in batches:
        frames = batch.select((batch.flags & FrameFlag.ERROR) == 0)
        for start in range(0, len(frames), BLOCK_FRAMES):
            block = frames.select(slice(start, start + BLOCK_FRAMES))
            numbers = np.where(block.bus < len(buses), block.bus, 0).tolist()
            rows = zip(numbers, block.t_ns.tolist(), messages_of(block), strict=True)
            for number, t_ns, message in rows:
                if speed:
                    step_s = (t_ns - last_ns) * 1e-9
                    if origin_s is None or not -1.0 < step_s < LONGEST_GAP_S:
                        first_ns, origin_s = t_ns, time.monotonic()
                    last_ns = t_ns
                    # Deadlines count from the first frame, so that errors do not add up.
                    due_s = origin_s + (t_ns - first_ns) * 1e-9 / speed
                    if (remaining_s := due_s - time.monotonic()) > 0:
                        time.sleep(remaining_s)
                _send(buses[number], message)
                sent += 1
            yield sent


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
