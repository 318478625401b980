"""Reads PEAK's TRC, versions 1.0 to 2.1: one event per line, times in ms from a start time."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag

from .assemble import good_frames, possible_ids
from .text import Index, Lines, Parsed, cut_lines, decimals, integers, is_word, spaced_bytes

LACKS = ""
# N number, O time offset, B bus, T type, I identifier, d direction, R reserved, l length in bytes,
# L data length code, D data: the words of the header of version 2.
_COLUMNS = {
    "1.0": "NOILD",
    "1.1": "NOTILD",
    "1.2": "NOBTILD",
    "1.3": "NOBTIRLD",
    "2.0": "NOTIdlD",
    "2.1": "NOTBIdRLD",
}
_NOT_A_FRAME = 0xFFFF_FFFF
"""Identifier of a line about the bus, not a frame, in version 1.0."""
_EPOCH_DAYS = 25_569
"""1970-01-01, in days since 1899-12-30."""


class TrcParser:
    """Parses a TRC log block by block; remembers its header.

    The header states local time without a zone; as in python-can it is read as UTC.
    """

    def __init__(self) -> None:
        self._version = "1.0"
        self._columns = _COLUMNS["1.0"]
        self._start_ns = 0

    def __call__(self, block: bytes) -> Parsed:
        """Return the frames of complete lines; status and event lines are skipped."""
        lines = cut_lines(block)
        first = lines.text[lines.start[lines.first]]
        header = self._header(lines, np.flatnonzero(first == ord(";")))
        rows = np.flatnonzero(first != ord(";"))
        needed = self._columns.index("D")
        bad = lines.number[rows[lines.count[rows] < needed]]
        rows = rows[lines.count[rows] >= needed]
        rows, flags = self._kinds(lines, rows)
        frames, torn = self._frames(lines, rows, flags)
        return Parsed(frames, np.sort(np.concatenate([bad, torn])), header)

    def _header(self, lines: Lines, rows: Index) -> bool:
        found = False
        for row in rows.tolist():
            name, _, value = lines.line(row).decode("ascii", "replace").partition("=")
            value = value.strip()
            if name == ";$FILEVERSION":
                self._version = value if value in _COLUMNS else self._version
                self._columns = _COLUMNS[self._version]
                found = True
            elif name == ";$STARTTIME":
                self._start_ns = _days_ns(value)
            elif name == ";$COLUMNS":
                letters = value.replace(",", "")
                if len(set(letters)) == len(letters) and {*"OTID"} <= {*letters} <= {*"NOTBIdRlLD"}:
                    self._columns = letters
        return found

    def _kinds(self, lines: Lines, rows: Index) -> tuple[Index, NDArray[np.uint16]]:
        """Return the rows that are frames, and the flags stated by their type."""
        flags = np.zeros(len(rows), np.uint16)
        if "T" not in self._columns:
            return rows, flags
        kind = lines.token(self._columns.index("T"), rows)
        known = np.zeros(len(rows), bool)
        words = _TYPES_2 if self._version >= "2" else _TYPES_1
        for word, bits in words.items():
            same = is_word(lines, *kind, word)
            known |= same
            flags[same] = bits
        return rows[known], flags[known]

    def _frames(
        self, lines: Lines, rows: Index, flags: NDArray[np.uint16]
    ) -> tuple[FrameBatch, Index]:
        """Return the frames of rows, and the numbers of incomplete lines."""
        columns = self._columns
        offset_ns, good = decimals(lines.text, *lines.token(columns.index("O"), rows), 6)
        start, end = lines.token(columns.index("I"), rows)
        can_id, has_id = integers(lines.text, start, end, 16, longest=8)
        if "T" not in columns and np.any(can_id == _NOT_A_FRAME):
            is_frame = can_id != _NOT_A_FRAME
            return self._frames(lines, rows[is_frame], flags[is_frame])
        error = flags & FrameFlag.ERROR != 0
        extended = (end - start > 4) & ~error
        good &= has_id & possible_ids(can_id, extended | error)
        flags = flags | extended * np.uint16(FrameFlag.EXTENDED)
        if "d" in columns:
            sent = is_word(lines, *lines.token(columns.index("d"), rows), b"tx")
            flags |= sent * np.uint16(FrameFlag.TRANSMITTED)
        bus = np.zeros(len(rows), np.int64)
        if "B" in columns:  # a dash if there is no number
            at = lines.token(columns.index("B"), rows)
            number, is_number = integers(lines.text, *at, 10, longest=3)
            bus = np.where(is_number, np.clip(number - 1, 0, 255), 0)

        letter = "l" if "l" in columns else "L"
        length, has_length = integers(
            lines.text, *lines.token(columns.index(letter), rows), 10, longest=2
        )
        fd = flags & FrameFlag.FD != 0
        if letter == "L" and self._version >= "2":
            has_length &= length < 16
            length = np.where(fd, FD_LENGTHS[np.minimum(length, 15)], np.minimum(length, 8))
        good &= has_length & (length <= np.where(fd, 64, 8))
        data_at = columns.index("D")
        asked = is_word(lines, *lines.token_or_none(data_at, rows), b"rtr")
        flags |= asked * np.uint16(FrameFlag.REMOTE)
        size = np.where(good & (flags & FrameFlag.REMOTE == 0), length, 0)
        good &= lines.count[rows] >= data_at + size
        size = np.where(good, size, 0)
        data, whole = spaced_bytes(lines, lines.first[rows] + data_at, size, 16)
        good &= whole
        t_ns = self._start_ns + offset_ns
        return good_frames(good, t_ns, can_id, flags, bus, length, data), lines.number[rows[~good]]


_TYPES_1 = {
    b"rx": np.uint16(0),
    b"tx": np.uint16(FrameFlag.TRANSMITTED),
    b"error": np.uint16(FrameFlag.ERROR),
}
_TYPES_2 = {
    b"dt": np.uint16(0),
    b"rr": np.uint16(FrameFlag.REMOTE),
    b"er": np.uint16(FrameFlag.ERROR),
    b"fd": np.uint16(FrameFlag.FD),
    b"fb": np.uint16(FrameFlag.FD | FrameFlag.BITRATE_SWITCH),
    b"fe": np.uint16(FrameFlag.FD | FrameFlag.BITRATE_SWITCH | FrameFlag.ERROR_STATE),
    b"bi": np.uint16(FrameFlag.FD | FrameFlag.ERROR_STATE),
}


def _days_ns(text: str) -> int:
    """Return days since 1899-12-30 as ns since 1970; 0 if the text is not a number."""
    try:
        ns = int((Decimal(text) - _EPOCH_DAYS) * 86_400_000_000_000)
    except (InvalidOperation, OverflowError, ValueError):
        return 0
    return ns if 0 <= ns < 1 << 62 else 0
