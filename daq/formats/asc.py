"""Reads Vector's ASC: one event per line, times counted from a date in the header.

0.004000 1  18DA00F1x   Rx   d 8 01 02 03 04 05 06 07 08
0.005000 CANFD   1 Rx   123   Name   1 0 9 12 01 02 ... 0C  130 1000 303000 ...
0.006000 1  ErrorFrame
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime
from functools import lru_cache
from itertools import takewhile

from .reader import BITS, LENGTH_OF_CODE, LONGEST_NS, Record, nanoseconds, number, spaced_bytes

_HEAD = re.compile(
    rb"//|date\s|base\s|(no )?internal events|begin\s+triggerblock|end\s+triggerblock|"
    rb"start of measurement|previous log file|next log file|comment|pid\b|measurement\s*uuid",
    re.IGNORECASE,
)
"""Beginnings of the lines without a time."""
_EVENT = re.compile(
    rb"\d{1,3}\s+(statistic:|j1939tp|overloadframe|tcp|transceiver)|canfd\s+\d+\s+statistic:|"
    rb"can\s+\d+\s+(status|overload)|start of measurement|(begin|end)\s+triggerblock|"
    rb"(log|sv|gps|tfs|tfr|comment|global\s?marker|test\w*|diag\w*|trigger|user event)\b|"
    rb"(li|lin|l|fr|f|most|mst|eth|ethernet|a429|afdx|kl|wlan)\d*\s|\S+\s+:=",
    re.IGNORECASE,
)
"""Lines with a time that are no frame of a CAN bus: statistics, events, variables, other buses."""
_DIRECTIONS = {b"rx": 0, b"tx": BITS.TRANSMITTED}
_CLASSIC = (b"d", b"D", b"r", b"R")


class AscParser:
    """Parses an ASC log line by line; remembers its header and, for relative times, the last."""

    states_length = spaced = True

    def __init__(self) -> None:
        self.has_header = False
        self._base = 16
        self._is_relative = False
        self._start_ns = 0
        self._last_ns = 0

    def __call__(self, line: bytes) -> Record | int:
        """Return the frame in a line; 0 for the header, and events of other known kinds."""
        # Fields of the short form: bus, identifier, direction, d or r, DLC, payload.
        time, *fields = line.split(None, 6)
        try:
            t_ns = nanoseconds(time)
        except ValueError:
            return self._read_header(line.strip())
        if self._start_ns and t_ns >= LONGEST_NS:  # a date, and not the time since one
            raise ValueError(line)
        if self._is_relative:
            t_ns = self._last_ns = self._last_ns + t_ns
        t_ns += self._start_ns
        kind = fields[0]
        if kind.isdigit() and len(kind) <= 3:
            if fields[1].lower() == b"errorframe":
                return t_ns, 0, BITS.ERROR, _bus(kind), 0, b""
            if len(fields) >= 4 and fields[2].lower() in _DIRECTIONS and fields[3] in _CLASSIC:
                return self._classic(fields, t_ns)
        elif kind.lower() == b"canfd" and len(fields) >= 4 and fields[2].lower() in _DIRECTIONS:
            return self._long(line.split(), t_ns)
        if not _EVENT.match(line.split(None, 1)[1]):
            raise ValueError(line)
        return 0

    def _read_header(self, raw: bytes) -> int:
        """Return 0 for a line without a time, and keep what it states; ValueError if it is none."""
        line = raw.decode("utf-8" if b"\xc3" in raw else "cp1252", "replace")
        stated = line.lower()
        if base := re.match(r"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", stated):
            self._base = 10 if base[1] == "dec" else 16
            self._is_relative = base[2] == "relative"
            self.has_header = True
        elif re.match(r"(?:date|begin\s+triggerblock)\s", stated):
            self.has_header = True
            if (date_ns := asc_date_ns(line)) is not None:
                self._start_ns, self._last_ns = date_ns, 0
        elif not _HEAD.match(raw):
            raise ValueError(line)
        return 0

    def _classic(self, fields: Sequence[bytes], t_ns: int) -> Record:
        """Return the frame of the short form, data or remote."""
        channel, identifier, direction, kind, *dlc_and_payload = fields
        can_id, flags = _identifier(identifier, self._base)
        flags |= _DIRECTIONS[direction.lower()]
        bus = _bus(channel)
        dlc_text, text = [*dlc_and_payload, b"", b""][:2]
        if kind in b"rR":  # before version 8.5 a remote frame had no DLC
            request = dlc_text if 0 < len(dlc_text) < 3 else b"0"
            return t_ns, can_id, flags | BITS.REMOTE, bus, min(number(request, self._base), 8), b""
        dlc = number(dlc_text, self._base)
        length = min(dlc, 8)
        if dlc > 8:
            # A DLC of 9 to 15 means 8 bytes.  Some loggers write FD frames in this form, with a
            # length; others with a DLC in decimal, whatever the base.
            pattern = rb"[0-9A-Fa-f]{1,2}" if self._base == 16 else rb"\d{1,3}"
            n_bytes = len(list(takewhile(lambda t: re.fullmatch(pattern, t), text.split())))
            decimal_dlc = int(dlc_text) if dlc_text.isdigit() else 99  # 99: it is none
            fits = decimal_dlc < len(LENGTH_OF_CODE) and n_bytes == LENGTH_OF_CODE[decimal_dlc]
            if fits or dlc in LENGTH_OF_CODE[10:]:
                length, flags = LENGTH_OF_CODE[decimal_dlc] if fits else dlc, flags | BITS.FD
            elif dlc > 15:
                raise ValueError(fields)
        return t_ns, can_id, flags, bus, length, spaced_bytes(text, length, self._base)

    def _long(self, tokens: Sequence[bytes], t_ns: int) -> Record:
        """Return the frame of the long form: FD, sometimes also classic and error frames."""
        bus, direction = _bus(tokens[2]), _DIRECTIONS[tokens[3].lower()]
        if tokens[4].lower() == b"errorframe":
            return t_ns, 0, BITS.ERROR | direction, bus, 0, b""
        can_id, flags = _identifier(tokens[4], self._base)
        # There may be a symbolic name between the identifier and the bits BRS and ESI.
        first = 5 if len(tokens[5]) == 1 and tokens[5].isdigit() else 6
        brs, esi = number(tokens[first], 2), number(tokens[first + 1], 2)
        dlc, length = number(tokens[first + 2], 16), number(tokens[first + 3], 10)
        after_header, after_payload = tokens[first + 4 :], tokens[first + 4 + length :]
        data = spaced_bytes(b" ".join(after_header), length, self._base)
        # After the payload: duration, bits on the wire, flags.  Bit 12 is FDF: without it, the
        # frame is a classic one in the long form, and bit 4 marks a remote frame.  Some loggers
        # never set bit 12; such a frame is FD if it has properties that only FD has.
        bits = number(after_payload[2], 16) if len(after_payload) > 2 else 0x1000
        flags |= direction
        if bits & 0x1010 == 0x10 and not length:
            return t_ns, can_id, flags | BITS.REMOTE, bus, min(dlc, 8), b""
        if bits & 0x1000 or length > 8 or brs or esi:
            flags |= BITS.FD | BITS.BITRATE_SWITCH * brs | BITS.ERROR_STATE * esi
        return t_ns, can_id, flags, bus, length, data


@lru_cache(4096)
def _identifier(text: bytes, base: int) -> tuple[int, int]:
    """Return an identifier and its flags; a final x marks 29 bits."""
    if text[-1:] in b"xX":
        return number(text[:-1], base), BITS.EXTENDED
    return number(text, base), 0


@lru_cache(256)
def _bus(channel: bytes) -> int:
    """Return a bus from 0; Vector counts from 1."""
    return min(max(number(channel, 10) - 1, 0), 255)


_NAMES = "jan feb mar/mär apr may/mai jun jul aug sep oct/okt nov dec/dez"
_MONTHS = {
    name: month for month, names in enumerate(_NAMES.split(), start=1) for name in names.split("/")
}
_DATE = re.compile(
    r"(?P<month>[^\W\d]{3})[^\W\d]*\s+(?P<day>\d{1,2})\s+"
    r"(?P<hour>\d{1,2}):(?P<minute>\d\d):(?P<second>\d\d)(?:\.(?P<fraction>\d{1,9}))?"
    r"(?:\s+(?P<half>am|pm))?\s+(?P<year>\d{4})",
    re.IGNORECASE,
)


def asc_date_ns(line: str) -> int | None:
    """Return the date in a line as ns since 1970 UTC, None if there is none.

    The date is local time without a zone: the zone of this machine is assumed.
    """
    match = _DATE.search(line)
    if match is None:
        return None
    year, day, hour, minute, second = (
        int(match[name]) for name in ("year", "day", "hour", "minute", "second")
    )
    month = _MONTHS.get(match["month"].lower(), 0)  # 0 is no month: ValueError
    if match["half"]:
        hour = hour % 12 + (12 if match["half"].lower() == "pm" else 0)
    try:
        whole_s = round(datetime(year, month, day, hour, minute, second).timestamp())
    except (ValueError, OverflowError, OSError):
        return None
    return whole_s * 1_000_000_000 + int((match["fraction"] or "0").ljust(9, "0"))
