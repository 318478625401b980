"""Benches of several sensors, and what is asked about a proposed one."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from daq import read_session
from daq.bench.config import bench_codec, load_bench
from daq.channels import sensor_of_signal
from daq.check.guess import Answers
from daq.check.propose import Proposal
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch
from tui.cli import run
from tui.diagnostics import is_asked
from tui.proposal import completed

from ..daq.sensor_bench import DATABASES, HUBS, IMU, TEXT, channel


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with bench.toml, its databases and a candump log of both buses."""
    made = tmp_path_factory.mktemp("sensors")
    (made / "bench.toml").write_text(TEXT, "utf-8")
    for each in DATABASES:
        (made / each.name).write_text(each.text, "utf-8")
    bench = load_bench(made / "bench.toml")
    frames = campaign_frames(bench, bench_codec(bench), SimulatedCar(), 1, 1_800_000_000 * 10**9)
    (made / "drive.log").write_text(_candump(next(frames)), "utf-8")
    return made


def _candump(frames: FrameBatch) -> str:
    rows = zip(
        frames.t_ns.tolist(), frames.bus, frames.can_id, frames.length, frames.data, strict=True
    )
    return "".join(
        f"({t // 10**9}.{t % 10**9 // 1000:06d}) can{bus} {can_id:03X}#{data[:n].tobytes().hex()}\n"
        for t, bus, can_id, n, data in rows
    )


def test_decode_names_bus_and_sensor_and_chooses_by_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, bench = str(folder / "drive.log"), str(folder / "bench.toml")
    assert run(["decode", log, bench, "--sensor", "imu_b"]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    assert {(row["bus"], row["sensor"]) for row in rows} == {("rear", "imu_b")}
    level = [float(row["value"]) for row in rows if row["signal"] == "AccZ"][:100]
    assert sum(level) / 100 == pytest.approx(-1.0, abs=0.05)
    assert run(["decode", log, bench, "--bus", "can0", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {name.partition(".")[0] for name in said["samples"]} == {"imu_a", "hubs"}


def test_import_chooses_sensors_and_a_bus(folder: Path, tmp_path: Path) -> None:
    log, bench = str(folder / "drive.log"), str(folder / "bench.toml")
    out = tmp_path / "s.h5"
    runs = [bench, "--run", f"baseline:bounce:{log}", "--out", str(out), "--force"]
    for words, sensors in (
        ([], {"hubs", "imu_a", "imu_b", "pot_fl", "pot_fr", "pot_rl", "pot_rr"}),
        (["--bus", "can0"], {"hubs", "imu_a"}),
        (["--bus", "1", "--sensor", "imu_b"], {"imu_b"}),
    ):
        assert run(["import", *runs, *words]) == 0
        session = read_session(out)
        assert {sensor_of_signal(c.signal) for c in session.channels} == sensors
        buses = {"can0": {0}, "1": {1}}.get(words[1], set()) if words else {0, 1}
        assert set(session.runs[0].frames.bus.tolist()) == buses


def test_import_says_that_two_sensors_are_read_as_one(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hubs = HUBS[HUBS.index("BO_ 768") : HUBS.index("BA_DEF_")].replace("Accel", "Wheels")
    (folder / "one.dbc").write_text(IMU.replace("BA_DEF_ BO_", f"{hubs}BA_DEF_ BO_"), "utf-8")
    tables = channel("acc", "Accel.AccZ", "body_acceleration") + channel(
        "hub", "Wheels.FL", "hub_acceleration", 'corner = "FL"'
    )
    bench = folder / "one.toml"
    bench.write_text(f'dbc = "one.dbc"\n{tables}', "utf-8")
    runs = ["--run", f"baseline:bounce:{folder / 'drive.log'}", "--out", str(tmp_path / "s.h5")]
    run(["import", str(bench), *runs, "--bus", "0"])
    assert "two sensors read as one" not in capsys.readouterr().err
    run(["import", str(bench), *runs, "--force"])
    assert "two sensors read as one: Accel, Rate" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--sensor", "imu_c"], "--sensor imu_c: is not on the bench"),
        (["--sensor", "pot_rl", "--bus", "can0"], "--sensor pot_rl: not on that bus (but on rear)"),
        (["--bus", "can9"], "--bus can9: is not a bus of the bench (name one of can0, rear)"),
        (["--bus", "2"], "--bus 2: is not a bus of the bench (name one of can0, rear)"),
    ],
)
def test_a_sensor_or_bus_that_is_not_there_is_one_line(
    folder: Path, words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["decode", str(folder / "drive.log"), str(folder / "bench.toml"), *words]) == 2
    assert reason in capsys.readouterr().err


# Questions about a proposal -----------------------------------------------------------------------


PROPOSED = """# a comment  # FILL IN
[vehicle]
name = "car"  # FILL IN
[[channel]]
name = "acc_z"
x_m = 0.0  # FILL IN: from the front axle, forward
y_m = 1.0
"""


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        """Say so."""
        return True


def proposal(_: Answers) -> Proposal:
    return Proposal(PROPOSED, ())


Answered = Callable[..., list[str]]


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> Answered:
    """Return what types lines at a terminal of so many columns, and returns those of the text."""

    def type_(*lines: str, columns: int = 200) -> list[str]:
        # Only now: pytest puts its own streams there when a test begins.
        monkeypatch.setattr(sys, "stdin", Terminal("".join(f"{line}\n" for line in lines)))
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        monkeypatch.setenv("COLUMNS", str(columns))
        text = completed(proposal).text
        assert text.endswith("\n")
        return text.splitlines()

    return type_


def test_marked_lines_are_filled_in_and_keep_their_remarks(
    answered: Answered, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = answered("T5", "-1.05")
    assert lines == [
        "# a comment  # FILL IN", "[vehicle]", 'name = "T5"', "[[channel]]", 'name = "acc_z"',
        "x_m = -1.05  # from the front axle, forward", "y_m = 1.0",
    ]  # fmt: skip
    assert capsys.readouterr().err == (
        "bumpbench: an empty answer leaves the question in the file\n"
        '? vehicle name (now "car"): '
        "? acc_z x_m (from the front axle, forward; now 0.0): "
    )


def test_what_is_no_number_is_asked_again_and_nothing_leaves_the_mark(
    answered: Answered, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = answered("", "far", '"1"', "2")
    assert lines[2] == 'name = "car"  # FILL IN'
    assert lines[5] == "x_m = 2  # from the front axle, forward"
    err = capsys.readouterr().err
    assert "bumpbench: 'far' is not a number\n" in err
    assert "is not a number\n? acc_z x_m" in err
    assert err.count("is not a number") == 2
    assert answered('a"b', "T5")[2] == 'name = "T5"'
    assert "'a\"b' is not a text" in capsys.readouterr().err


@pytest.mark.parametrize(("columns", "widest"), [(60, 48), (44, 32), (10, 12)])
def test_a_question_leaves_room_for_its_answer(
    columns: int, widest: int, answered: Answered, capsys: pytest.CaptureFixture[str]
) -> None:
    answered(columns=columns)
    asked = capsys.readouterr().err.partition("\n")[2]
    longest = max(len(line.rstrip()) for line in asked.replace(": ? ", ":\n? ").splitlines())
    assert widest - 12 < longest <= widest


def test_without_a_terminal_nothing_is_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stdin, stderr in ((io.StringIO("T5\n"), True), (Terminal("T5\n"), False)):
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(sys.stderr, "isatty", lambda stderr=stderr: stderr, raising=False)
        assert not is_asked()
        assert completed(proposal).text == PROPOSED
    assert capsys.readouterr() == ("", "")
