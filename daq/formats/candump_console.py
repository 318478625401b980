"""Reads candump's screen: ``(1700000000.000000)  can0  123   [8]  DE AD BE EF 00 01 02 03``.

Times count from 1970, from the first frame or from the previous frame, or are dates (candump -t a,
z, d, A).
"""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from .assemble import flags_of, good_frames
from .candump import bus_numbers, identifiers
from .text import Index, Lines, Mask, Parsed, character, cut_lines, decimals, integers, spaced_bytes

LACKS = ""
UNTIMED = re.compile(rb"\s*\w+\s+(?:[RT]X\s+\S\s+\S\s+)?[0-9A-F]{3,8}\s+\[\d+\]\s")
"""A line of a screen without times."""
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

        start, end = lines.token(place, rows)
        width = end - start - 2
        length, has_length = integers(lines.text, start + 1, end - 1, 10, longest=2)
        fd = width == 2
        start, end = lines.token(place - 1, rows)
        can_id, extended, error, has_id = identifiers(lines, start, end)
        good &= has_id & has_length & (length <= np.where(fd, 64, 8))
        start, _ = lines.token(np.minimum(place + 1, lines.count[rows] - 1), rows)
        remote = (lines.count[rows] > place + 1) & (character(lines, start) == ord("r"))
        good &= remote | (lines.count[rows] > place + length)
        size = np.where(good & ~remote, length, 0)
        data, is_hex = spaced_bytes(lines, lines.first[rows] + place + 1, size, 16)
        good &= is_hex

        marked = place >= name + 5  # RX or TX, B and E or -
        starts = [lines.token(np.where(marked, name + n, name), rows)[0] for n in (1, 2, 3)]
        way, brs, esi = (character(lines, start) for start in starts)
        flags = flags_of(
            len(rows),
            extended=extended,
            remote=remote,
            error=error,
            fd=fd,
            bitrate_switch=marked & fd & (brs == ord("b")),
            error_state=marked & fd & (esi == ord("e")),
            sent=marked & (way == ord("t")),
        )
        bus = bus_numbers(lines, *lines.token(name, rows))
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
        start, end = lines.token(np.minimum(place, lines.count - 1), rows)
        has_length = (lines.count > place) & (lines.text[start] == ord("["))
        has_length &= lines.text[end - 1] == ord("]")
        found = np.where(has_length, place, found)
    return found
