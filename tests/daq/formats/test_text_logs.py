"""Text logs: one line at a time, the heads of files, and logs that are cut anywhere."""

from __future__ import annotations

import io
from collections.abc import Callable
from datetime import datetime

import pytest

from daq.formats.asc import AscParser, asc_date_ns
from daq.formats.reader import LineParser, LogLoss, parsed, read_lines
from daq.formats.text_logs import CandumpParser, CsvParser, TrcParser
from dbc.words import InputError

from .mixed import shown

BAD = "bad"
"""The line should be a frame and is none."""
OTHER = "other"
"""The line is passed over."""

_64 = "00" * 64
_64_SPACED = "00 " * 64
_8_SPACED = "1 2 3 4 5 6 7 8"
_8 = "0102030405060708"


CANDUMP = {
    "(1.5) can0 123#": "1500000000 0 123 0 - -",
    "(1.000000001) can1 7FF#01": "1000000001 1 7FF 1 01 -",
    "(1) can1 800#01": BAD,
    "(1) can1 00000800#01": "1000000000 1 800 1 01 x",
    "(1) can1 1FFFFFFF#01": "1000000000 1 1FFFFFFF 1 01 x",
    "(1) can1 20000000#01": "1000000000 1 0 1 01 e",
    "(1) can1 40000000#01": BAD,
    "(1) can 123#01": "1000000000 0 123 1 01 -",
    "(1) can256 123#01": "1000000000 56 123 1 01 -",  # the last digits that are a bus
    f"(1) can0 123#{_8}": f"1000000000 0 123 8 {_8} -",
    f"(1) can0 123#{_8}09": BAD,
    f"(1) can0 123#{_8}_E": f"1000000000 0 123 8 {_8} -",
    f"(1) can0 123#{_8}_E T": f"1000000000 0 123 8 {_8} t",
    "(1) can0 123#0": BAD,
    "(1) can0 123#0G": BAD,
    "(1) can0 12G#01": BAD,
    "(1) can0 123#R": "1000000000 0 123 0 - r",
    "(1) can0 123#R9": BAD,
    "(1) can0 123#R8 T": "1000000000 0 123 8 0000000000000000 rt",
    "(1) can0 123#RA": BAD,
    "(1) can0 123##0": "1000000000 0 123 0 - f",
    "(1) can0 123##101": "1000000000 0 123 1 01 fb",
    "(1) can0 12345678##301 T": "1000000000 0 12345678 1 01 xfbst",
    "(1) can0 123##G01": BAD,
    f"(1) can0 123##0{_64}": f"1000000000 0 123 64 {_64} f",
    f"(1) can0 123##0{_64}00": BAD,
    "1) can0 123#01": BAD,
    "(1 can0 123#01": BAD,
    "(1.x) can0 123#01": BAD,
    "(1) can0 123#01 R T": "1000000000 0 123 1 01 -",
    "(-000000001.5) can0 123#01": "-1500000000 0 123 1 01 -",
    "(4102444799.999999999) can0 123#01": "4102444799999999999 0 123 1 01 -",
    "(4102444800.0) can0 123#01": BAD,
    "(9999999999.999999999) can0 123#01": BAD,
    "(1700000000000) can0 123#01": BAD,
}

CSV_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data\n"
CSV = {
    "1.5,0x7ff,0,0,0,1,/w==": "1500000000 0 7FF 1 ff -",
    "1.5,0x7ff,0,0,0,2,/wE=": "1500000000 0 7FF 2 ff01 -",
    "1.5,0x7ff,0,0,0,3,/wEC": "1500000000 0 7FF 3 ff0102 -",
    "1.5,0x7ff,0,0,0,4,/wECAw==": "1500000000 0 7FF 4 ff010203 -",
    "1.5,0x7ff,0,0,0,8,AQIDBAUGBwg=": f"1500000000 0 7FF 8 {_8} -",
    "1.5,0x7ff,0,0,0,2,/wEC": BAD,
    "1.5,0x7ff,0,0,0,4,/wEC": BAD,
    "1.5,0x7ff,0,0,0,3,+-+-": BAD,
    "1.5,0x800,0,0,0,1,/w==": BAD,
    "1.5,0x800,1,0,0,1,/w==": "1500000000 0 800 1 ff x",
    "1.5,0x800,0,0,1,1,/w==": "1500000000 0 800 1 ff e",
    "1.5,0x1fffffff,1,0,0,0,": "1500000000 0 1FFFFFFF 0 - x",
    "1.5,0x20000000,1,0,0,0,": BAD,
    "1.5,0x7ff,0,1,0,8,": "1500000000 0 7FF 8 0000000000000000 r",
    "1.5,0x7ff,01,0,0,0,": BAD,
    "1.5,0x7ff,2,0,0,0,": BAD,
    "1.5,0x7ff,0,0,0,65,": BAD,
    "1.5,0x7ff,0,0,0": BAD,
    "2.5e-05,0x7ff,0,0,0,0,": "25000 0 7FF 0 - -",
    "1e999,0x7ff,0,0,0,0,": BAD,
}

