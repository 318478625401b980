"""Reads the text logs of candump, of PEAK (TRC), and of python-can (CSV)."""

from __future__ import annotations

import re
from binascii import a2b_base64, unhexlify
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from functools import lru_cache

from .reader import BITS, LENGTH_OF_CODE, LONGEST_NS, Record, nanoseconds, number, spaced_bytes

# candump -l, -L: (1700000000.000000) can0 123#DEADBEEF R ------------------------------------------

_FRAME = re.compile(
    rb"\s*\(([-\d.]+)\)\s+(\S+)\s+([0-9A-Fa-f]{1,8})#(#[0-9A-Fa-f])?"
    rb"(?:([Rr]\d?)|([0-9A-Fa-f]*)(?:_[0-9A-Fa-f])?)(?:\s+(\S).*)?\s*$"
)
"""Time, interface, identifier, FD bits (``##1``: BRS, ``##2``: ESI), request or payload,
direction.  A classic frame of 8 bytes may be followed by the raw DLC of the wire: ``123#..._E``."""
_ERROR_BIT = 0x2000_0000


class CandumpParser:
    """Parses a candump log line by line."""

    has_header = states_length = spaced = False

    def __call__(self, line: bytes) -> Record | int:
        """Return the frame in a line, or the number of frames that it states as lost."""
        match = _FRAME.match(line)
        if match is None:  # candump states the frames that its socket lost
            lost = re.search(rb"DROPCOUNT: dropped (\d{1,9}) CAN frames?", line)
            if lost is None:
                raise ValueError(line)
            return int(lost[1])
        time, interface, identifier, fd, request, digits, direction = match.groups()
        can_id, flags = _identifier(identifier)
        flags |= BITS.TRANSMITTED if direction in (b"T", b"t") else 0
        t_ns, bus = nanoseconds(time), _bus(interface)
        if request:
            return t_ns, can_id, flags | BITS.REMOTE, bus, int(request[1:] or b"0"), b""
        if fd:
            bits = int(fd[1:], 16)
            flags |= BITS.FD | BITS.BITRATE_SWITCH * (bits & 1) | BITS.ERROR_STATE * (bits >> 1 & 1)
        return t_ns, can_id, flags, bus, len(digits) // 2, unhexlify(digits)


@lru_cache(4096)
def _identifier(text: bytes) -> tuple[int, int]:
    """Return an identifier and its flags; more than three digits mark 29 bits."""
    word = number(text, 16)
    if word & _ERROR_BIT:
        return word & ~_ERROR_BIT, BITS.ERROR
    return word, BITS.EXTENDED if len(text) > 3 else 0


@lru_cache(256)
def _bus(interface: bytes) -> int:
    """Return the last digits of an interface's name that are a bus: 1 for vcan1, 0 for none."""
    digits = re.search(rb"\d{0,3}$", interface)
    value = int(digits[0] or b"0") if digits else 0
    return value if value < 256 else value % 100


# python-can: timestamp,arbitration_id,extended,remote,error,dlc,data (base64) ---------------------


class CsvParser:
    """Parses CSV of python-can line by line; every line except the header is a frame."""

    states_length, spaced = True, False

    def __init__(self) -> None:
        self.has_header = False

    def __call__(self, line: bytes) -> Record | int:
        """Return the frame in a line; 0 for the header."""
        if not self.has_header and line.startswith(b"timestamp,arbitration_id,"):
            self.has_header = True
            return 0
        cells = line.rstrip().split(b",")
        if len(cells) == 6:  # a frame without data
            cells.append(b"")
        time, identifier, *digits, dlc, data = cells
        extended, remote, error = ({b"0": False, b"1": True}[digit] for digit in digits)
        length = number(dlc, 10)
        n_letters = 0 if remote else (length + 2) // 3 * 4  # base64: 4 for up to 3 bytes
        if identifier[:2] != b"0x" or len(data) != n_letters:
            raise ValueError(line)
        flags = BITS.EXTENDED * extended | BITS.REMOTE * remote | BITS.ERROR * error
        flags |= BITS.FD if length > 8 else 0  # not stated, but no classic frame is longer
        payload = a2b_base64(data, strict_mode=True) if data else b""
        # Python writes small numbers with an exponent.
        t_ns = round(float(time) * 1e9) if b"e" in time else nanoseconds(time)
        return t_ns, number(identifier[2:], 16), flags, 0, length, payload


# PEAK's TRC, versions 1.0 to 2.1: one event per line, times in ms from a start time ---------------

