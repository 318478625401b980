"""`bumpbench decode`, and the logs that commands take."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import can
import cantools.database.can as cantools
import numpy as np
import pytest

from dbc import parse_codec, shipped_dbc
from tui.cli import main, run

from .conftest import answered

START_S = 1_760_000_000.0


def _log(path: Path, foreign: int) -> list[can.Message]:
    codec = parse_codec(shipped_dbc(), "shipped")
    rng = np.random.default_rng(1)
    messages = []
    for layout in codec.messages:
        names = [s.name for s in layout.signals if s.name not in ("counter", "crc")]
        values = {n: rng.uniform(*layout.signal(n).span, 20) for n in names}
        for i, row in enumerate(codec.encode(layout.name, values)):
            data = row[: layout.length].tobytes()
            stamp = START_S + i * 0.01
            messages.append(can.Message(stamp, layout.can_id, is_extended_id=False, data=data))
    messages += [
        can.Message(START_S + n, 0x7DF, is_extended_id=False, data=b"x") for n in range(foreign)
    ]
    messages.sort(key=lambda message: message.timestamp)
    with can.Logger(path) as log:
        for message in messages:
            log(message)
    return messages


@pytest.mark.parametrize("suffix", [".blf", ".log"])
def test_every_signal_is_what_cantools_says(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"bench{suffix}"
    messages = _log(path, foreign=0)
    assert run(["decode", str(path)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    rows = list(csv.DictReader(io.StringIO(out)))
    assert list(rows[0]) == ["time_s", "message", "signal", "value", "unit"]
    times = [float(row["time_s"]) for row in rows]
    assert times == sorted(times)
    found = sorted((r["message"], r["signal"], float(r["value"]), r["unit"]) for r in rows)
    database = cantools.Database()
    database.add_dbc_string(shipped_dbc())
    expected = []
    for message in messages:
        layout = database.get_message_by_frame_id(message.arbitration_id)
        values = layout.decode_simple(bytes(message.data), decode_choices=False)
        for name, value in values.items():
            assert isinstance(value, int | float)
            unit = layout.get_signal_by_name(name).unit or ""
            expected.append((layout.name, name, float(value), unit))
    assert found == sorted(expected)


def test_foreign_frames_are_counted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "bench.log"
    _log(path, foreign=3)
    document, err = answered(capsys, "decode", str(path))
    assert document["unknown_id"] == 3
    assert document["frames"] == 6 * 20 + 3
    assert document["samples"]["HUB_Front.acc_fl"] == 20
    assert "3 unknown_id" in err


MOTOR = """VERSION ""
BU_: A
BO_ 2566849022 Motor: 8 A
 SG_ speed : 0|16@1+ (0.5,-10) [0|0] "1,min" A
 SG_ torque : 16|16@1- (1,0) [0|0] "Nm" A
"""
"""One message with the identifier 0x18FF01FE."""


def test_a_unit_with_a_comma_is_quoted_and_frames_of_other_identifiers_are_counted(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    log, dbc = tmp_path / "a.log", tmp_path / "motor.dbc"
    dbc.write_text(MOTOR, "utf-8")
    log.write_text(
        "(2.5) can0 18FF01FE#1400FFFF00000000\n(2.25) can0 0CFF0117#1600020000000000\n"
        "(3.0) can0 18FF02FE#1400FFFF00000000\n",
        "ascii",
    )
    assert run(["decode", str(log), "--dbc", str(dbc)]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "time_s,message,signal,value,unit",
        '2.500000000,Motor,speed,0,"1,min"',
        "2.500000000,Motor,torque,-1,Nm",
    ]
    assert err == "bumpbench: of 3 frames not all were decoded: 2 unknown_id\n"


# What a log lost, and its times -------------------------------------------------------------------


DBC = """VERSION ""
BO_ 291 M1: 8 A
 SG_ s1 : 0|16@1- (0.1,0) [0|0] "{unit}" A
