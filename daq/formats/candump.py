"""Reads candump's log (`candump -l`, `-L`): ``(1700000000.000000) can0 123#DEADBEEF R``."""

from __future__ import annotations

import re

import numpy as np

from .assemble import flags_of, good_frames
from .text import (
    Index,
    Lines,
    Mask,
    Parsed,
    character,
    cut_lines,
    decimals,
    integers,
    packed_bytes,
    possible_times,
)

LACKS = ""
_ERROR_BIT = 0x2000_0000
_BRS, _ESI = 1, 2
_DROPPED = re.compile(rb"DROPCOUNT: dropped (\d{1,9}) CAN frames?")
"""Line of candump, which states frames that its socket lost."""


def parse_candump(block: bytes) -> Parsed:
    """Return the frames of complete lines of a candump log; every line should be one."""
    lines = cut_lines(block)
    rows = np.flatnonzero(lines.count >= 3)
    stamp, stamp_end = lines.token(0, rows)
    t_ns, good = decimals(lines.text, stamp + 1, stamp_end - 1, 9)
    good &= (lines.text[stamp] == ord("(")) & (lines.text[stamp_end - 1] == ord(")"))
    good &= possible_times(t_ns)

    start, end = lines.token(2, rows)
    hash_at = _position_of_hash(lines, start, end)
    can_id, extended, error, has_id = _identifiers(lines, start, hash_at)
    good &= has_id

    after = character(lines, hash_at + 1)
    fd, remote = after == ord("#"), after == ord("r")
    bits, has_bits = integers(lines.text, hash_at + 2, hash_at + 3, 16)
    good &= ~fd | has_bits
    # A classic frame of 8 bytes may be followed by the raw DLC of the wire: 123#..._E
    end = end - 2 * ((lines.text[end - 2] == ord("_")) & ~fd)
    data_at = np.where(fd, hash_at + 3, np.where(remote, hash_at + 2, hash_at + 1))
    asked, has_asked = integers(lines.text, data_at, end, 10, longest=1)
    length = np.where(remote, np.where(has_asked, asked, 0), (end - data_at) // 2)
    good &= np.where(remote, has_asked | (data_at == end), (end - data_at) % 2 == 0)
    good &= (length >= 0) & (length <= np.where(fd, 64, 8))
    size = np.where(good & ~remote, length, 0)
    data, is_hex = packed_bytes(lines.text, data_at, size)
    good &= is_hex

    flags = flags_of(
        len(rows),
        extended=extended,
        remote=remote,
        error=error,
        fd=fd,
        bitrate_switch=fd & (bits & _BRS != 0),
        error_state=fd & (bits & _ESI != 0),
        sent=_transmitted(lines, rows),
    )
    bus = _bus_numbers(lines, *lines.token(1, rows))
    frames = good_frames(good, t_ns, can_id, flags, bus, length, data)
    others = np.sort(np.concatenate([np.flatnonzero(lines.count < 3), rows[~good]]))
    stated = {row: _DROPPED.search(lines.line(row)) for row in others.tolist()}
    bad = [row for row, match in stated.items() if match is None]
    dropped = [(int(lines.number[row]), int(m[1])) for row, m in stated.items() if m is not None]
    return Parsed(frames, lines.number[bad], dropped=tuple(dropped))


def _position_of_hash(lines: Lines, start: Index, end: Index) -> Index:
    """Return the position of the # after each identifier; `end` if there is none."""
    at = end.copy()
    for place in range(8, 0, -1):
        at = np.where(lines.text[start + place] == ord("#"), start + place, at)
    return at


def _transmitted(lines: Lines, rows: Index) -> Mask:
    last = lines.start[lines.first[rows] + np.minimum(lines.count[rows], 4) - 1]
    return np.asarray((lines.count[rows] > 3) & (character(lines, last) == ord("t")))


def _identifiers(lines: Lines, start: Index, end: Index) -> tuple[Index, Mask, Mask, Mask]:
    """Return identifiers, masks of extended and error frames, and a mask of valid identifiers."""
    word, good = integers(lines.text, start, end, 16, longest=8)
    error = word & _ERROR_BIT != 0
    extended = (end - start > 3) & ~error
    good &= word < np.where(error, 2 * _ERROR_BIT, _ERROR_BIT)
    good &= extended | error | (word < 1 << 11)
    return word & (_ERROR_BIT - 1), extended, error, good


def _bus_numbers(lines: Lines, start: Index, end: Index) -> Index:
    """Return the number at the end of an interface's name: 1 for vcan1, 0 if there is none."""
    bus = np.zeros(len(start), np.int64)
    for digits in (1, 2, 3):
        value, is_number = integers(lines.text, np.maximum(end - digits, start), end, 10)
        bus = np.where(is_number & (value < 256), value, bus)
    return bus
