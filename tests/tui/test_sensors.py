"""Benches of several sensors."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from daq import read_session
from daq.bench.config import bench_codec, load_bench
from daq.channels import message_of, sensor_of
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch
from tui.cli import run

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


def test_decode_names_bus_and_sensor_and_chooses_a_bus(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, bench = str(folder / "drive.log"), str(folder / "bench.toml")
    assert run(["decode", log, bench]) == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    names = {"imu_a", "hubs", "imu_b", "pot_fl", "pot_fr", "pot_rl", "pot_rr"}
    assert {row["message"].partition(".")[0] for row in rows} == names
    imu_b = [row for row in rows if row["message"].startswith("imu_b.")]
    assert {row["bus"] for row in imu_b} == {"1"}
    level = [float(row["value"]) for row in imu_b if row["signal"] == "AccZ"][:100]
    assert sum(level) / 100 == pytest.approx(-1.0, abs=0.05)
    assert run(["decode", log, bench, "--bus", "can0", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {name.partition(".")[0] for name in said["samples"]} == {"imu_a", "hubs"}


def test_import_chooses_a_bus(folder: Path, tmp_path: Path) -> None:
    log, bench = str(folder / "drive.log"), str(folder / "bench.toml")
    out = tmp_path / "s.h5"
    runs = [bench, "--run", f"baseline:bounce:{log}", "--out", str(out), "--force"]
    for words, sensors in (
        ([], {"hubs", "imu_a", "imu_b", "pot_fl", "pot_fr", "pot_rl", "pot_rr"}),
        (["--bus", "can0"], {"hubs", "imu_a"}),
        (["--bus", "rear"], {"imu_b", "pot_fl", "pot_fr", "pot_rl", "pot_rr"}),
    ):
        assert run(["import", *runs, *words]) == 0
        session = read_session(out)
        assert {sensor_of(message_of(c.signal)) for c in session.channels} == sensors
        buses = {"can0": {0}, "rear": {1}}.get(words[1], set()) if words else {0, 1}
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
        (["--bus", "can9"], "--bus can9: is not a bus of the bench (name one of can0, rear)"),
        (["--bus", "2"], "--bus 2: is not a bus of the bench (name one of can0, rear)"),
    ],
)
def test_a_bus_that_is_not_there_is_one_line(
    folder: Path, words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["decode", str(folder / "drive.log"), str(folder / "bench.toml"), *words]) == 2
    assert reason in capsys.readouterr().err
