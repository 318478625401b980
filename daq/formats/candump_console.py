"""Reads candump's screen: ``(1700000000.000000)  can0  123   [8]  DE AD BE EF 00 01 02 03``.

Times count from 1970, from the first frame or from the previous frame, or are dates (candump -t a,
z, d, A).
"""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameFlag

from .assemble import good_frames
from .text import Index, Lines, Mask, Parsed, character, cut_lines, decimals, integers, spaced_bytes

LACKS = ""
UNTIMED = re.compile(rb"\s*\w+\s+(?:[RT]X\s+\S\s+\S\s+)?[0-9A-F]{3,8}\s+\[\d+\]\s")
"""A line of a screen without times."""
_ERROR_BIT = 0x2000_0000
_FURTHEST = 7
"""Number of the length's token in a line with a date, the direction and its two marks."""
_SINCE_S = 10_000_000
"""Times below this, s, are not dates."""


class ConsoleParser:
    """Parses candump's screen block by block; remembers the origin of its times."""

    def __init__(self) -> None:
        self._differences: bool | None = None
        self._last_ns = 0

    def __call__(self, block: bytes) -> Parsed:
        """Return the frames of complete lines; every line should be one."""
        lines = cut_lines(block)
        at = _length_at(lines)
        rows = np.flatnonzero(at >= 3)
        place = at[rows]
        t_ns, good, dated = self._times(lines, rows)
        name = 1 + dated
        good &= place >= name + 2

        start, end = _token(lines, rows, place)
        width = end - start - 2
        length, has_length = integers(lines.text, start + 1, end - 1, 10, longest=2)
        fd = width == 2
        start, end = _token(lines, rows, place - 1)
        can_id, has_id = integers(lines.text, start, end, 16, longest=8)
        error = can_id & _ERROR_BIT != 0
        extended = (end - start > 3) & ~error
        good &= has_id & has_length & (length <= np.where(fd, 64, 8))
        good &= can_id < np.where(error, 2 * _ERROR_BIT, _ERROR_BIT)
        good &= extended | error | (can_id < 1 << 11)
        start, _ = _token(lines, rows, np.minimum(place + 1, lines.count[rows] - 1))
        remote = (lines.count[rows] > place + 1) & (character(lines, start) == ord("r"))
        good &= remote | (lines.count[rows] > place + length)
        size = np.where(good & ~remote, length, 0)
        data, is_hex = spaced_bytes(lines, lines.first[rows] + place + 1, size, 16)
        good &= is_hex

        marked = place >= name + 5  # RX or TX, B and E or -
        marks = [_first(lines, rows, np.where(marked, name + n, name)) for n in (1, 2, 3)]
        flags = np.zeros(len(rows), np.uint16)
        for bit, mark in (
            (FrameFlag.EXTENDED, extended),
            (FrameFlag.REMOTE, remote),
            (FrameFlag.ERROR, error),
            (FrameFlag.FD, fd),
            (FrameFlag.BITRATE_SWITCH, marked & fd & (marks[1] == ord("b"))),
            (FrameFlag.ERROR_STATE, marked & fd & (marks[2] == ord("e"))),
            (FrameFlag.TRANSMITTED, marked & (marks[0] == ord("t"))),
        ):
            flags |= mark * np.uint16(bit)
        can_id = can_id & (_ERROR_BIT - 1)
        bus = _bus(lines, rows, name)
        frames = good_frames(good, t_ns, can_id, flags, bus, length, data)
        bad = np.concatenate([lines.number[at < 3], lines.number[rows[~good]]])
        return Parsed(frames, np.sort(bad))

    def _times(self, lines: Lines, rows: Index) -> tuple[NDArray[np.int64], Mask, Index]:
        """Return times, a mask of valid ones, and the number of additional tokens of a date."""
        start, end = lines.token(0, rows)
        opened = lines.text[start] == ord("(")
        closed = lines.text[end - 1] == ord(")")
        t_ns, good = decimals(lines.text, start + 1, end - 1, 9)
        good &= opened & closed
        dated = opened & ~closed
        for row in np.flatnonzero(dated).tolist():  # rare, and written for people
            first, second = lines.first[rows[row]], lines.first[rows[row]] + 1
            text = lines.text[lines.start[first] + 1 : lines.end[second] - 1].tobytes()
            try:
                moment = datetime.fromisoformat(text.decode("ascii"))
                whole_s = round(moment.replace(microsecond=0).timestamp())
                t_ns[row] = whole_s * 1_000_000_000 + moment.microsecond * 1000
                good[row] = True
            except (ValueError, OverflowError, OSError):
                good[row] = False
        if self._differences is None and good.any():
            own = t_ns[good]
            backwards = np.count_nonzero(np.diff(own) < 0)
            small = int(own.max()) < _SINCE_S * 1_000_000_000
            self._differences = bool(small and backwards > len(own) // 10)
        if self._differences:
            t_ns = self._last_ns + np.cumsum(np.where(good, t_ns, 0))
            self._last_ns = int(t_ns[-1]) if len(t_ns) else self._last_ns
        return t_ns, good, dated.astype(np.intp)


def _length_at(lines: Lines) -> Index:
    """Return the number of the token with the length, ``[8]``, in each line; 0 if there is none."""
    rows = np.arange(len(lines.first))
    found = np.zeros(len(rows), np.intp)
    for place in range(_FURTHEST, 0, -1):
        start, end = _token(lines, rows, np.minimum(place, lines.count - 1))
        has_length = (lines.count > place) & (lines.text[start] == ord("["))
        has_length &= lines.text[end - 1] == ord("]")
        found = np.where(has_length, place, found)
    return found


def _token(lines: Lines, rows: Index, place: Index) -> tuple[Index, Index]:
    index = lines.first[rows] + place
    return lines.start[index], lines.end[index]


def _first(lines: Lines, rows: Index, place: Index) -> NDArray[np.uint8]:
    return character(lines, _token(lines, rows, place)[0])


def _bus(lines: Lines, rows: Index, place: Index) -> Index:
    """Return the number at the end of the interface's name: 1 for vcan1, 0 if there is none."""
    start, end = _token(lines, rows, place)
    bus = np.zeros(len(rows), np.int64)
    for digits in (1, 2, 3):
        value, is_number = integers(lines.text, np.maximum(end - digits, start), end, 10)
        bus = np.where(is_number & (value < 256), value, bus)
    return bus
