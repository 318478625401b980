"""Reads CAN adapters on a serial line that speak the LAWICEL (slcan) protocol, in blocks.

python-can also supports them, but reads byte by byte: it cannot keep up with a bus of 1 Mbit/s at
half load.  A frame is a line of ASCII that ends in CR: `t` (standard), `T` (extended), `r`/`R`
(remote), and in the CAN FD dialect of the CANable `d`/`D`, with bit rate switch `b`/`B`; then the
identifier in 3 or 8 hex digits, the length code in one, and the payload.
"""

from __future__ import annotations

import contextlib
import re
import time
from binascii import unhexlify
from collections.abc import Callable
from typing import Any

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag

from .source import BLOCK_FRAMES, GATHER_S, REPLUG, STEADY_CLOCK, BusError, HopLosses

_KBIT_S = (10, 20, 50, 100, 125, 250, 500, 750, 1000, 83.3)
BITRATE_CODES = {round(1000 * kbit_s): f"S{code}" for code, kbit_s in enumerate(_KBIT_S)}
"""Command that sets each bit rate of the bus."""
SILENCE_S = 2.0
"""Silence after which the setup is sent again, s: some adapters reset on opening, and miss it."""
_BLOCK_BYTES = BLOCK_FRAMES * 22  # standard frames of 8 bytes; FD frames make smaller blocks
_STAMP_DIGITS = 4
"""Digits of the stamp, ms, that an adapter may append (command `Z1`).  It wraps every minute and is
not used."""
LONGEST_LINE = 1 + 8 + 1 + 2 * 64 + _STAMP_DIGITS  # kind, identifier, length code, payload

_FRAME = re.compile(rb"[tTrRdDbB][0-9A-Fa-f]+")
_ANSWER = re.compile(rb"(?:[zZCOL]?|S.)\a?", re.DOTALL)
"""Answers to frames that this host sends, of which BEL states an error; and the commands with which
a computer at the other end (a simulated car) begins and ends, as if this host were the adapter."""
_KINDS = {
    b"t": 0,
    b"r": int(FrameFlag.REMOTE),
    b"d": int(FrameFlag.FD),
    b"b": int(FrameFlag.FD | FrameFlag.BITRATE_SWITCH),
}
_KINDS |= {kind.upper(): flags | int(FrameFlag.EXTENDED) for kind, flags in _KINDS.items()}
"""Flags by the first letter of a line."""
_LENGTHS: list[int] = FD_LENGTHS.tolist()


def parse_slcan(line: bytes) -> tuple[int, int, int, bytes] | None:
    """Return identifier, flags, length and payload of the frame in a line without its CR.

    None if it is none.
    """
    if not _FRAME.fullmatch(line):
        return None
    kind, flags = line[:1], _KINDS[line[:1]]
    id_digits, id_bits = (3, 11) if kind.islower() else (8, 29)
    can_id, code, data = line[1 : 1 + id_digits], line[1 + id_digits :][:1], line[2 + id_digits :]
    if not code or int(can_id, 16) >= 1 << id_bits:
        return None
    length = _LENGTHS[int(code, 16)]
    n_digits = 0 if kind in b"rR" else 2 * length
    if len(data) not in (n_digits, n_digits + _STAMP_DIGITS) or (length > 8 and kind in b"tTrR"):
        return None
    return int(can_id, 16), flags, length, unhexlify(data[:n_digits])


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
        self._unfinished = b""  # the last line, as far as it was read
        self._garbled = 0
        line.write(self._setup)
        self._repeat_setup_s: float | None = time.monotonic() + SILENCE_S

    def read(self, timeout_s: float) -> FrameBatch:
        """Return a block of frames; see `FrameSource`."""
        pieces: list[tuple[bytes, int]] = []  # with the time of reading, ns
        size, wait_s, deadline_s = 0, timeout_s, 0.0
        while size < _BLOCK_BYTES:
            try:
                piece = self._take(wait_s)
            except Exception as error:  # pyserial raises TypeError and termios.error, too
                if pieces:
                    break  # the next call raises
                raise BusError(self.name, f"has gone: {error}", REPLUG) from error
            if not piece:
                break
            now_s = time.monotonic()
            if not pieces:
                wait_s, deadline_s = GATHER_S, now_s + GATHER_S
            pieces.append((piece, self._now_ns()))
            size += len(piece)
            if now_s >= deadline_s:
                break
        if pieces:
            self._repeat_setup_s = None
        return self._batch(pieces)

    def losses(self) -> HopLosses:
        """Return the losses; the protocol does not report frames lost in the adapter."""
        return HopLosses(bus_garbled=self._garbled)

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

    def _batch(self, pieces: list[tuple[bytes, int]]) -> FrameBatch:
        """Return the frames that end in pieces of input, each with the time of reading its end."""
        rows = []
        for piece, read_ns in pieces:
            # An answer that BEL ends is a line, too.
            text = self._unfinished + piece.replace(b"\a", b"\a\r")
            *lines, self._unfinished = text.split(b"\r")
            for line in lines:
                if frame := parse_slcan(line):
                    can_id, flags, length, payload = frame
                    rows.append((read_ns, can_id, flags, self._index, length, payload))
                else:
                    self._garbled += not _ANSWER.fullmatch(line)
            # A line that is too long is replaced by a character with which no line begins: it
            # counts as one garbled line when it ends, and memory stays bounded.
            if len(self._unfinished) > LONGEST_LINE:
                self._unfinished = b"?"
        return FrameBatch.from_rows(rows)


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
        device, baudrate=int(baud or 115_200), timeout=0, write_timeout=1, exclusive=True
    )
    return SlcanSource(line, f"slcan {channel}", bitrate, bus)
