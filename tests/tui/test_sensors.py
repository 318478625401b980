"""Benches of several sensors."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from daq import read_session
from daq.bench.config import bench_codec, load_bench
from daq.channels import message_of, sensor_of
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from tui.cli import run

from ..daq.sensor_bench import DATABASES, HUBS, IMU, TEXT, channel
from .conftest import answered
from .test_import import write_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with bench.toml, its databases and a candump log of both buses."""
    made = tmp_path_factory.mktemp("sensors")
    (made / "bench.toml").write_text(TEXT, "utf-8")
    for name, text in DATABASES.items():
        (made / name).write_text(text, "utf-8")
    bench = load_bench(made / "bench.toml")
    frames = campaign_frames(bench, bench_codec(bench), SimulatedCar(), 1, 1_800_000_000 * 10**9)
    write_log(made / "drive.log", next(frames))
    return made


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
    said, _ = answered(capsys, "decode", log, bench, "--bus", "can0")
    assert {name.partition(".")[0] for name in said["samples"]} == {"imu_a", "hubs"}
    for bus in ("can9", "2"):
        assert run(["decode", log, bench, "--bus", bus]) == 2
        reason = f"--bus {bus}: is not a bus of the bench (name one of can0, rear)"
        assert reason in capsys.readouterr().err


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