_COLUMNS = {
    "1.0": "NOILD",
    "1.1": "NOTILD",
    "1.2": "NOBTILD",
    "1.3": "NOBTIRLD",
    "2.0": "NOTIdlD",
    "2.1": "NOTBIdRLD",
}
"""Columns of each version, by the words of the header of version 2: N number, O time offset, B bus,
T type, I identifier, d direction, R reserved, l length in bytes, L data length code, D data."""
_OVERRUN = re.compile(
    rb"overrun|(?: [0-9a-f]{2}){3} (?:[0-9a-f][2367abef]|[4-7c-f][0-9a-f])\b", re.IGNORECASE
)
"""Line on lost frames: the last of 4 bytes has bit 1 or 6 (OVERRUN, QOVERRUN of PCANBasic.h)."""
_TYPES_1 = {b"rx": 0, b"tx": BITS.TRANSMITTED, b"error": BITS.ERROR, b"warng": None, b"event": None}
_TYPES_2 = {
    b"dt": 0,
    b"rr": BITS.REMOTE,
    b"er": BITS.ERROR,
    b"st": None,
    b"ec": None,
    b"ev": None,
    b"fd": BITS.FD,
    b"fb": BITS.FD | BITS.BITRATE_SWITCH,
    b"fe": BITS.FD | BITS.BITRATE_SWITCH | BITS.ERROR_STATE,
    b"bi": BITS.FD | BITS.ERROR_STATE,
}
"""Flags of a frame by the type of its line; None for the state of the bus or an event."""


class TrcParser:
    """Parses a TRC log line by line; its header's local time is read as UTC, as in python-can."""

    states_length = spaced = True

    def __init__(self) -> None:
        self.has_header = False
        self._start_ns = 0
        self._set_columns("1.0", _COLUMNS["1.0"])

    def __call__(self, line: bytes) -> Record | int:
        """Return the frame in a line; else 1 if the line states an overrun, 0 if it does not."""
        if line.lstrip().startswith(b";"):
            self._read_header(line.strip())
            return 0
        column = self._column
        tokens = line.split(None, column["D"])
        data_text = tokens[column["D"]] if len(tokens) > column["D"] else b""
        data_word = data_text[:5].lower()  # version 1.0 has words in place of data
        if "T" in column:
            types = _TYPES_2 if self._is_version_2 else _TYPES_1
            flags = types[tokens[column["T"]].lower()]
        elif tokens[column["I"]].upper() == b"FFFFFFFF":  # a line about the bus
            flags = None
        else:  # 2) 1842 0008 4 ERROR 00 19 08 08
            flags = BITS.ERROR if data_word == b"error" else 0
        if flags is None:
            return int(bool(_OVERRUN.search(line)))
        # The text is in ms, of which `nanoseconds` makes 1000 times the ns.
        offset_ns = nanoseconds(tokens[column["O"]].replace(b",", b".")) // 1000
        if self._start_ns and abs(offset_ns) >= LONGEST_NS:
            raise ValueError(line)
        t_ns, bus = self._start_ns + offset_ns, 0
        if "B" in column and tokens[column["B"]].isdigit():  # PEAK writes a dash if there is none
            bus = min(max(number(tokens[column["B"]], 10) - 1, 0), 255)
        if flags & BITS.ERROR:
            return t_ns, 0, BITS.ERROR, bus, 0, b""
        identifier = tokens[column["I"]]
        flags |= BITS.EXTENDED if len(identifier) > 4 else 0
        flags |= BITS.REMOTE if data_word.startswith(b"rtr") else 0
        flags |= BITS.TRANSMITTED if "d" in column and tokens[column["d"]].lower() == b"tx" else 0
        length = number(tokens[column["l" if "l" in column else "L"]], 10)
        if "l" not in column and self._is_version_2:
            if flags & BITS.FD:
                length = LENGTH_OF_CODE[length]
            elif length < 16:  # a code of 9 to 15 means 8 bytes
                length = min(length, 8)
        data = b"" if flags & BITS.REMOTE else spaced_bytes(data_text, length, 16)
        return t_ns, number(identifier, 16), flags, bus, length, data

    def _read_header(self, line: bytes) -> None:
        """Keep the version, start time or columns that a line of the header states."""
        name, _, value = (word.strip() for word in line.decode("ascii", "replace").partition("="))
        if name == ";$FILEVERSION":
            self.has_header = True
            if value in _COLUMNS:
                self._set_columns(value, _COLUMNS[value])
        elif name == ";$STARTTIME":
            with suppress(InvalidOperation, OverflowError, ValueError):
                days = Decimal(value.replace(",", ".")) - 25_569  # from 1899-12-30 to 1970
                ns = int(days * 86_400_000_000_000)
                self._start_ns = ns if 0 <= ns < 1 << 62 else 0
        elif name == ";$COLUMNS":
            letters = value.replace(",", "")
            if len(set(letters)) == len(letters) and {*"OTID"} <= {*letters} <= {*"NOTBIdRlLD"}:
                self._set_columns("2.1", letters)

    def _set_columns(self, version: str, letters: str) -> None:
        """Set what a line holds; `letters`: its columns, as in `_COLUMNS`."""
        self._is_version_2 = version >= "2"
        self._column = {letter: i for i, letter in enumerate(letters)}