ASC_HEAD = "base hex  timestamps absolute\n"
_FD_TAIL = "0 0 {} 0 0 0 0"
ASC = {
    "1.5 1 7FF Rx d 2 0A FF": "1500000000 0 7FF 2 0aff -",
    "1.5 2 7FF Tx d 2 0A FF Length = 1": "1500000000 1 7FF 2 0aff t",
    "1.5 0 7FF Rx d 0": "1500000000 0 7FF 0 - -",
    "1.5 256 7FF Rx d 0": "1500000000 255 7FF 0 - -",
    "1.5 1 800 Rx d 0": BAD,
    "1.5 1 800x Rx d 0": "1500000000 0 800 0 - x",
    "1.5 1 1FFFFFFFx Rx d 0": "1500000000 0 1FFFFFFF 0 - x",
    "1.5 1 20000000x Rx d 0": BAD,
    f"1.5 1 7FF Rx d 8 {_8_SPACED}": f"1500000000 0 7FF 8 {_8} -",
    f"1.5 1 7FF Rx d 9 {_8_SPACED}": f"1500000000 0 7FF 8 {_8} -",
    f"1.5 1 7FF Rx d F {_8_SPACED}": f"1500000000 0 7FF 8 {_8} -",
    f"1.5 1 7FF Rx d 11 {_8_SPACED}": BAD,
    "1.5 1 7FF Rx d 8 1 2 3 4 5 6 7": BAD,
    "1.5 1 7FF Rx r": "1500000000 0 7FF 0 - r",
    "1.5 1 7FF Rx r 3": "1500000000 0 7FF 3 000000 r",
    "1.5 1 7FFx Tx r 8": "1500000000 0 7FF 8 0000000000000000 xrt",
    "1.5 1 7FF Rx d": BAD,
    "1.5 1 7FF Xx d 0": BAD,
    "1.5 1000 7FF Rx d 0": BAD,
    "1.5 1 ErrorFrame": "1500000000 0 0 0 - e",
    "1.5 2 errorframe Flags = 0x2": "1500000000 1 0 0 - e",
    "1.5 1": BAD,
    "1.5 CANFD 1 Rx 7FF 0 0 2 2 0A FF " + _FD_TAIL.format("1000"): "1500000000 0 7FF 2 0aff f",
    "1.5 CANFD 2 Tx 7FF 1 0 2 2 0A FF " + _FD_TAIL.format("1000"): "1500000000 1 7FF 2 0aff fbt",
    "1.5 CANFD 1 Rx 800x 0 1 2 2 0A FF " + _FD_TAIL.format("1000"): "1500000000 0 800 2 0aff xfs",
    "1.5 CANFD 1 Rx 800 0 0 2 2 0A FF " + _FD_TAIL.format("1000"): BAD,
    "1.5 CANFD 1 Rx 7FF Speed 0 0 2 2 0A FF 0 0 1000": "1500000000 0 7FF 2 0aff f",
    "1.5 CANFD 1 Rx 7FF 0 0 2 2 0A FF": "1500000000 0 7FF 2 0aff f",  # nothing behind: FD
    "1.5 CANFD 1 Rx 7FF 0 0 2 2 0A FF 0 0 0": "1500000000 0 7FF 2 0aff -",
    "1.5 CANFD 1 Rx 7FF 1 0 2 2 0A FF 0 0 0": "1500000000 0 7FF 2 0aff fb",
    "1.5 CANFD 1 Rx 7FF 0 1 2 2 0A FF 0 0 0": "1500000000 0 7FF 2 0aff fs",
    f"1.5 CANFD 1 Rx 7FF 0 0 8 8 {_8_SPACED} 0 0 0": f"1500000000 0 7FF 8 {_8} -",
    f"1.5 CANFD 1 Rx 7FF 0 0 9 9 {_8_SPACED} 9 0 0 0": f"1500000000 0 7FF 9 {_8}09 f",
    "1.5 CANFD 1 Rx 7FF 0 0 5 0 0 0 10": "1500000000 0 7FF 5 0000000000 r",
    "1.5 CANFD 1 Rx 7FF 0 0 8 0 0 0 10": "1500000000 0 7FF 8 0000000000000000 r",
    "1.5 CANFD 1 Rx 7FF 0 0 5 0 0 0 1010": "1500000000 0 7FF 0 - f",
    f"1.5 CANFD 1 Rx 7FF 0 0 F 64 {_64_SPACED} 0 0 1000": f"1500000000 0 7FF 64 {_64} f",
    f"1.5 CANFD 1 Rx 7FF 0 0 F 65 {_64_SPACED} 00 0 0 1000": BAD,
    "1.5 CANFD 1 Rx 7FF 2 0 2 2 0A FF": BAD,
    "1.5 CANFD 1 Rx 7FF 0 0 2 3 0A FF": BAD,
    "1.5 CANFD 1 Rx 7FF 00 0 2 2 0A FF": BAD,
    "1.5 CANFD 1 Rx 7FF 0 0": BAD,
    "1.5 CANFD x Rx 7FF 0 0 0 0": BAD,
    "1.5 CANFD 3 Rx ErrorFrame Not Acknowledge error": "1500000000 2 0 0 - e",
    "1.5 CANFD 1 Ux 7FF 0 0 0 0": BAD,
    "// 1.5 1 7FF Rx d 0": OTHER,
    "-0.000012 1 7FF Rx d 0": "-12000 0 7FF 0 - -",
    "4102444799 1 7FF Rx d 0": "4102444799000000000 0 7FF 0 - -",
    "4102444800 1 7FF Rx d 0": BAD,
    "1,5 1 7FF Rx d 0": BAD,
    "1.5 1 Statistic: D 0 R 0 XD 0 XR 0 E 0 O 0 B 0.00%": OTHER,
    "1.5 CAN 1 Status:chip status error active": OTHER,
    "1.5 Start of measurement": OTHER,
    "1.5 SV: 1 0 1 ::Speed = 2": OTHER,
    "1.5 Speed := 2": OTHER,
    "1.5 L1 12 Rx 2 0A FF": OTHER,
    "1.5 Garbage of some kind": BAD,
    "Garbage of some kind": BAD,
    "End TriggerBlock": OTHER,
}

