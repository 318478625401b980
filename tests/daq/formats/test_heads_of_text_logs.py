"""Lines of a text log that govern later lines: heads, dates, and times that add up."""

from __future__ import annotations

import io
from datetime import datetime

import pytest

from daq.errors import InputError
from daq.formats.asc import AscParser, asc_date_ns
from daq.formats.candump import CandumpParser
from daq.formats.source import LogLoss
from daq.formats.text import LineParser, parsed, read_lines
from daq.formats.trc import TrcParser

from .shown import shown

S = 1_000_000_000


def _seconds(parser: LineParser, *blocks: str) -> list[float]:
    """Return the times of the frames of blocks, s."""
    return [
        int(frame.split()[0]) / S
        for block in blocks
        for frame in shown(parsed(block.encode(), parser).frames)
    ]


def _local(*date: int) -> float:
    """Return local time, as seconds since 1970."""
    year, month, day, hour, minute, second = (*date, 0, 0, 0)[:6]
    return datetime(year, month, day, hour, minute, second).timestamp()


TRC = {
    "1.0": "1) 1.5 0123 1 0A",
    "1.1": "1) 1.5 Rx 0123 1 0A",
    "1.2": "1) 1.5 3 Rx 0123 1 0A",
    "1.3": "1) 1.5 3 Rx 0123 - 1 0A",
    "2.0": "1 1.5 DT 0123 Rx 1 0A",
    "2.1": "1 1.5 DT 3 0123 Rx - 1 0A",
}


@pytest.mark.parametrize("version", TRC)
def test_a_version_of_trc_has_its_columns(version: str) -> None:
    parser = TrcParser()
    found = parsed(f";$FILEVERSION={version}\n{TRC[version]}\n".encode(), parser)
    bus = 2 if version in ("1.2", "1.3", "2.1") else 0
    assert shown(found.frames) == [f"1500000 {bus} 123 1 0a -"]
    assert parser.has_header


COLUMNS = {
    "O,T,I,l,D": "1.5 DT 0123 1 0A",
    "T,O,I,d,R,B,L,D": "DT 1.5 0123 Rx - 1 1 0A",
    "N,O,T,B,I,d,R,l,D": "1 1.5 DT 1 0123 Rx - 1 0A",
    "N,O,T,B,I,d,R,l,L,D": "1 1.5 DT 1 0123 Rx - 1 1 0A",
    # None of these is a set of columns: those of the version stay.
    "O,O,T,I,L,D": TRC["2.1"],
    "O,T,I,L,D,Q": TRC["2.1"],
}


@pytest.mark.parametrize("columns", COLUMNS)
def test_columns_of_trc_in_another_order(columns: str) -> None:
    head = f";$FILEVERSION=2.1\n;$COLUMNS={columns}\n"
    bus = 2 if COLUMNS[columns] == TRC["2.1"] else 0
    found = shown(parsed(f"{head}{COLUMNS[columns]}\n".encode(), TrcParser()).frames)
    assert found == [f"1500000 {bus} 123 1 0a -"]


@pytest.mark.parametrize(
    ("days", "seconds"),
    [
        ("25569", 0.0),
        ("25570.5", 129_600.0),
        ("45939.25", 1_759_989_600.0),
        ("25568", 0.0),
        ("78946", 0.0),
        ("today", 0.0),
        ("NaN", 0.0),
        ("1e400", 0.0),
    ],
)
def test_a_trc_begins_at_days_since_1899(days: str, seconds: float) -> None:
    text = f";$FILEVERSION=1.1\n;$STARTTIME= {days} \n1) 500.0 Rx 0123 0\n"
    assert _seconds(TrcParser(), text) == [seconds + 0.5]


DATES = {
    "date Thu Oct 09 08:53:20.5 am 2025": (2025, 10, 9, 8, 53, 20, 500_000),
    "date Thu Oct 09 08:53:20.000001 pm 2025": (2025, 10, 9, 20, 53, 20, 1),
    "date Thu Oct 09 12:53:20 am 2025": (2025, 10, 9, 0, 53, 20),
    "date Thu Oct 09 12:53:20 PM 2025": (2025, 10, 9, 12, 53, 20),
    "date Die Mär 04 00:00:00 2025": (2025, 3, 4),
    "date Son Mai 04 00:00:00 2025": (2025, 5, 4),
    "date Sam Okt 04 00:00:00 2025": (2025, 10, 4),
    "date Don Dez 04 00:00:00 2025": (2025, 12, 4),
    "Begin Triggerblock Thu Dec 04 00:00:00 2025": (2025, 12, 4),
}


