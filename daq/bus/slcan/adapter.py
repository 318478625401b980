"""Reads CAN adapters on a serial line that speak the LAWICEL (slcan) protocol.

python-can also supports them, but reads byte by byte: it cannot keep up with a bus of 1 Mbit/s at
half load.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from dbc.frames import FrameBatch

from ...errors import BusError
from ..source import BLOCK_FRAMES, GATHER_S, SourceLosses
from ..steady_clock import STEADY_CLOCK
from .lines import LONGEST_LINE, parse_slcan

BITRATE_CODES = {
    10_000: "S0",
    20_000: "S1",
    50_000: "S2",
    100_000: "S3",
    125_000: "S4",
    250_000: "S5",
    500_000: "S6",
    750_000: "S7",
    1_000_000: "S8",
    83_300: "S9",
}
SERIAL_BAUD = 115_200
SILENCE_S = 2.0
"""Silence after opening, s, after which the setup is sent again: some adapters reset when their
line is opened, and miss the setup."""
_BLOCK_BYTES = BLOCK_FRAMES * 22  # standard frames of 8 bytes; FD frames make smaller blocks


class SlcanSource:
    """An slcan adapter on an open serial line.

    Frames are stamped with the host's time at which the end of their line was read.

    `line`: open serial line; closed by `close`.  `name`: name of the bus in messages.  `bitrate`:
    bit rate of the CAN bus, a key of `BITRATE_CODES`.  `index`: number of the bus in its frames.
    `now_ns`: the host's clock, ns since 1970.
    """

    def __init__(
        self,
        line: Any,
        name: str,
        bitrate: int,
        index: int,
        now_ns: Callable[[], int] = STEADY_CLOCK.now_ns,
    ) -> None:
        self.name = name
        self._line = line
        self._setup = f"C\r{BITRATE_CODES[bitrate]}\rO\r".encode()
        self._index = index
        self._now_ns = now_ns
        self._begun = b""
        self._garbled = 0
        line.write(self._setup)
        self._repeat_setup_s: float | None = time.monotonic() + SILENCE_S

    def read(self, timeout_s: float) -> FrameBatch:
        """Return a block of frames; see `daq.bus.source.FrameSource`."""
        pieces: list[bytes] = []
        read_ns: list[int] = []
        size, wait_s, deadline_s = 0, timeout_s, 0.0
        while size < _BLOCK_BYTES:
            try:
                piece = self._take(wait_s)
            except Exception as error:  # pyserial raises TypeError and termios.error, too
                if pieces:
                    break  # the next call raises
                raise BusError(
                    self.name, f"has gone: {error}", "check plug and power, then start again"
                ) from error
            if not piece:
                break
            read_ns.append(self._now_ns())
            pieces.append(piece)
            size += len(piece)
            wait_s, now_s = GATHER_S, time.monotonic()
            deadline_s = deadline_s or now_s + GATHER_S
            if now_s >= deadline_s:
                break
        return self._batch(pieces, read_ns)

    def losses(self) -> SourceLosses:
        """Return the losses; the protocol does not report frames lost in the adapter."""
        return SourceLosses(garbled=self._garbled)

    def close(self) -> None:
        """Take the adapter off the bus and close the line."""
        with contextlib.suppress(Exception):  # a lost line accepts no command
            self._line.write(b"C\r")
        with contextlib.suppress(Exception):
            self._line.close()

    def _take(self, wait_s: float) -> bytes:
        """Return the bytes received; wait for the first."""
        if self._repeat_setup_s is not None and time.monotonic() > self._repeat_setup_s:
            self._line.write(self._setup)
            self._repeat_setup_s = None
        if self._line.timeout != wait_s:  # setting it costs a system call or two
            self._line.timeout = wait_s
        first: bytes = self._line.read(1)
        return first + self._line.read(self._line.in_waiting) if first else b""

    def _batch(self, pieces: list[bytes], read_ns: list[int]) -> FrameBatch:
        if not pieces:
            return FrameBatch.empty()
        self._repeat_setup_s = None
        sizes = [len(self._begun) + len(pieces[0]), *map(len, pieces[1:])]
        stream = self._begun + b"".join(pieces)
        frames = parse_slcan(stream)
        self._garbled += frames.garbled
        # A line that is too long is replaced by a character with which no line begins: it counts as
        # one garbled line when it ends, and memory stays bounded.
        rest = stream[frames.used :]
        self._begun = rest if len(rest) <= LONGEST_LINE else b"?"
        piece = np.searchsorted(np.cumsum(sizes), frames.end, side="right")
        return FrameBatch(
            np.array(read_ns, np.int64)[piece],
            frames.can_id,
            frames.flags,
            np.full(len(frames.end), self._index),
            frames.length,
            frames.data,
        )


def open_slcan(channel: str, bitrate: int, bus: int) -> SlcanSource:
    """Open an adapter.

    `channel`: serial device, with `@BAUD` if that is not 115200.  `bus`: number of the bus in its
    frames.  Raises BusError if the protocol has no such bit rate.  Raises OSError or ValueError if
    there is no such line or it cannot be opened.
    """
    import serial

    if bitrate not in BITRATE_CODES:
        rates = ", ".join(map(str, sorted(BITRATE_CODES)))
        raise BusError(f"slcan {channel}", f"cannot do {bitrate} bit/s", f"choose one of {rates}")
    device, _, baud = channel.partition("@")
    line = serial.serial_for_url(
        device, baudrate=int(baud or SERIAL_BAUD), timeout=0, write_timeout=1, exclusive=True
    )
    return SlcanSource(line, f"slcan {channel}", bitrate, bus)
