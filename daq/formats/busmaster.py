"""Reads BUSMASTER's log: ``22:20:14:9920 Rx 1 0x21A s 8 FE 36 12 FE 69 05 07 AD``.

The head, in lines of ``***``, states the date, the base of the numbers and the origin of times.
"""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from .assemble import flags_of, good_frames, possible_ids
from .text import Index, Lines, Mask, Parsed, character, cut_lines, integers, is_word, spaced_bytes

LACKS = "error frames, and CAN FD"
_DATE = re.compile(rb"START DATE AND TIME (\d+):(\d+):(\d+) (\d+):(\d+):(\d+):(\d+)")
_DAY_NS = 86_400_000_000_000


class BusmasterParser:
    """Parses a log block by block; remembers its head and its last line."""

    def __init__(self) -> None:
        self._base = 16
        self._mode = b"SYSTEM"
        self._midnight_ns = self._start_ns = self._last_ns = 0

    def __call__(self, block: bytes) -> Parsed:
        """Return the frames of complete lines."""
        lines = cut_lines(block)
        starred = character(lines, lines.start[lines.first]) == ord("*")
        for row in np.flatnonzero(starred).tolist():
            self._head(lines.line(row))
        rows = np.flatnonzero(~starred & (lines.count >= 6))
        stamp_ns, good = _clock(lines, rows)
        t_ns = self._absolute(np.where(good, stamp_ns, 0))

        sent = is_word(lines, *lines.token(1, rows), b"tx")
        good &= sent | is_word(lines, *lines.token(1, rows), b"rx")
        bus, has_bus = integers(lines.text, *lines.token(2, rows), 10, longest=3)
        start, end = lines.token(3, rows)
        start = start + 2 * (character(lines, start + 1) == ord("x"))
        can_id, has_id = integers(lines.text, start, end, self._base, longest=9)
        kind, kind_end = lines.token(4, rows)
        letter = character(lines, kind)
        extended = letter == ord("x")
        remote = (kind_end - kind == 2) & (character(lines, kind + 1) == ord("r"))
        good &= (extended | (letter == ord("s"))) & ((kind_end - kind == 1) | remote)
        length, has_length = integers(lines.text, *lines.token(5, rows), 10, longest=2)
        good &= has_bus & has_id & has_length & (length <= 8) & (bus < 256)
        good &= possible_ids(can_id, extended)
        size = np.where(good & ~remote, length, 0)
        good &= lines.count[rows] >= 6 + size
        size = np.where(good, size, 0)
        data, whole = spaced_bytes(lines, lines.first[rows] + 6, size, self._base)
        good &= whole
        flags = flags_of(len(rows), extended=extended, remote=remote, sent=sent)
        frames = good_frames(good, t_ns, can_id, flags, np.maximum(bus, 1) - 1, length, data)
        short = lines.number[~starred & (lines.count < 6)]
        bad = np.sort(np.concatenate([short, lines.number[rows[~good]]]))
        return Parsed(frames, bad, header=bool(starred.any()))

    def _head(self, line: bytes) -> None:
        if b"***DEC***" in line or b"***HEX***" in line:
            self._base = 10 if b"DEC" in line else 16
        for mode in (b"SYSTEM", b"ABSOLUTE", b"RELATIVE"):
            if mode + b" MODE" in line:
                self._mode = mode
        if found := _DATE.search(line):
            day, month, year, hour, minute, second, _ = (int(part) for part in found.groups())
            try:
                midnight = datetime(year, month, day)
                since_s = (hour * 60 + minute) * 60 + second
                self._midnight_ns = round(midnight.timestamp()) * 1_000_000_000
            except (ValueError, OverflowError, OSError):
                return
            fraction = found[7].ljust(9, b"0")[:9]
            self._start_ns = self._midnight_ns + since_s * 1_000_000_000 + int(fraction)
            self._last_ns = self._start_ns if self._mode == b"RELATIVE" else 0

    def _absolute(self, stamp_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return times since 1970 from those of the lines."""
        if not len(stamp_ns):
            return stamp_ns
        if self._mode == b"ABSOLUTE":
            return self._start_ns + stamp_ns
        if self._mode == b"RELATIVE":
            t_ns = (self._last_ns or self._start_ns) + np.cumsum(stamp_ns)
            self._last_ns = int(t_ns[-1])
            return np.asarray(t_ns)
        # A log may continue past midnight: the time of day begins again.
        steps = np.diff(stamp_ns, prepend=self._last_ns % _DAY_NS)
        days = self._last_ns // _DAY_NS + np.cumsum(steps < -_DAY_NS // 2)
        since_ns = days * _DAY_NS + stamp_ns
        self._last_ns = int(since_ns[-1])
        return np.asarray(self._midnight_ns + since_ns)


def _clock(lines: Lines, rows: Index) -> tuple[NDArray[np.int64], Mask]:
    """Return times written as H:MM:SS:ffff, ns, and a mask of valid ones."""
    start, end = lines.token(0, rows)
    value = np.zeros(len(rows), np.int64)
    good = np.ones(len(rows), bool)
    for unit_ns in (3600_000_000_000, 60_000_000_000, 1_000_000_000):
        stop = start.copy()
        for _ in range(5):
            stop += (lines.text[stop] != ord(":")) & (stop < end)
        number, is_number = integers(lines.text, start, stop, 10, longest=4)
        good &= is_number & (lines.text[stop] == ord(":"))
        value += number * unit_ns
        start = np.minimum(stop + 1, end)
    digits = end - start
    number, is_number = integers(lines.text, start, end, 10, longest=9)
    good &= is_number
    return value + number * 10 ** (9 - digits).clip(0, 9), good
