"""Reads candump's log (`candump -l`, `-L`): ``(1700000000.000000) can0 123#DEADBEEF R``."""

from __future__ import annotations

import re
from binascii import unhexlify
from functools import lru_cache

from .reader import (
    BITRATE_SWITCH,
    ERROR,
    ERROR_STATE,
    EXTENDED,
    FD,
    REMOTE,
    SENT,
    Record,
    nanoseconds,
    number,
)

LACKS = ""
_FRAME = re.compile(
    rb"\s*\(([-\d.]+)\)\s+(\S+)\s+([0-9A-Fa-f]{1,8})#(#[0-9A-Fa-f])?"
    rb"(?:([Rr]\d?)|([0-9A-Fa-f]*)(?:_[0-9A-Fa-f])?)(?:\s+(\S).*)?\s*$"
)
"""Time, interface, identifier, FD bits (``##1``: BRS, ``##2``: ESI), request or payload,
direction.  A classic frame of 8 bytes may be followed by the raw DLC of the wire: ``123#..._E``."""
_ERROR_BIT = 0x2000_0000
_OPEN, _CLOSE = b"()"


class CandumpParser:
    """Parses a candump log line by line."""

    has_header = states_length = spaced = False

    def __call__(self, line: bytes) -> Record | int | None:
        """Return the frame in a line, or the number of frames that it states as lost."""
        try:
            stamp, interface, frame, *more = line.split()
            identifier, mark, digits = frame.partition(b"#")
            data = unhexlify(digits)
            if mark and stamp[0] == _OPEN and stamp[-1] == _CLOSE:
                can_id, flags = _identifier(identifier)
                if more and more[0] in (b"T", b"t"):
                    flags |= SENT
                t_ns = nanoseconds(stamp[1:-1])
                return t_ns, can_id, flags, _bus(interface), len(data), data
        except ValueError:
            pass
        return _other(line)


def _other(line: bytes) -> Record | int | None:
    """Return what a line holds that is not a classic data frame with its plain payload."""
    match = _FRAME.match(line)
    try:
        if match is None:
            # candump states the frames that its socket lost.
            stated = re.search(rb"DROPCOUNT: dropped (\d{1,9}) CAN frames?", line)
            return int(stated[1]) if stated else None if line.strip() else 0
        time, interface, identifier, fd, request, digits, direction = match.groups()
        can_id, flags = _identifier(identifier)
        if direction in (b"T", b"t"):
            flags |= SENT
        t_ns, bus = nanoseconds(time), _bus(interface)
        if request:
            return t_ns, can_id, flags | REMOTE, bus, int(request[1:] or b"0"), b""
        if fd:
            bits = int(fd[1:], 16)
            flags |= FD | BITRATE_SWITCH * (bits & 1) | ERROR_STATE * (bits >> 1 & 1)
        return t_ns, can_id, flags, bus, len(digits) // 2, unhexlify(digits)
    except ValueError:
        return None


@lru_cache(4096)
def _identifier(text: bytes) -> tuple[int, int]:
    """Return an identifier and its flags; more than three digits mark 29 bits."""
    word = number(text, 16)
    if word & _ERROR_BIT:
        return word & ~_ERROR_BIT, ERROR
    return word, EXTENDED if len(text) > 3 else 0


@lru_cache(256)
def _bus(interface: bytes) -> int:
    """Return the number at the end of an interface's name: 1 for vcan1, 0 if there is none."""
    digits = re.search(rb"\d{0,3}$", interface)
    value = int(digits[0] or b"0") if digits else 0
    return value if value < 256 else value % 100