@pytest.mark.parametrize("line", DATES)
def test_dates_of_asc_are_local_time(line: str) -> None:
    whole = DATES[line]
    seconds = round(_local(*whole[:6]))
    micros = whole[6] if len(whole) > 6 else 0
    assert asc_date_ns(line) == seconds * S + micros * 1000


DATE = "date Thu Oct 09 08:53:20 2025"
BEGAN = _local(2025, 10, 9, 8, 53, 20)


def _asc(*times: float, can_id: str = "100") -> str:
    return "".join(f"{t} 1 {can_id} Rx d 1 11\n" for t in times)


def test_times_of_asc_count_from_the_date_or_from_the_line_before() -> None:
    absolute = f"{DATE}\nbase hex timestamps absolute\n"
    assert _seconds(AscParser(), absolute, _asc(1, 2), _asc(4)) == [BEGAN + t for t in (1, 2, 4)]
    relative = f"{DATE}\nbase hex timestamps relative\n"
    assert _seconds(AscParser(), relative, _asc(1, 2), _asc(4)) == [BEGAN + t for t in (1, 3, 7)]
    unsaid = f"{DATE}\nbase hex\n"
    assert _seconds(AscParser(), unsaid, _asc(1, 2)) == [BEGAN + t for t in (1, 2)]
    anew = f"{_asc(1, 2)}Begin Triggerblock Thu Oct 09 08:53:30 2025\n{_asc(1)}"
    assert _seconds(AscParser(), absolute, anew) == [BEGAN + t for t in (1, 2, 11)]


def test_events_of_other_kinds_take_their_time_in_a_relative_asc() -> None:
    text = f"{DATE}\nbase hex timestamps relative\n{_asc(1)}0.5 Start of measurement\n{_asc(1)}"
    assert _seconds(AscParser(), text) == [BEGAN + t for t in (1, 2.5)]


LINE = b"(1.5) can0 123#0102\n"


def _read(raw: bytes) -> tuple[int, LogLoss]:
    """Return the number of frames, and what was lost."""
    loss = LogLoss()
    blocks = read_lines(io.BytesIO(raw), "a.log", CandumpParser(), loss)
    return sum(len(block) for block in blocks), loss


@pytest.mark.parametrize(
    ("tail", "frames", "garbled", "cut"),
    [
        (b"", 2, 0, 0),
        (b"(2.5) can0 123#0304", 3, 0, 0),  # as long as one before
        (b"(2.5) can0 123#03", 2, 0, 17),
        (b"(2.5) can0 124#0304", 2, 0, 19),  # none before shows how long it is
        (b"(2.5) can1 123#R", 3, 0, 0),
        (b"end of log", 2, 0, 10),
        (b"   \t", 2, 0, 0),
        (b"no frame\n(2.5) can0 123#0304", 3, 1, 0),
    ],
)
def test_a_last_line_without_an_end(tail: bytes, frames: int, garbled: int, cut: int) -> None:
    found, loss = _read(LINE * 2 + tail)
    assert (found, loss.garbled, loss.bytes_cut) == (frames, garbled, cut)


def test_the_first_line_that_is_no_frame_is_named_by_its_number() -> None:
    _, loss = _read(LINE + b"\n" + LINE + b"no frame\nnor this\n")
    assert loss.garbled == 2
    assert "line 4 is not a frame: 'no frame'" in loss.text
    many = LINE * 20_000  # more than one block
    _, loss = _read(many + b"no frame\n" + LINE)
    assert "line 20001 is not a frame" in loss.text
    _, loss = _read(many + b"(2.5) can0 123#")
    assert "line 20001 has no end" in loss.text


def test_zeros_after_a_power_cut_are_counted_with_the_line_that_they_cut() -> None:
    with pytest.raises(InputError, match="no line of a known log"):
        _read(b"nothing\n" + b"to see\n")
    for raw, frames, garbled, cut in (
        (LINE * 20_000 + bytes(100), 20_000, 0, 100),
        (LINE + bytes(100_000) + LINE, 2, 0, 100_000),
        (bytes(7) + LINE, 1, 0, 7),
        (LINE + b"(2.5) can0 123#01" + bytes(30) + LINE, 2, 1, 30),
        (LINE * 12_000 + b"(2.5) can0 1" + bytes(600_000) + LINE, 12_001, 1, 600_000),
    ):
        found, loss = _read(raw)
        assert (found, loss.garbled, loss.bytes_cut) == (frames, garbled, cut)


def test_a_line_without_an_end_is_no_text_log() -> None:
    assert _read(LINE + b"(" + b"1" * 65_535)[1].bytes_cut == 65_536
    with pytest.raises(InputError, match="not a text log"):
        _read(LINE + b"(" + b"1" * 65_536)
