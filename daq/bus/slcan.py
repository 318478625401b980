"""Reads CAN adapters on a serial line that speak the LAWICEL (slcan) protocol, in blocks.

python-can also supports them, but reads byte by byte: it cannot keep up with a bus of 1 Mbit/s at
half load.  A frame is a line of ASCII that ends in CR: `t` (standard), `T` (extended), `r`/`R`
(remote), and in the CAN FD dialect of the CANable `d`/`D`, with bit rate switch `b`/`B`; then the
identifier in 3 or 8 hex digits, the length code in one, and the payload.  Lines of equal shape are
decoded together.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag

from .source import BLOCK_FRAMES, GATHER_S, REPLUG, STEADY_CLOCK, BusError, HopLosses

_KBIT_S = (10, 20, 50, 100, 125, 250, 500, 750, 1000, 83.3)
BITRATE_CODES = {round(1000 * kbit_s): f"S{code}" for code, kbit_s in enumerate(_KBIT_S)}
"""Command that sets each bit rate of the bus."""
SILENCE_S = 2.0
"""Silence after which the setup is sent again, s: some adapters reset on opening, and miss it."""
_BLOCK_BYTES = BLOCK_FRAMES * 22  # of standard frames of 8 bytes; of shorter ones it holds more
_STAMP_DIGITS = 4
LONGEST_LINE = 1 + 8 + 1 + 2 * 64 + _STAMP_DIGITS  # kind, identifier, length code, payload

_CR, _BELL = 13, 7
# The answers to frames that this host sends; and the commands with which a computer at the other
# end of the line (a simulated car) begins and ends, as if this host were the adapter.
_ANSWERS = np.frombuffer(b"zZCOL", np.uint8)
_SET_BITRATE = ord("S")

_NO_DIGIT = 255
_NIBBLE = np.full(256, _NO_DIGIT, np.uint8)  # value of a hex digit, by its character
for _digits in (b"0123456789abcdef", b"0123456789ABCDEF"):
    _NIBBLE[np.frombuffer(_digits, np.uint8)] = np.arange(16)

_FD = FrameFlag.FD
_KINDS: dict[int, FrameFlag] = {
    ord("t"): FrameFlag(0),
    ord("T"): FrameFlag.EXTENDED,
    ord("r"): FrameFlag.REMOTE,
    ord("R"): FrameFlag.REMOTE | FrameFlag.EXTENDED,
    ord("d"): _FD,
    ord("D"): _FD | FrameFlag.EXTENDED,
    ord("b"): _FD | FrameFlag.BITRATE_SWITCH,
    ord("B"): _FD | FrameFlag.BITRATE_SWITCH | FrameFlag.EXTENDED,
}


def parse_slcan(stream: bytes) -> tuple[FrameBatch, int, int]:
    """Return the frames in the complete lines of a byte stream; their stamp is the place of the CR.

    Also returns the number of lines that are neither frames nor answers, and that of the bytes up
    to the end of the last line.  An adapter may append its own millisecond stamp (command `Z1`): it
    wraps every minute and is not used.  Lines of one kind and length are decoded together.
    """
    octets = np.frombuffer(stream, np.uint8)
    ends = np.flatnonzero((octets == _CR) | (octets == _BELL))  # positions, (lines,), as below
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    line_lengths = ends - starts
    n_used = int(ends[-1]) + 1 if len(ends) else 0
    kinds = octets[starts] if n_used else octets[:0]
    is_answer = (line_lengths == 0) | ((line_lengths == 1) & np.isin(kinds, _ANSWERS))
    is_answer |= (line_lengths == 2) & (kinds == _SET_BITRATE)

    can_id = np.zeros(len(ends), np.uint32)
    flags = np.zeros(len(ends), np.uint16)
    length = np.zeros(len(ends), np.uint8)
    data = np.zeros((len(ends), 64), np.uint8)
    is_frame_line = np.zeros(len(ends), bool)
    for kind, properties in _KINDS.items():
        id_digits = 8 if properties & FrameFlag.EXTENDED else 3
        lines = np.flatnonzero(
            (kinds == kind) & (line_lengths >= id_digits + 2) & (octets[ends] == _CR) & ~is_answer
        )
        codes = _NIBBLE[octets[starts[lines] + id_digits + 1]]
        length_codes = 16 if properties & _FD else 9  # a classic frame has 0 to 8 bytes
        for code in np.unique(codes[codes < length_codes]):
            n_payload = 0 if properties & FrameFlag.REMOTE else int(FD_LENGTHS[code])
            n_characters = id_digits + 2 + 2 * n_payload
            rows = lines[codes == code]
            stamp_digits = line_lengths[rows] - n_characters
            rows = rows[(stamp_digits == 0) | (stamp_digits == _STAMP_DIGITS)]
            # Identifier, length code and payload of each line, (rows, characters without the kind).
            nibbles = _NIBBLE[octets[starts[rows, None] + np.arange(1, n_characters)]]
            place_values = 16 ** np.arange(id_digits - 1, -1, -1, dtype=np.int64)
            ids = nibbles[:, :id_digits].astype(np.int64) @ place_values
            is_valid = (nibbles != _NO_DIGIT).all(axis=1)
            is_valid &= ids < (1 << 29 if properties & FrameFlag.EXTENDED else 1 << 11)
            rows, payload = rows[is_valid], nibbles[is_valid, id_digits + 1 :]
            can_id[rows] = ids[is_valid]
            flags[rows] = properties
            length[rows] = FD_LENGTHS[code]
            data[rows, :n_payload] = payload[:, ::2] << 4 | payload[:, 1::2]
            is_frame_line[rows] = True
    data_width = 8 if length.max(initial=0) <= 8 else 64
    frames = FrameBatch(ends, can_id, flags, np.zeros_like(length), length, data[:, :data_width])
    return frames.select(is_frame_line), int(np.sum(~is_frame_line & ~is_answer)), n_used


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
        pieces: list[bytes] = []
        read_ns: list[int] = []  # when each piece was read
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
            read_ns.append(self._now_ns())
            now_s = time.monotonic()
            if not pieces:
                wait_s, deadline_s = GATHER_S, now_s + GATHER_S
            pieces.append(piece)
            size += len(piece)
            if now_s >= deadline_s:
                break
        return self._batch(pieces, read_ns)

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

    def _batch(self, pieces: list[bytes], read_ns: list[int]) -> FrameBatch:
        """Return the frames that end in pieces of input, each with the time of reading its end."""
        if not pieces:
            return FrameBatch.empty()
        self._repeat_setup_s = None
        sizes = [len(self._unfinished) + len(pieces[0]), *map(len, pieces[1:])]
        stream = self._unfinished + b"".join(pieces)
        frames, garbled, n_used = parse_slcan(stream)
        self._garbled += garbled
        # A line that is too long is replaced by a character with which no line begins: it counts as
        # one garbled line when it ends, and memory stays bounded.
        self._unfinished = stream[n_used:] if len(stream) - n_used <= LONGEST_LINE else b"?"
        # `parse_slcan` stamps a frame with the place of the end of its line.
        piece_index = np.searchsorted(np.cumsum(sizes), frames.t_ns, side="right")
        t_ns, bus = np.array(read_ns, np.int64)[piece_index], np.full(len(frames), self._index)
        return replace(frames, t_ns=t_ns, bus=bus)


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