_1_1 = ";$FILEVERSION=1.1\n"
_2_1 = ";$FILEVERSION=2.1\n"
TRC_1_1 = {
    "1) 1.5 Rx 0123 2 0A FF": "1500000 0 123 2 0aff -",
    "1) 1.5 Tx 00000123 0": "1500000 0 123 0 - xt",
    "1) 1.5 Rx 0800 0": BAD,
    "1) 1.5 Rx 1FFFFFFF 0": "1500000 0 1FFFFFFF 0 - x",
    "1) 1.5 Rx 20000000 0": BAD,
    "1) 1.5 Rx 0123 3 RTR": "1500000 0 123 3 000000 r",
    "1) 1.5 Error 0008 4 00 19 08 00": "1500000 0 0 0 - e",
    "1) 1.5 Warng FFFFFFFF 4 00 00 00 04": OTHER,
    "1) 1,5 Rx 0123 1 0A": "1500000 0 123 1 0a -",
    "1) -1.5 Rx 0123 1 0A": "-1500000 0 123 1 0a -",
    "1) 1.5 Rz 0123 1 0A": BAD,
    f"1) 1.5 Rx 0123 8 {_8_SPACED}": f"1500000 0 123 8 {_8} -",
    f"1) 1.5 Rx 0123 9 {_8_SPACED} 9": BAD,
    "1) 1.5 Rx 0123 2 0A": BAD,
    "1) 1.5 Rx 0123 1 GG": BAD,
    "1) 1.5 Rx 0123": BAD,
    "1) x Rx 0123 0": BAD,
}
TRC_2_1 = {
    "1 1.5 DT 1 0123 Rx - 2 0A FF": "1500000 0 123 2 0aff -",
    "1 1.5 DT 16 0123 Tx - 2 0A FF": "1500000 15 123 2 0aff t",
    "1 1.5 DT 0002 0123 Rx - 0": "1500000 1 123 0 - -",
    "1 1.5 DT 300 0123 Rx - 0": "1500000 255 123 0 - -",
    "1 1.5 RR 1 0123 Rx - 3": "1500000 0 123 3 000000 r",
    "1 1.5 ER 1 - Rx - 0": "1500000 0 0 0 - e",
    "1 1.5 ER 2 0004 Rx - 1 0A": "1500000 1 0 0 - e",
    "1 1.5 ST 1 - Rx - 4 00 00 00 08": OTHER,
    "1 1.5 EC 1 - Rx - 2 02 02": OTHER,
    "1 1.5 EV 1 mark": OTHER,
    "1 1.5 FD 1 0123 Rx - 1 0A": "1500000 0 123 1 0a f",
    "1 1.5 FB 1 0123 Rx - 1 0A": "1500000 0 123 1 0a fb",
    "1 1.5 FE 1 0123 Rx - 1 0A": "1500000 0 123 1 0a fbs",
    "1 1.5 BI 1 0123 Rx - 1 0A": "1500000 0 123 1 0a fs",
    f"1 1.5 FD 1 0123 Rx - 15 {_64_SPACED}": f"1500000 0 123 64 {_64} f",
    f"1 1.5 FD 1 0123 Rx - 16 {_64_SPACED}": BAD,
    f"1 1.5 DT 1 0123 Rx - 15 {_8_SPACED}": f"1500000 0 123 8 {_8} -",
    f"1 1.5 DT 1 0123 Rx - 16 {_8_SPACED}": BAD,
}
TRC_1_0 = {
    "1) 1500 0123 1 0A": "1500000000 0 123 1 0a -",
    "1) 1500 FFFFFFFF 4 00 00 00 08": OTHER,
    "1) 1500 00000123 1 0A": "1500000000 0 123 1 0a x",
}

