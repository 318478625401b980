"""Reads PEAK's TRC, versions 1.0 to 2.1: one event per line, times in ms from a start time."""

from __future__ import annotations

import re
from contextlib import suppress
from decimal import Decimal, InvalidOperation

from dbc.frames import FD_LENGTHS

from .reader import (
    BITRATE_SWITCH,
    ERROR,
    ERROR_STATE,
    EXTENDED,
    FD,
    LONGEST_NS,
    REMOTE,
    SENT,
    Record,
    nanoseconds,
    number,
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
_OVERRUN = re.compile(
    rb"overrun|(?: [0-9a-f]{2}){3} (?:[0-9a-f][2367abef]|[4-7c-f][0-9a-f])\b", re.IGNORECASE
)
"""State of the bus in which frames were lost."""
_FD_LENGTHS: list[int] = FD_LENGTHS.tolist()
_TYPES_1 = {b"rx": 0, b"tx": SENT, b"error": ERROR, b"warng": None, b"event": None}
_TYPES_2 = {
    b"dt": 0,
    b"rr": REMOTE,
    b"er": ERROR,
    b"st": None,
    b"ec": None,
    b"ev": None,
    b"fd": FD,
    b"fb": FD | BITRATE_SWITCH,
    b"fe": FD | BITRATE_SWITCH | ERROR_STATE,
    b"bi": FD | ERROR_STATE,
}
"""Flags of a frame by the type of its line; None for the state of the bus or an event."""


class TrcParser:
    """Parses a TRC log line by line; remembers its header.

    The header states local time without a zone; as in python-can it is read as UTC.
    """

    states_length = spaced = True

    def __init__(self) -> None:
        self.has_header = False
        self._version = "1.0"
        self._start_ns = 0
        self._place = _places(_COLUMNS["1.0"])

    def __call__(self, line: bytes) -> Record | int | None:
        """Return the frame in a line; else 1 if the line states an overrun, 0 if it does not."""
        try:
            return self._parsed(line)
        except (ValueError, IndexError, KeyError):
            return None if line.strip() else 0

    def _parsed(self, line: bytes) -> Record | int:
        if line.lstrip().startswith(b";"):
            self._header(line.strip())
            return 0
        place = self._place
        tokens = line.split(None, place["D"])
        text = tokens[place["D"]] if len(tokens) > place["D"] else b""
        word = text[:5].lower()
        if "T" not in place:  # 2) 1842 0008 4 ERROR 00 19 08 08
            is_frame = tokens[place["I"]].upper() != b"FFFFFFFF"  # a line about the bus
            stated = (ERROR if word == b"error" else 0) if is_frame else None
        else:
            types = _TYPES_2 if self._version >= "2" else _TYPES_1
            stated = types[tokens[place["T"]].lower()]
        if stated is None:
            return int(bool(_OVERRUN.search(line)))
        flags = stated
        offset_ns = nanoseconds(tokens[place["O"]].replace(b",", b".")) // 1000
        if self._start_ns and abs(offset_ns) >= LONGEST_NS:
            raise ValueError(line)
        t_ns, bus = self._start_ns + offset_ns, 0
        if "B" in place and tokens[place["B"]].isdigit():  # PEAK writes a dash if there is none
            bus = min(max(number(tokens[place["B"]], 10) - 1, 0), 255)
        if flags & ERROR:
            return t_ns, 0, ERROR, bus, 0, b""
        identifier = tokens[place["I"]]
        can_id = number(identifier, 16)
        if len(identifier) > 4:
            flags |= EXTENDED
        if word.startswith(b"rtr"):
            flags |= REMOTE
        if "d" in place and tokens[place["d"]].lower() == b"tx":
            flags |= SENT
        if "l" in place:
            length = number(tokens[place["l"]], 10)
        else:
            length = number(tokens[place["L"]], 10)
            if self._version >= "2" and flags & FD:
                length = _FD_LENGTHS[length]
            elif self._version >= "2" and length < 16:  # a code of 9 to 15 means 8 bytes
                length = min(length, 8)
        data = b"" if flags & REMOTE else spaced_bytes(text, length, 16)
        return t_ns, can_id, flags, bus, length, data

    def _header(self, line: bytes) -> None:
        name, _, value = line.decode("ascii", "replace").partition("=")
        value = value.strip()
        if name == ";$FILEVERSION":
            self._version = value if value in _COLUMNS else self._version
            self._place = _places(_COLUMNS[self._version])
            self.has_header = True
        elif name == ";$STARTTIME":
            with suppress(InvalidOperation, OverflowError, ValueError):
                days = Decimal(value.replace(",", ".")) - 25_569  # from 1899-12-30 to 1970
                ns = int(days * 86_400_000_000_000)
                self._start_ns = ns if 0 <= ns < 1 << 62 else 0
        elif name == ";$COLUMNS":
            letters = value.replace(",", "")
            if len(set(letters)) == len(letters) and {*"OTID"} <= {*letters} <= {*"NOTBIdRlLD"}:
                self._place = _places(letters)


def _places(columns: str) -> dict[str, int]:
    return {letter: place for place, letter in enumerate(columns)}
