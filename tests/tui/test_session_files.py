"""`export`, `validate` and `inspect` at the command line."""

import json
from dataclasses import replace
from pathlib import Path

import asammdf
import can
import h5py
import pytest

from daq import write_session
from daq.bench.databases import Database, stored_text
from tui.cli import run

from ..daq.sensor_bench import IMU
from ..daq.small_session import small_session


@pytest.fixture
def car(tmp_path: Path) -> str:
    write_session(tmp_path / "car.h5", small_session())
    return str(tmp_path / "car.h5")


def test_export_says_what_it_wrote_and_what_it_left_out(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, car: str
) -> None:
    assert run(["export", car, "--format", "asc", "--run", "baseline_roll_2"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [str(tmp_path / "car.asc")]
    assert "ASC rounds times to 1 µs" in err
    with can.ASCReader(tmp_path / "car.asc") as reader:
        assert len(list(reader)) == len(small_session().runs[1].frames)


def test_the_suffix_tells_the_format_and_a_folder_the_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, car: str
) -> None:
    (tmp_path / "out").mkdir()
    options = ["--separator", ";", "--decimal", ",", "--run", "baseline_roll_1"]
    assert run(["export", car, "--out", str(tmp_path / "x.csv"), *options]) == 0
    assert run(["export", car, "--out", str(tmp_path / "out"), "--format", "parquet"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        str(tmp_path / "x_baseline_roll_1_HUB_Front.csv"),
        str(tmp_path / "x_baseline_roll_1_A_IMU.csv"),
        str(tmp_path / "out" / "car.parquet"),
    ]
    text = (tmp_path / "x_baseline_roll_1_A_IMU.csv").read_text()
    assert text.splitlines()[:2] == ["time_s;az [m/s2];pitch [rad/s];quality", "0,0;9,75;0,25;0"]


def test_validate(capsys: pytest.CaptureFixture[str], tmp_path: Path, car: str) -> None:
    broken, prose = tmp_path / "broken.h5", tmp_path / "prose.h5"
    broken.write_bytes(Path(car).read_bytes())
    prose.write_text("x")
    with h5py.File(broken, "r+") as file:
        del file["channels/unit"]
    assert run(["identify", str(broken)]) == 2
    assert "/channels was changed or damaged" in capsys.readouterr().err
    assert run(["validate", car]) == 0
    assert capsys.readouterr().out == f"{car}: valid\n"
    assert run(["validate", car, str(broken)]) == 1
    assert "  error: /channels/unit: is absent" in capsys.readouterr().out
    assert run(["validate", car, str(prose), str(broken), "--json"]) == 2
    out, err = capsys.readouterr()
    files = json.loads(out)["files"]
    assert [file["valid"] for file in files] == [True, False, False]
    assert files[2]["findings"][0]["where"] == "/channels"
    assert len(err.splitlines()) == 1
    assert run(["validate"]) == 2


def test_the_schema_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["validate", "--schema"]) == 0
    out = capsys.readouterr().out
    assert "schema v1" in out
    assert "/runs/r001_LABEL" in out


def test_inspect(capsys: pytest.CaptureFixture[str], car: str) -> None:
    assert run(["inspect", car]) == 0
    out = capsys.readouterr().out
    for text in (
        "Wagen Ü: 3 runs",
        "too weak: 0.3 m/s2",
        "2 counter_gaps",
        "HUB_Front.a",
        "x -1 y 0.1 m",
        "2 ms late",
        "1551.8",
        "30 kg at x -1 y 0.5 m",
        "4 kg at hub RL",
        "2026-11-21",
    ):
        assert text in out
    assert run(["inspect", car, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["channels"][0]["corner"] == "FL"
    assert document["geometry"]["t_r"] == 0.75
    assert document["facts"][1] == {"quantity": "k_sfl", "value": 17000.0, "sigma": 50.0}
    assert document["provenance"]["dbc"] == "7 bytes"


ONE_BUS = """
[[bus]]
interface = "virtual"
channel = "can0"
name = "front"
"""
TWO_BUSES = ONE_BUS + '[[bus]]\ninterface = "virtual"\nchannel = "can1"\n'
SENSOR = '[[sensor]]\nname = "imu"\ndbc = "imu.dbc"\nbus = 0\n'


@pytest.mark.parametrize(
    ("bench", "bus"),
    [(ONE_BUS + SENSOR, "1"), (TWO_BUSES, "can1")],
    ids=["the number is that of the log", "no sensor names its bus"],
)
def test_all_channels_are_exported_where_no_bus_has_some_of_them(
    bench: str, bus: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = small_session()
    database = stored_text((Database("imu.dbc", IMU),))
    about = {**session.provenance, "bench_toml": bench, "dbc": database}
    write_session(tmp_path / "car.h5", replace(session, provenance=about))
    out = tmp_path / "part.mf4"
    words = ["export", str(tmp_path / "car.h5"), "--bus", bus, "--out", str(out)]
    assert run(words) == 0, capsys.readouterr().err
    names = {channel.name for channel in session.channels}
    with asammdf.MDF(out) as mdf:
        assert names <= mdf.channels_db.keys()