"""
ASC_HEAD = "date Mon Dec 6 11:21:13 am 2021\nbase hex  timestamps absolute\n"
TRC = ";$FILEVERSION=2.1\n;$STARTTIME=42209.4\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n"


@pytest.fixture
def dbc(tmp_path: Path) -> Path:
    path = tmp_path / "one.dbc"
    path.write_text(DBC.format(unit="g"))
    return path


def _asc(*lines: str) -> str:
    rows = [f"   {n / 100:.6f} 1  123 Rx   d 8 {n:02X} 01 00 00 00 00 00 00" for n in range(20)]
    return ASC_HEAD + "\n".join([*rows, *lines]) + "\n"


LOSSES = {
    "asc": (
        _asc("0.5x0 1 123 Rx d 1 01", "0.60 1 123 R d 1 01", "0.7 1 Statistic: D 0", "0.8 1,2d0"),
        20,
        "3 records unreadable; line 23 is not a frame: '0.5x0 1 123 Rx d 1 01'",
    ),
    "negative times": (_asc().replace(" 0.000000", "-0.000012"), 20, ""),
    "one stamp out of line": (
        _asc().replace("0.100000", "-6.10000"),
        19,
        "1 record unreadable; 1 time stamp out of line with its neighbours, the first at frame 11",
    ),
    "trc": (
        TRC + "1 1.0 DT 1 0123 Rx - 2 01 02\n2 2.0 ER 1 - Rx - 5 04 00 02 00 00\n"
        "3 3.0 ST 1 - Rx - 4 00 00 00 08\n4 3.5 EV 1 mark\n5 4.0 EC 1 - Rx - 2 02 02\n",
        2,
        "",
    ),
    "trc of another type": (
        TRC + "1 1.0 DT 1 0123 Rx - 2 01 02\n2 2.0 DZ 1 0123 Rx - 2 01 02\n",
        1,
        "1 record unreadable; line 5 is not a frame: '2 2.0 DZ 1 0123 Rx - 2 01 02'",
    ),
    "an overrun": (
        TRC + "1 1.0 DT 1 0123 Rx - 2 01 02\n2 2.0 ST 1 - Rx - 4 00 00 00 02\n",
        1,
        "1 frame lost by its recorder; line 5 states 1 lost frame",
    ),
    "zeros": (
        "(1.0) can0 123#0102030405060708\n(2.0) can0 12" + "\0" * 200,
        1,
        "1 record unreadable, 200 bytes cut off; 200 zero bytes up to line 2; "
        "zero bytes cut 1 line up to line 2",
    ),
    "DROPCOUNT": (
        "(1.0) can0 123#0102030405060708\nDROPCOUNT: dropped 13 CAN frames (total drops 13)",
        1,
        "13 frames lost by its recorder; line 2 states 13 lost frames",
    ),
    "a stamp in milliseconds": (
        "(1.0) can0 123#0102030405060708\n(1700000000123) can0 123#0102030405060708\n",
        1,
        "1 record unreadable; line 2 is not a frame: '(1700000000123) can0 123#0102030405060708'",
    ),
}


@pytest.mark.parametrize("case", LOSSES)
def test_what_is_not_read_is_counted_once_with_its_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, dbc: Path, case: str
) -> None:
    text, frames, loss = LOSSES[case]
    path = tmp_path / "a.txt"
    path.write_text(text)
    assert run(["decode", str(path), "--dbc", str(dbc), "--json"]) == (3 if loss else 0)
    out, err = capsys.readouterr()
    assert json.loads(out)["frames"] == frames
    assert err.count("is not whole") == (1 if loss else 0)
    assert loss in err


def test_times_below_zero_are_printed_as_they_are(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, dbc: Path
) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{t},0x123,0,0,0,2,AQI=\n" for t in (-1.5, -0.25, 0.75))
    path.write_text(f"timestamp,arbitration_id,extended,remote,error,dlc,data\n{rows}")
    assert run(["decode", str(path), "--dbc", str(dbc)]) == 0
    times = [line.split(",")[0] for line in capsys.readouterr().out.splitlines()[1:]]
    assert times == ["-1.500000000", "-0.250000000", "0.750000000"]


def test_an_mf4_without_a_length_has_the_bytes_of_its_payload(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, dbc: Path
) -> None:
    import asammdf

    kind = "CAN_DataFrame"
    fields = np.zeros(2, [(f"{kind}.ID", "<u4"), (f"{kind}.DataBytes", "(8,)u1")])
    fields[f"{kind}.ID"], fields[f"{kind}.DataBytes"][:, :2] = 0x123, (1, 2)
    with asammdf.MDF() as mdf:
        mdf.append(asammdf.Signal(fields, np.array([0.25, 0.26]), name=kind))
        mdf.save(tmp_path / "a.mf4")
    assert run(["decode", str(tmp_path / "a.mf4"), "--dbc", str(dbc)]) == 0
    values = [float(line.split(",")[3]) for line in capsys.readouterr().out.splitlines()[1:]]
    assert values == pytest.approx([51.3, 51.3])


def test_several_buses_have_a_column_and_can_be_chosen_without_a_bench(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, dbc: Path
) -> None:
    path = tmp_path / "a.log"
    path.write_text("".join(f"(1.00000{n}) can{n % 2} 123#{n % 2:02X}00\n" for n in range(4)))
    command = ["decode", str(path), "--dbc", str(dbc)]
    assert run(command) == 0
    rows = [line.split(",") for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == ["time_s", "bus", "message", "signal", "value", "unit"]
    assert [row[1] for row in rows[1:]] == ["0", "1", "0", "1"]
    assert run([*command, "--bus", "1"]) == 0
    rows = [line.split(",") for line in capsys.readouterr().out.splitlines()]
    assert rows[0] == ["time_s", "message", "signal", "value", "unit"]
    assert [row[3] for row in rows[1:]] == ["0.1", "0.1"]
    assert answered(capsys, *command, "--bus", "1")[0]["frames"] == 2, "of this bus"
    assert run([*command, "--bus", "front"]) == 2
    assert "write its number" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("unit", "shown"), [("=1+1", "'=1+1"), ("a\x1b[2Jb", "a\N{REPLACEMENT CHARACTER}[2Jb")]
)
def test_units_are_text_for_a_spreadsheet_and_a_terminal(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, dbc: Path, unit: str, shown: str
) -> None:
    dbc.write_text(DBC.format(unit=unit))
    (tmp_path / "a.log").write_text("(1.0) can0 123#0102030405060708\n")
    assert run(["decode", str(tmp_path / "a.log"), "--dbc", str(dbc)]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[1].endswith(f",{shown}")
    assert "\x1b" not in out + err


@pytest.mark.parametrize("encoding", ["ascii"])
def test_a_console_that_lacks_a_character_gets_another(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, dbc: Path, encoding: str
) -> None:
    dbc.write_text(DBC.format(unit="m/s²"), "utf-8")
    (tmp_path / "a.log").write_text("(1.0) can0 123#0102030405060708\n")
    raw = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(raw, encoding))
    monkeypatch.setattr(
        sys, "argv", ["bumpbench", "decode", str(tmp_path / "a.log"), "--dbc", str(dbc)]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    sys.stdout.flush()
    assert ended.value.code in (0, None)
    assert b"m/s?" in raw.getvalue()
