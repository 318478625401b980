"""`decode`: any log of python-can, against what cantools makes of the same frames."""

import csv
import io
import json
from pathlib import Path

import can
import cantools.database.can as cantools
import numpy as np
import pytest

from dbc import parse_codec, shipped_dbc
from tui.cli import run

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


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log", ".trc", ".csv"])
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
    assert run(["decode", str(path), "--json"]) == 0
    out, err = capsys.readouterr()
    document = json.loads(out)
    assert document["unknown_id"] == 3
    assert document["frames"] == 6 * 20 + 3
    assert document["samples"]["HUB_Front.acc_fl"] == 20
    assert "3 unknown_id" in err


def test_several_databases_keep_their_messages_apart(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    log = tmp_path / "bench.log"
    _log(log, foreign=0)
    files = []
    for folder, text in (
        ("a", shipped_dbc()),
        ("b", shipped_dbc() + "\n"),
        ("c", 'VERSION ""\nBO_ 272 Other: 8 X\n SG_ s : 0|8@1+ (1,0) [0|0] "" X\n'),
    ):
        files.append(tmp_path / folder / "same.dbc")
        files[-1].parent.mkdir()
        files[-1].write_text(text, "utf-8")
    a, b, c = (["--dbc", str(path)] for path in files)
    assert run(["decode", str(log), *a, *b]) == 2
    assert "the identifier of one in another of them (name one of them)" in capsys.readouterr().err
    assert run(["decode", str(log), *a, *c, "--json"]) == 0
    out, err = capsys.readouterr()
    samples = json.loads(out)["samples"]
    assert samples["same_1.HUB_Rear.acc_rl"] == 20
    assert not any("HUB_Front" in name or "Other" in name for name in samples)
    assert "same_1.HUB_Front and same_2.Other have the identifier 0x110" in err


MOTOR = """VERSION ""
BU_: A
BO_ 2566849022 Motor: 8 A
 SG_ speed : 0|16@1+ (0.5,-10) [0|0] "1,min" A
 SG_ torque : 16|16@1- (1,0) [0|0] "Nm" A
"""
"""One message with the J1939 identifier 0x18FF01FE: its group is 0xFF01, its source 0xFE."""


def test_another_source_of_a_parameter_group_is_decoded_where_that_is_asked_for(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    log, dbc = tmp_path / "a.log", tmp_path / "motor.dbc"
    dbc.write_text(MOTOR, "utf-8")
    log.write_text(
        "(2.5) can0 18FF01FE#1400FFFF00000000\n(2.25) can0 0CFF0117#1600020000000000\n"
        "(3.0) can0 18FF02FE#1400FFFF00000000\n",
        "ascii",
    )
    words = ["decode", str(log), "--dbc", str(dbc)]
    assert run(words) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [
        "time_s,message,signal,value,unit",
        '2.500000000,Motor,speed,0,"1,min"',
        "2.500000000,Motor,torque,-1,Nm",
    ]
    assert err == "bumpbench: of 3 frames not all were decoded: 2 unknown_id\n"
    assert run([*words, "--j1939"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[1:] == [
        '2.250000000,Motor,speed,1,"1,min"',
        "2.250000000,Motor,torque,2,Nm",
        '2.500000000,Motor,speed,0,"1,min"',
        "2.500000000,Motor,torque,-1,Nm",
    ]
    assert "1 unknown_id" in err


BENCH = """
dbc = "motor.dbc"
[[bus]]
interface = "virtual"
channel = "can0"
name = "left, front"
[[channel]]
name = "v"
signal = "Motor.speed"
quantity = "unused"
"""


def test_a_bench_of_one_bus_names_it_and_one_of_two_does_not_guess(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    log, dbc, bench = (tmp_path / name for name in ("a.log", "motor.dbc", "bench.toml"))
    dbc.write_text(MOTOR, "utf-8")
    log.write_text("(2.5) can0 18FF01FE#1400FFFF00000000\n", "ascii")
    more = '[[bus]]\ninterface = "virtual"\nchannel = "can1"\n'
    for text, bus in (
        (BENCH, '"left, front"'),
        (BENCH.replace("[[channel]]", f"{more}[[channel]]"), ""),
    ):
        bench.write_text(text, "utf-8")
        assert run(["decode", str(log), str(bench)]) == 0, capsys.readouterr().err
        assert capsys.readouterr().out.splitlines() == [
            "time_s,bus,sensor,message,signal,value,unit",
            f'2.500000000,{bus},,Motor,speed,0,"1,min"',
            f"2.500000000,{bus},,Motor,torque,-1,Nm",
        ]
