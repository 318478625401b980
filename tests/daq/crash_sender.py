"""A sender on a serial line whose frames carry their number, and what was stored compared with it.

It behaves as an slcan adapter: frames come from the command `O` on, at the rate of a bus or as fast
as the line takes them.  Every 16th frame is one of a hub that is bumped every 1.2 s.
"""

from __future__ import annotations

import os
import select
import termios
import threading
import time
import tty
from functools import cache
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from .small_campaign import bumps, small_codec

RATE_HZ = 16_000
"""Frames a second of a paced sender: four full buses of 500 kbit/s."""
NUMBERED_ID = 0x7A0
"""A message that no DBC has; its payload is the number of the frame."""
HUB_EVERY = 16
LENGTH = 6
"""Payload of every frame, bytes: that of the hub's message."""
_CHUNK = 800
_DIGITS = np.frombuffer(b"0123456789ABCDEF", np.uint8)


@cache
def _hub() -> tuple[int, NDArray[np.uint8]]:
    """Return identifier and payloads of the hub's message over 1.2 s at 1 kHz."""
    frames = bumps(small_codec(), 1)
    assert np.all(frames.length == LENGTH)
    return int(frames.can_id[0]), frames.data[:, :LENGTH]


def frames_of(n: NDArray[np.int64]) -> tuple[NDArray[np.uint32], NDArray[np.uint8]]:
    """Return identifiers and payloads of the frames of these numbers."""
    hub_id, hub_data = _hub()
    hub = n % HUB_EVERY == 0
    data = n.astype(">u8").view(np.uint8).reshape(-1, 8)[:, 8 - LENGTH :].copy()
    data[hub] = hub_data[n[hub] // HUB_EVERY % len(hub_data)]
    return np.where(hub, hub_id, NUMBERED_ID).astype(np.uint32), data


def lines_of(n: NDArray[np.int64]) -> bytes:
    """Return the frames of these numbers as an slcan adapter sends them."""
    can_id, data = frames_of(n)
    line = np.empty((len(n), 6 + 2 * LENGTH), np.uint8)
    line[:, 0] = ord("t")
    for k, shift in enumerate((8, 4, 0)):
        line[:, 1 + k] = _DIGITS[can_id >> shift & 15]
    line[:, 4] = _DIGITS[LENGTH]
    line[:, 5:-1:2], line[:, 6:-1:2] = _DIGITS[data >> 4], _DIGITS[data & 15]
    line[:, -1] = ord("\r")
    return line.tobytes()


def numbers_of(frames: FrameBatch) -> NDArray[np.int64]:
    """Return the sender's numbers of stored frames; each recorder's first frame is a numbered one.

    Raises
    ------
    AssertionError
        If a bit of any frame is not as it was sent.
    """
    assert np.all(frames.length == LENGTH)
    padded = np.zeros((len(frames), 8), np.uint8)
    padded[:, 8 - LENGTH :] = frames.data[:, :LENGTH]
    n = padded.view(">u8").reshape(-1).astype(np.int64)
    (hub,) = np.nonzero(frames.can_id != NUMBERED_ID)
    assert not len(hub) or hub[0] > 0, "a frame of the hub is the first"
    n[hub] = n[hub - 1] + 1
    # Where frames were dropped just before it, the one behind it shows the number.
    astray = hub[(n[hub] % HUB_EVERY != 0) & (hub + 1 < len(n))]
    n[astray] = n[astray + 1] - 1
    can_id, data = frames_of(n)
    assert np.array_equal(frames.can_id, can_id), "an identifier is not what was sent"
    assert np.array_equal(frames.data[:, :LENGTH], data), "a payload is not what was sent"
    assert not frames.flags.any()
    return n


class Sender:
    """Sends for as long as a `with` lasts.

    Parameters
    ----------
    hot : bool
        As fast as the line takes it, in place of `RATE_HZ`.

    Attributes
    ----------
    device : str
        The recorder's end of the line.
    openings : list of int
        Number of the first frame after each time a recorder has opened the line.
    sent : int
        Number of the frame after the last one that was begun.
    """

    def __init__(self, *, hot: bool) -> None:
        self._hot = hot
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self.openings: list[int] = []
        self.sent = 1
        self._open = self._pausing = False
        self._rest = b""
        self._first, self._first_s = 1, 0.0
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sender")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._over.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def cut(self) -> None:
        """Send nothing more, and forget what is in the line: its recorder was killed."""
        with self._lock:
            self._read_commands()  # of the killed one
            self._open, self._rest = False, b""
            termios.tcflush(self._slave, termios.TCIFLUSH)

    def pause(self) -> int:
        """Stop behind a whole frame; return the number of the next one."""
        self._pausing = True
        while self._rest:
            time.sleep(0.005)
        with self._lock:
            self._open = self._pausing = False
            return self.sent

    def _run(self) -> None:
        while not self._over.is_set():
            writing = [self._master] if self._rest else []
            select.select([self._master], writing, [], 0.01)
            with self._lock:
                self._read_commands()
                if self._open:
                    self._send()

    def _read_commands(self) -> None:
        try:
            commands = os.read(self._master, 4096)
        except BlockingIOError:
            return
        if b"O\r" in commands and not self._open:
            self.sent += -self.sent % HUB_EVERY + 1  # the first one is no frame of the hub
            self.openings.append(self.sent)
            self._open, self._first, self._first_s = True, self.sent, time.monotonic()
        elif b"C\r" in commands and b"O\r" not in commands:
            self._open, self._rest = False, b""

    def _send(self) -> None:
        if not self._rest and not self._pausing:
            due = self._first + round((time.monotonic() - self._first_s) * RATE_HZ) - self.sent
            count = _CHUNK if self._hot else min(due, 10 * _CHUNK)
            self._rest = lines_of(np.arange(self.sent, self.sent + count))
            self.sent += count
        try:
            while self._rest:
                self._rest = self._rest[os.write(self._master, self._rest) :]
        except BlockingIOError:
            return
