"""Send simulated frames on a python-can bus."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator

import can

from dbc import FrameBatch, FrameFlag

from ..errors import BusError

BLOCK_FRAMES = 256
"""Progress is reported, and a caller can stop, after so many frames."""
FIRST_PAUSE_S = 0.0005
PATIENCE_S = 2.0
"""A bus that takes no frame for so long is given up."""


def play(batches: Iterable[FrameBatch], bus: can.BusABC, paced: bool) -> Iterator[int]:
    """Send classic data frames in the order given.

    Nothing is sent unless the result is iterated; a caller stops by ceasing to.

    Parameters
    ----------
    batches : iterable of FrameBatch
        From `daq.sim.ecu.campaign_frames`.
    bus : can.BusABC
        Any bus of python-can.  Each message carries the simulated controller's time stamp, which
        a virtual bus opened with ``preserve_timestamps=True`` hands on.
    paced : bool
        Send each frame at its own time after the first one, in real time.  The whole campaign is
        then simulated before the first frame leaves: computing while sending would make frames
        late.  Otherwise frames go as fast as the bus takes them.

    Yields
    ------
    int
        Frames sent so far.

    Raises
    ------
    BusError
        If the bus refuses a frame for `PATIENCE_S`.
    """
    if paced:
        batches = tuple(batches)
    first_ns: int | None = None
    origin_s = 0.0
    sent = 0
    for batch in batches:
        for start in range(0, len(batch), BLOCK_FRAMES):
            for t_ns, message in _messages(batch.select(slice(start, start + BLOCK_FRAMES))):
                if paced:
                    if first_ns is None:
                        first_ns, origin_s = t_ns, time.monotonic()
                    # Deadlines count from the first frame, so that no error adds up.
                    _wait_until(origin_s + (t_ns - first_ns) * 1e-9)
                _send(bus, message)
                sent += 1
            yield sent


def _messages(block: FrameBatch) -> Iterator[tuple[int, can.Message]]:
    payload, width = block.data.tobytes(), block.data.shape[1]
    extended = (block.flags & FrameFlag.EXTENDED) != 0
    columns = zip(
        block.t_ns.tolist(),
        block.can_id.tolist(),
        extended.tolist(),
        block.length.tolist(),
        strict=True,
    )
    for row, (t_ns, can_id, is_extended, length) in enumerate(columns):
        yield (
            t_ns,
            can.Message(
                timestamp=t_ns * 1e-9,
                arbitration_id=can_id,
                is_extended_id=is_extended,
                dlc=length,
                data=payload[row * width : row * width + length],
                check=False,
            ),
        )


def _wait_until(deadline_s: float) -> None:
    remaining_s = deadline_s - time.monotonic()
    if remaining_s > 0:
        time.sleep(remaining_s)


def _send(bus: can.BusABC, message: can.Message) -> None:
    """Send one frame, waiting longer and longer while the bus's buffer is full."""
    pause_s = FIRST_PAUSE_S
    waited_s = 0.0
    while True:
        try:
            bus.send(message)
            return
        except (can.CanError, OSError) as error:
            if waited_s >= PATIENCE_S:
                raise BusError(
                    bus.channel_info,
                    f"takes no frame: {error}",
                    "check that the interface is up and that another node acknowledges",
                ) from error
        time.sleep(pause_s)
        waited_s += pause_s
        pause_s *= 2
