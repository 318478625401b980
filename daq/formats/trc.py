"""Reads PEAK's TRC, versions 1.0 to 2.1: one event per line, times in ms from a start time."""

from __future__ import annotations

import re
from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch, FrameFlag

from .assemble import good_frames, interleaved, possible_ids
from .text import (
    Index,
    Lines,
    Mask,
    Parsed,
    cut_lines,
    decimals,
    integers,
    is_word,
    possible_times,
    spaced_bytes,
)

LACKS = "the payload of error frames"
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
_STATE, _UNKNOWN = -1, -2
"""Kinds of lines: on the state of the bus or an event, and unreadable ones."""
_OVERRUN = re.compile(
    rb"overrun|(?: [0-9a-f]{2}){3} (?:[0-9a-f][2367abef]|[4-7c-f][0-9a-f])\b", re.IGNORECASE
)
"""State of the bus in which frames were lost."""
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
        """Return the frames of complete lines; lines on the state of the bus are no frames."""
        lines = cut_lines(block)
        comment = lines.text[lines.start[lines.first]] == ord(";")
        header = self._header(lines, np.flatnonzero(comment))
        rows = np.flatnonzero(~comment & (lines.count >= 3))
        kind = self._kinds(lines, rows)
        flags = np.where(kind >= 0, kind, 0).astype(np.uint16)
        is_error = flags & FrameFlag.ERROR != 0
        is_frame = (kind >= 0) & ~is_error & (lines.count[rows] >= self._columns.index("D"))
        frames, torn = self._frames(lines, rows[is_frame], flags[is_frame])
        errors, wrong = self._errors(lines, rows[is_error])
        other = (kind != _STATE) & ~is_frame & ~is_error
        bad = [lines.number[~comment & (lines.count < 3)], lines.number[rows[other]], torn, wrong]
        state = rows[kind == _STATE].tolist()
        lost = [int(lines.number[row]) for row in state if _OVERRUN.search(lines.line(row))]
        if len(errors):
            places = [rows[is_frame][~np.isin(lines.number[rows[is_frame]], torn)]]
            places.append(rows[is_error][~np.isin(lines.number[rows[is_error]], wrong)])
            frames = interleaved([frames, errors], places)
        dropped = tuple((number, 1) for number in lost)
        return Parsed(frames, np.sort(np.concatenate(bad)), header, dropped)

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

    def _kinds(self, lines: Lines, rows: Index) -> NDArray[np.int64]:
        """Return the flags that the type of each row states; below 0 if it is not a frame."""
        if "T" not in self._columns:  # 2) 1842 0008 4 ERROR 00 19 08 08
            start, end = lines.token(self._columns.index("I"), rows)
            can_id, _ = integers(lines.text, start, end, 16, longest=8)
            error = is_word(lines, *lines.token_or_none(self._columns.index("D"), rows), b"error")
            kind = np.where(error, int(FrameFlag.ERROR), 0)
            return np.where(can_id == _NOT_A_FRAME, _STATE, kind)
        place = lines.token(self._columns.index("T"), rows)
        kinds = np.full(len(rows), _UNKNOWN)
        for word, flags in (_TYPES_2 if self._version >= "2" else _TYPES_1).items():
            kinds[is_word(lines, *place, word)] = flags
        return kinds

    def _errors(self, lines: Lines, rows: Index) -> tuple[FrameBatch, Index]:
        """Return the error frames of rows, without their payload, and the numbers of bad lines."""
        t_ns, good = self._times(lines, rows)
        nothing = np.zeros(len(rows), np.int64)
        flags = np.full(len(rows), FrameFlag.ERROR, np.uint16)
        data = np.zeros((len(rows), 8), np.uint8)
        bus = self._buses(lines, rows)
        frames = good_frames(good, t_ns, nothing, flags, bus, nothing, data)
        return frames, lines.number[rows[~good]]

    def _times(self, lines: Lines, rows: Index) -> tuple[NDArray[np.int64], Mask]:
        offset_ns, good = decimals(
            lines.text, *lines.token(self._columns.index("O"), rows), 6, b".,"
        )
        good &= possible_times(offset_ns, self._start_ns)
        return self._start_ns + np.where(good, offset_ns, 0), good

    def _buses(self, lines: Lines, rows: Index) -> NDArray[np.int64]:
        """Return buses from 0; PEAK counts from 1, and writes a dash if there is no number."""
        if "B" not in self._columns:
            return np.zeros(len(rows), np.int64)
        place = lines.token_or_none(self._columns.index("B"), rows)
        number, is_number = integers(lines.text, *place, 10, longest=3)
        return np.where(is_number, np.clip(number - 1, 0, 255), 0)

    def _frames(
        self, lines: Lines, rows: Index, flags: NDArray[np.uint16]
    ) -> tuple[FrameBatch, Index]:
        """Return the frames of rows, and the numbers of incomplete lines."""
        columns = self._columns
        t_ns, good = self._times(lines, rows)
        start, end = lines.token(columns.index("I"), rows)
        can_id, has_id = integers(lines.text, start, end, 16, longest=8)
        extended = end - start > 4
        good &= has_id & possible_ids(can_id, extended)
        flags = flags | extended * np.uint16(FrameFlag.EXTENDED)
        if "d" in columns:
            sent = is_word(lines, *lines.token(columns.index("d"), rows), b"tx")
            flags |= sent * np.uint16(FrameFlag.TRANSMITTED)
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
        bus = self._buses(lines, rows)
        return good_frames(good, t_ns, can_id, flags, bus, length, data), lines.number[rows[~good]]


_TYPES_1 = {
    b"rx": 0,
    b"tx": int(FrameFlag.TRANSMITTED),
    b"error": int(FrameFlag.ERROR),
    b"warng": _STATE,
    b"event": _STATE,
}
_TYPES_2 = {
    b"dt": 0,
    b"rr": int(FrameFlag.REMOTE),
    b"er": int(FrameFlag.ERROR),
    b"st": _STATE,
    b"ec": _STATE,
    b"ev": _STATE,
    b"fd": int(FrameFlag.FD),
    b"fb": int(FrameFlag.FD | FrameFlag.BITRATE_SWITCH),
    b"fe": int(FrameFlag.FD | FrameFlag.BITRATE_SWITCH | FrameFlag.ERROR_STATE),
    b"bi": int(FrameFlag.FD | FrameFlag.ERROR_STATE),
}


def _days_ns(text: str) -> int:
    """Return days since 1899-12-30 as ns since 1970; 0 if the text is not a number."""
    try:
        ns = int((Decimal(text.replace(",", ".")) - _EPOCH_DAYS) * 86_400_000_000_000)
    except (InvalidOperation, OverflowError, ValueError):
        return 0
    return ns if 0 <= ns < 1 << 62 else 0