Make = Callable[[], LineParser]
TABLES: dict[str, tuple[Make, str, dict[str, str]]] = {
    "candump": (CandumpParser, "", CANDUMP),
    "python-can": (CsvParser, CSV_HEAD, CSV),
    "ASC": (AscParser, ASC_HEAD, ASC),
    "TRC 1.0": (TrcParser, "", TRC_1_0),
    "TRC 1.1": (TrcParser, _1_1, TRC_1_1),
    "TRC 2.1": (TrcParser, _2_1, TRC_2_1),
}


@pytest.mark.parametrize("name", TABLES)
def test_each_line_is_the_frame_that_its_format_describes(name: str) -> None:
    make, head, table = TABLES[name]
    text = "".join([head, "\r\n\r\n", *(f"{line}\r\n" for line in table)])
    found = parsed(text.encode(), make())
    first = head.count("\n") + 2
    kept = [each for each in table.values() if each not in (BAD, OTHER)]
    assert shown(found.frames) == kept
    bad = [first + i for i, each in enumerate(table.values()) if each == BAD]
    assert list(found.bad) == bad


# Heads, and logs cut into blocks ------------------------------------------------------------------

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
        (b"() can0 123#0304\n(-.) can0 123#0304\n(.5) can0 123#0304\n", 3, 2, 0),  # no time in two
    ],
)
def test_a_last_line_without_an_end(tail: bytes, frames: int, garbled: int, cut: int) -> None:
    found, loss = _read(LINE * 2 + tail)
    assert (found, loss.garbled, loss.bytes_cut) == (frames, garbled, cut)


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daq.formats.reader.BLOCK_BYTES", 1 << 11)


@pytest.mark.usefixtures("small_blocks")
def test_the_first_line_that_is_no_frame_is_named_by_its_number() -> None:
    _, loss = _read(LINE + b"\n" + LINE + b"no frame\nnor this\n")
    assert loss.garbled == 2
    assert "line 4 is not a frame: 'no frame'" in loss.text
    many = LINE * 200  # more than one block
    _, loss = _read(many + b"no frame\n" + LINE)
    assert "line 201 is not a frame" in loss.text
    _, loss = _read(many + b"(2.5) can0 123#")
    assert "line 201 has no end" in loss.text


@pytest.mark.usefixtures("small_blocks")
def test_zeros_after_a_power_cut_are_counted_with_the_line_that_they_cut() -> None:
    for raw, frames, garbled, cut in (
        (LINE * 200 + bytes(100), 200, 0, 100),
        (LINE + bytes(1000) + LINE, 2, 0, 1000),
        (bytes(7) + LINE, 1, 0, 7),
        (LINE + b"(2.5) can0 123#01" + bytes(30) + LINE, 2, 1, 30),
        (LINE * 120 + b"(2.5) can0 1" + bytes(6000) + LINE, 121, 1, 6000),
    ):
        found, loss = _read(raw)
        assert (found, loss.garbled, loss.bytes_cut) == (frames, garbled, cut)


def test_a_line_without_an_end_is_no_text_log() -> None:
    assert _read(LINE + b"(" + b"1" * 65_535)[1].bytes_cut == 65_536
    with pytest.raises(InputError, match="not a text log"):
        _read(LINE + b"(" + b"1" * 65_536)
