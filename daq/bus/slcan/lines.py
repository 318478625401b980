"""Decodes the byte stream of an slcan adapter in blocks.

A frame is a line of ASCII that ends in CR: `t` (standard), `T` (extended), `r`/`R` (remote), and in
the CAN FD dialect of the CANable `d`/`D`, with bit rate switch `b`/`B`; then the identifier in 3 or
8 hex digits, the length code in one, and the payload.  Lines of equal shape are decoded together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameFlag

LONGEST_LINE = 1 + 8 + 1 + 2 * 64 + 4

_CR, _BELL = 13, 7
# The answers to frames that this host sends; and the commands with which a computer at the other
# end of the line (a simulated car) begins and ends, as if this host were the adapter.
_ANSWERS = np.frombuffer(b"zZCOL", np.uint8)
_SET_BITRATE = ord("S")

_NO_DIGIT = 255
_NIBBLE = np.full(256, _NO_DIGIT, np.uint8)
for _value, _digit in enumerate(b"0123456789abcdef"):
    _NIBBLE[_digit] = _NIBBLE[bytes([_digit]).upper()[0]] = _value

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


@dataclass(frozen=True, slots=True)
class SlcanFrames:
    """The frames in a piece of the byte stream."""

    end: NDArray[np.int64]
    """Position of the CR of each frame, shape (n,)."""
    can_id: NDArray[np.uint32]
    flags: NDArray[np.uint16]
    length: NDArray[np.uint8]
    data: NDArray[np.uint8]
    """Payloads; identifier, flags, length and payload are columns of a `FrameBatch`."""
    garbled: int
    """Number of lines that are neither frames nor answers."""
    used: int
    """Number of bytes up to the end of the last line; the rest is the beginning of a line."""


def parse_slcan(stream: bytes) -> SlcanFrames:
    """Decode all complete lines of an slcan byte stream.

    An adapter may append its own millisecond stamp (4 hex digits, command `Z1`): it wraps every
    minute and is not used.
    """
    octets = np.frombuffer(stream, np.uint8)
    ends = np.flatnonzero((octets == _CR) | (octets == _BELL))
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    sizes = ends - starts
    used = int(ends[-1]) + 1 if len(ends) else 0
    kinds = octets[starts] if used else octets[:0]
    answer = (sizes == 0) | ((sizes == 1) & np.isin(kinds, _ANSWERS))
    answer |= (sizes == 2) & (kinds == _SET_BITRATE)

    can_id = np.zeros(len(ends), np.uint32)
    flags = np.zeros(len(ends), np.uint16)
    length = np.zeros(len(ends), np.uint8)
    data = np.zeros((len(ends), 64), np.uint8)
    good = np.zeros(len(ends), bool)
    for kind, properties in _KINDS.items():
        digits = 8 if properties & FrameFlag.EXTENDED else 3
        lines = np.flatnonzero(
            (kinds == kind) & (sizes >= digits + 2) & (octets[ends] == _CR) & ~answer
        )
        codes = _NIBBLE[octets[starts[lines] + digits + 1]]
        for code in np.unique(codes[codes < (16 if properties & _FD else 9)]):
            size = 0 if properties & FrameFlag.REMOTE else int(FD_LENGTHS[code])
            width = digits + 2 + 2 * size
            rows = lines[codes == code]
            rows = rows[(sizes[rows] == width) | (sizes[rows] == width + 4)]
            nibbles = _NIBBLE[octets[starts[rows, None] + np.arange(1, width)]]
            ids = _number(nibbles[:, :digits])
            fine = (nibbles != _NO_DIGIT).all(axis=1)
            fine &= ids < (1 << 29 if properties & FrameFlag.EXTENDED else 1 << 11)
            rows, nibbles = rows[fine], nibbles[fine, digits + 1 :]
            can_id[rows] = ids[fine]
            flags[rows] = properties
            length[rows] = FD_LENGTHS[code]
            data[rows, :size] = nibbles[:, ::2] << 4 | nibbles[:, 1::2]
            good[rows] = True
    width = 8 if length.max(initial=0) <= 8 else 64
    return SlcanFrames(
        ends[good],
        can_id[good],
        flags[good],
        length[good],
        data[good, :width],
        garbled=int(np.sum(~good & ~answer)),
        used=used,
    )


def _number(nibbles: NDArray[np.uint8]) -> NDArray[np.int64]:
    powers = 16 ** np.arange(nibbles.shape[1] - 1, -1, -1, dtype=np.int64)
    return np.asarray(nibbles.astype(np.int64) @ powers, np.int64)
