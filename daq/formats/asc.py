"""Reads Vector's ASC: one event per line, times counted from a date in the header.

0.004000 1  18DA00F1x   Rx   d 8 01 02 03 04 05 06 07 08
0.005000 CANFD   1 Rx   123   Name   1 0 9 12 01 02 ... 0C  130 1000 303000 ...
0.006000 1  ErrorFrame
"""

from __future__ import annotations

import re
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FD_LENGTHS, FrameBatch

from .assemble import flags_of, good_frames, interleaved, possible_ids
from .text import (
    Index,
    Lines,
    Mask,
    Parsed,
    character,
    cut_lines,
    decimals,
    integers,
    is_word,
    possible_times,
    spaced_bytes,
)

LACKS = "the payload of error frames"
_BASE = re.compile(r"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
_START = re.compile(r"(?:date|begin\s+triggerblock)\s", re.IGNORECASE)


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


class AscParser:
    """Parses an ASC log block by block; remembers its header and its last line."""

    def __init__(self) -> None:
        self._base = 16
        self._relative = False
        self._start_ns = 0
        self._last_ns = 0

    def __call__(self, block: bytes) -> Parsed:
        """Return the frames of complete lines; events of other known kinds are no frames."""
        lines = cut_lines(block)
        stamp_ns, timed = decimals(lines.text, *lines.token(0, np.arange(len(lines.first))), 9)
        timed &= lines.count > 1
        starts, header, unknown = self._header(lines, np.flatnonzero(~timed))
        possible = timed & possible_times(stamp_ns, starts)
        if self._relative:
            stamp_ns = self._last_ns + np.cumsum(np.where(possible, stamp_ns, 0))
            self._last_ns = int(stamp_ns[-1]) if len(stamp_ns) else self._last_ns
        t_ns = np.where(possible, stamp_ns, 0) + starts

        events = np.flatnonzero(possible)
        found = [form(lines, events, t_ns, self._base) for form in (_classic, _fd, _error)]
        frames = interleaved([frames for _, frames in found], [rows for rows, _ in found])
        others = timed.copy()
        for rows, _ in found:
            others[rows] = False
        for row in np.flatnonzero(others).tolist():
            if not (possible[row] and _EVENT.match(lines.line(row).split(None, 1)[1])):
                unknown.append(row)
        return Parsed(frames, np.sort(lines.number[unknown]), header)

    def _header(self, lines: Lines, rows: Index) -> tuple[NDArray[np.int64], bool, list[int]]:
        """Process the lines without a time; return the start of time of each line.

        Also returns whether there is a head, and the lines that are not known.
        """
        start_ns = np.full(len(lines.first), self._start_ns)
        header, unknown = False, []
        for row in rows.tolist():
            raw = lines.line(row)
            if not _HEAD.match(raw):
                unknown.append(row)
            if raw[:1].lower() not in b"db":
                continue
            line = raw.decode("utf-8" if b"\xc3" in raw else "cp1252", "replace")
            if base := _BASE.match(line):
                self._base = 10 if base[1].lower() == "dec" else 16
                self._relative = (base[2] or "").lower() == "relative"
                header = True
            elif _START.match(line):
                header = True
                if (date_ns := asc_date_ns(line)) is not None:
                    self._start_ns, self._last_ns = date_ns, 0
                    start_ns[row:] = date_ns
        return start_ns, header, unknown


_Found = tuple[Index, FrameBatch]
"""Rows that are frames of one form, and these frames."""


def _classic(lines: Lines, rows: Index, t_ns: NDArray[np.int64], base: int) -> _Found:
    """Return the classic frames, data and remote."""
    rows = rows[lines.count[rows] >= 5]
    bus, is_bus = integers(lines.text, *lines.token(1, rows), 10, longest=3)
    kind, kind_end = lines.token(4, rows)
    letter = np.where(kind_end - kind == 1, character(lines, kind), 0)
    direction = lines.token(3, rows)
    sent = is_word(lines, *direction, b"tx")
    matching = is_bus & ((letter == ord("d")) | (letter == ord("r")))
    matching &= sent | is_word(lines, *direction, b"rx")
    if not matching.all():
        rows, bus, letter, sent = rows[matching], bus[matching], letter[matching], sent[matching]

    remote = letter == ord("r")
    can_id, extended, good = _identifiers(lines, rows, 2, base)
    dlc, has_dlc = integers(lines.text, *lines.token_or_none(5, rows), base, longest=2)
    good &= remote | has_dlc  # before version 8.5 a remote frame had no DLC
    dlc = np.where(has_dlc, dlc, 0)
    # A DLC of 9 to 15 means 8 bytes.  Some loggers write FD frames in this form, with a length;
    # others with a DLC in decimal, whatever the base.
    coded = _coded_length(lines, rows, np.flatnonzero(~remote & has_dlc & (dlc > 8)), base)
    fd = ~remote & (np.isin(dlc, FD_LENGTHS[10:]) | (coded > 0))
    good &= (dlc < 16) | fd
    length = np.where(coded > 0, coded, np.where(fd, dlc, np.minimum(dlc, 8)))
    size = np.where(remote, 0, length)
    good &= lines.count[rows] >= 6 * ~remote + size
    size = np.where(good, size, 0)
    data, whole = spaced_bytes(lines, lines.first[rows] + 6, size, base)
    flags = flags_of(len(rows), extended=extended, remote=remote, fd=fd, sent=sent)
    good &= whole
    frames = good_frames(good, t_ns[rows], can_id, flags, _bus(bus), length, data)
    return rows[good], frames


def _coded_length(lines: Lines, rows: Index, places: Index, base: int) -> Index:
    """Return the length of each of `rows`, at `places`, with a DLC of FD; 0 for the others.

    A DLC is one of FD if exactly as many bytes follow as it means.
    """
    length = np.zeros(len(rows), np.intp)
    rows = rows[places]
    code, good = integers(lines.text, *lines.token_or_none(5, rows), 10, longest=2)
    size = FD_LENGTHS[np.clip(code, 0, 15)].astype(np.intp)
    good &= (code < 16) & (lines.count[rows] >= 6 + size)
    size = np.where(good, size, 0)
    _, more = integers(lines.text, *lines.token_or_none(6 + size, rows), base, longest=2)
    _, whole = spaced_bytes(lines, lines.first[rows] + 6, size, base)
    length[places] = np.where(good & whole & ~more, size, 0)
    return length


def _fd(lines: Lines, rows: Index, t_ns: NDArray[np.int64], base: int) -> _Found:
    """Return the frames of the long form: FD frames, sometimes also classic and error frames."""
    rows = rows[lines.count[rows] >= 5]
    rows = rows[is_word(lines, *lines.token(1, rows), b"canfd")]
    direction = lines.token(3, rows)
    sent = is_word(lines, *direction, b"tx")
    rows = rows[sent | is_word(lines, *direction, b"rx")]
    sent = is_word(lines, *lines.token(3, rows), b"tx")
    bus, good = integers(lines.text, *lines.token(2, rows), 10, longest=3)
    error = is_word(lines, *lines.token(4, rows), b"errorframe")
    can_id, extended, has_id = _identifiers(lines, rows, 4, base)
    # There may be a symbolic name between the identifier and the bits BRS and ESI.
    _, unnamed = integers(lines.text, *lines.token_or_none(5, rows), 10, longest=1)
    at = np.where(unnamed, 5, 6)
    brs, has_brs = integers(lines.text, *lines.token_or_none(at, rows), 2, longest=1)
    esi, has_esi = integers(lines.text, *lines.token_or_none(at + 1, rows), 2, longest=1)
    dlc, has_dlc = integers(lines.text, *lines.token_or_none(at + 2, rows), 16, longest=2)
    length, has_length = integers(lines.text, *lines.token_or_none(at + 3, rows), 10, longest=2)
    good &= error | (has_id & has_brs & has_esi & has_dlc & has_length & (length <= 64))
    size = np.where(good & ~error, length, 0)
    good &= error | (lines.count[rows] >= at + 4 + size)
    size = np.where(good, size, 0)
    data, whole = spaced_bytes(lines, lines.first[rows] + at + 4, size, base)
    # After the payload: duration, bits on the wire, flags.  Bit 12 is FDF: without it, the frame is
    # a classic one in the long form, and bit 4 marks a remote frame.  Some loggers never set bit
    # 12; such a frame is FD if it has properties that only FD has.
    bits, has_bits = integers(lines.text, *lines.token_or_none(at + 6 + size, rows), 16)
    fdf = ~has_bits | (bits & 0x1000 != 0)
    remote = ~error & ~fdf & (bits & 0x10 != 0) & (length == 0)
    fd = ~error & ~remote & (fdf | (length > 8) | (brs == 1) | (esi == 1))
    asked = np.minimum(dlc, 8)
    good &= error | fd | (length <= 8)
    flags = flags_of(
        len(rows),
        extended=extended & ~error,
        remote=remote,
        error=error,
        fd=fd,
        bitrate_switch=fd & (brs == 1),
        error_state=fd & (esi == 1),
        sent=sent,
    )
    length, can_id = np.where(remote, asked, size), np.where(error, 0, can_id)
    good &= whole
    frames = good_frames(good, t_ns[rows], can_id, flags, _bus(bus), length, data)
    return rows[good], frames


def _error(lines: Lines, rows: Index, t_ns: NDArray[np.int64], _: int) -> _Found:
    """Return the error frames of the short form, which have no payload."""
    rows = rows[lines.count[rows] >= 3]
    bus, is_bus = integers(lines.text, *lines.token(1, rows), 10, longest=3)
    matching = is_bus & is_word(lines, *lines.token(2, rows), b"errorframe")
    rows, bus = rows[matching], bus[matching]
    n = len(rows)
    flags, nothing = flags_of(n, error=True), np.zeros(n, np.int64)
    data, good = np.zeros((n, 8), np.uint8), np.ones(n, bool)
    frames = good_frames(good, t_ns[rows], nothing, flags, _bus(bus), nothing, data)
    return rows, frames


def _identifiers(
    lines: Lines, rows: Index, place: int, base: int
) -> tuple[NDArray[np.int64], Mask, Mask]:
    """Return identifiers, a mask of extended ones (with a final x), and a mask of valid ones."""
    start, end = lines.token(place, rows)
    extended = character(lines, end - 1) == ord("x")
    can_id, good = integers(lines.text, start, end - extended, base, longest=9)
    good &= possible_ids(can_id, extended)
    return np.where(good, can_id, 0), extended, good


def _bus(channel: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return channel numbers from 0; Vector counts from 1."""
    return np.clip(channel - 1, 0, 255)


_NAMES = "jan feb mar/mär apr may/mai jun jul aug sep oct/okt nov dec/dez"
_MONTHS = {
    name: number
    for number, names in enumerate(_NAMES.split(), start=1)
    for name in names.split("/")
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
    found = _DATE.search(line)
    if found is None or found["month"].lower() not in _MONTHS:
        return None
    hour = int(found["hour"])
    if found["half"]:
        hour = hour % 12 + (12 if found["half"].lower() == "pm" else 0)
    try:
        date = datetime(
            int(found["year"]),
            _MONTHS[found["month"].lower()],
            int(found["day"]),
            hour,
            int(found["minute"]),
            int(found["second"]),
        )
        whole_s = round(date.timestamp())
    except (ValueError, OverflowError, OSError):
        return None
    return whole_s * 1_000_000_000 + int((found["fraction"] or "0").ljust(9, "0"))
