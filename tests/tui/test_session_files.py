"""Session files: `inspect`, `validate`, `export`, `redecode`, and the notebook."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import asammdf
import can
import h5py
import numpy as np
import pytest
import pyuff
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat

import daq
from daq import Session, read_session, write_session
from daq.channels import Channel, Quantity
from daq.formats.export import ExportFormat, export_session
from daq.runs import SampleGroup
from daq.vehicle import Corner
from dbc import InputError, shipped_dbc
from tui.cli import run

from ..daq.small_campaign import bumps, small_codec
from ..daq.small_session import START_NS, small_session
from .conftest import answered, said
from .test_import import BENCH, write_log


def test_export_says_what_it_wrote_and_what_it_left_out(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, car: str
) -> None:
    assert run(["export", car, "--format", "asc", "--run", "baseline_roll_2"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines() == [str(tmp_path / "car.asc")]
    assert "ASC rounds times to 1 µs" in err
    with can.ASCReader(tmp_path / "car.asc") as reader:
        assert len(list(reader)) == len(small_session().runs[1].frames)
    words = ["export", car, "--format", "asc", "--json"]
    assert "--force" in said(capsys, *words, code=2)[1]
    document = json.loads(said(capsys, *words, "--force", code=0)[0])
    assert (document["session"], document["files"]) == (car, [str(tmp_path / "car.asc")])
    assert any("1 µs" in note for note in document["notes"])


def test_the_suffix_tells_the_format_and_a_folder_the_place(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, car: str
) -> None:
    (tmp_path / "out").mkdir()
    options = ["--decimal", ",", "--run", "baseline_roll_1"]
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
        "1551.8",
        "30 kg at x -1 y 0.5 m",
        "4 kg at hub RL",
        "2026-11-21",
    ):
        assert text in out
    document, _ = answered(capsys, "inspect", car)
    assert document["channels"][0]["corner"] == "FL"
    assert document["geometry"]["t_r"] == 0.75
    assert document["facts"][1] == {"quantity": "k_sfl", "value": 17000.0, "sigma": 50.0}
    assert document["provenance"]["dbc"] == "7 bytes"


# Formats of export, each read by its own library --------------------------------------------------


SESSION = small_session()
UNITS = {"hub_fl": "m/s2", "hub_fr": "m/s2", "az": "m/s2", "pitch": "rad/s"}
CSV_FILES = [
    f"car_baseline_roll_{n}_{group}.csv" for n in (1, 2, 3) for group in ("HUB_Front", "A_IMU")
]


@pytest.fixture
def car(tmp_path: Path) -> str:
    write_session(tmp_path / "car.h5", SESSION)
    return str(tmp_path / "car.h5")


def exported(session: Session, path: Path, *options: str) -> Path:
    """Export a session by the command."""
    source = path.with_name("session.h5")
    write_session(source, session)
    assert run(["export", str(source), "--out", str(path), *options]) == 0
    return path


def of_group(*groups: SampleGroup) -> Session:
    return replace(SESSION, runs=(replace(SESSION.runs[0], groups=groups),))


def test_mf4(tmp_path: Path, car: str) -> None:

    assert run(["export", car, "--format", "mf4"]) == 0
    with asammdf.MDF(tmp_path / "car.mf4") as mdf:
        groups: list[Any] = list(mdf.groups)
        named = {group.channel_group.acq_name: i for i, group in enumerate(groups)}
        start_ns = START_NS // 1_000_000_000 * 1_000_000_000
        assert mdf.header.start_time.timestamp() == start_ns / 1e9
        for one in SESSION.runs:
            for group in one.groups:
                number = named[f"{one.label}/{group.name}"]
                for name, values in group.values.items():
                    got = mdf.get(name, group=number)
                    assert_array_equal(got.samples, values)
                    assert got.unit == UNITS[name]
                    t0_s = (one.t0_ns - start_ns) * 1e-9
                    assert_allclose(got.timestamps - t0_s, group.time_s, atol=1e-12)
                assert_array_equal(mdf.get("quality", group=number).samples, group.quality)
                assert_array_equal(mdf.get("t_ns", group=number).samples, group.t_ns)


def test_mat(tmp_path: Path, car: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", car, "--format", "mat"]) == 0
    assert "200 raw frames are left out: use blf, asc or log" in capsys.readouterr().err
    read = loadmat(tmp_path / "car.mat", simplify_cells=True)
    assert list(read["runs"]) == [one.label for one in SESSION.runs]
    for one in SESSION.runs:
        got = read["runs"][one.label]
        assert (got["mass_state"], got["status"]) == ("baseline", "rejected")
        assert (got["t0_ns"], got["bump_s"]) == (START_NS, 0.2)
        for group in one.groups:
            assert_array_equal(got[group.name]["t"], group.time_s)
            assert_array_equal(got[group.name]["t_ns"], group.t_ns)
            assert_array_equal(got[group.name]["quality"], group.quality)
            for name, values in group.values.items():
                assert_array_equal(got[group.name][name], values)
                assert got[group.name]["units"][name] == UNITS[name]
    assert read["channels"]["hub_fl"]["corner"] == "FL"
    assert read["vehicle"]["t_r_m"] == 0.75


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ",")])
def test_csv(tmp_path: Path, car: str, separator: str, point: str) -> None:
    import pandas as pd

    assert run(["export", car, "--format", "csv", "--decimal", point]) == 0
    assert {path.name for path in tmp_path.glob("*.csv")} == set(CSV_FILES)
    group = SESSION.runs[0].groups[0]
    table = pd.read_csv(tmp_path / CSV_FILES[0], sep=separator, decimal=point)
    assert list(table) == ["time_s", "hub_fl [m/s2]", "hub_fr [m/s2]", "quality"]
    for name, values in (("time_s", group.time_s), ("quality", group.quality)):
        assert_array_equal(table[name], values)
    for name, values in group.values.items():
        assert_array_equal(table[f"{name} [m/s2]"], values)
    cells = (tmp_path / CSV_FILES[1]).read_text().splitlines()[1].split(separator)
    assert cells == [f"0{point}0", f"9{point}75", f"0{point}25", "0"]
    assert (tmp_path / CSV_FILES[0]).read_text().splitlines()[8].split(separator)[2] == ""


def test_names_in_csv_are_no_formulas_and_lead_to_no_other_folder(tmp_path: Path) -> None:
    imu = SESSION.runs[0].groups[1]
    imu = replace(imu, name="../../x", values={"=1+1": imu.values["az"]})
    channels = (Channel("=1+1", Quantity.BODY_ACCELERATION),)
    session = replace(of_group(imu), channels=channels)
    (path,) = export_session(session, tmp_path / "car.csv", ExportFormat.CSV).paths
    assert path == tmp_path / "car_baseline_roll_1_______x.csv"
    assert path.read_text().startswith("time_s,'=1+1 [m/s2],quality\n")
    twice = of_group(imu, replace(imu, name="..:..|x"))
    with pytest.raises(InputError, match="the file of two runs"):
        export_session(twice, tmp_path / "two.csv", ExportFormat.CSV)


def test_parquet(tmp_path: Path, car: str) -> None:
    import pandas as pd

    assert run(["export", car, "--format", "parquet"]) == 0
    table = pd.read_parquet(tmp_path / "car.parquet")
    assert list(table.columns) == ["run", "group", "status", "time_s", "t_ns", "quality", *UNITS]
    for one in SESSION.runs:
        for group in one.groups:
            rows = table[(table["run"] == one.label) & (table["group"] == group.name)]
            assert_array_equal(rows["time_s"], group.time_s)
            assert_array_equal(rows["t_ns"], group.t_ns)
            assert_array_equal(rows["quality"], group.quality)
            assert set(rows["status"]) == {"rejected"}
            for name in UNITS:
                assert_array_equal(rows[name], group.values.get(name, np.full(len(rows), np.nan)))
    assert {name: table.attrs["units"][name] for name in UNITS} == UNITS


def test_uff(tmp_path: Path) -> None:
    """Kinds of the format: 0 unknown, 8 displacement, 11 velocity, 12 acceleration, 17 time."""
    hub, imu = SESSION.runs[0].groups
    more = {"s": np.array([1.0, 2.0, 3.0]), "v": np.arange(3.0), "roll": np.zeros(3)}
    imu = replace(imu, values={**imu.values, **more})
    travel = Channel("s", Quantity.SUSPENSION_TRAVEL, "m", corner=Corner.FRONT_RIGHT)
    unused = Channel("v", Quantity.UNUSED, "V")
    roll = Channel("roll", Quantity.ROLL_ACCELERATION, "rad/s2")
    channels = (*SESSION.channels, travel, unused, roll)
    path = exported(replace(of_group(hub, imu), channels=channels), tmp_path / "car.uff")
    units, *records = pyuff.UFF(str(path)).read_sets()
    assert (units["type"], units["units_code"], units["length"], units["force"]) == (164, 1, 1, 1)
    fl, fr, az, *_ = records
    assert (fl["id1"], fl["ordinate_axis_units_lab"]) == ("hub_fl", "m/s2")
    assert fl["id2"].strip() == "baseline_roll_1 HUB_Front (rejected)"
    assert fl["id3"].strip() == "14-NOV-23 22:13:20"
    assert (fl["abscissa_axis_units_lab"], fl["abscissa_spec_data_type"]) == ("s", 17)
    assert (fl["abscissa_spacing"], az["abscissa_spacing"]) == (0, 1)
    assert_array_equal(fl["x"], hub.time_s)
    assert_array_equal(fl["data"], hub.values["hub_fl"])
    assert_array_equal(fr["x"], np.delete(hub.time_s, 7))  # that one is missing
    assert_array_equal(az["x"], imu.time_s)
    assert_array_equal(az["data"], imu.values["az"])
    places = [(r["rsp_node"], r["rsp_dir"], r["ordinate_spec_data_type"]) for r in records]
    assert places == [
        (1, 3, 12),
        (2, 3, 12),
        (103, 3, 12),
        (104, 5, 11),
        (2, 3, 8),
        (106, 0, 0),
        (107, 4, 12),
    ]
    raw = path.read_bytes()
    sizes = [int(line[31:43]) for line in raw.split(b"\n") if line.startswith(b"    58b")]
    assert sizes == [500 * 16, 499 * 16, *[24] * 5]


@pytest.mark.parametrize("form", list(ExportFormat))
def test_files_are_whole_or_absent_and_never_overwritten(
    tmp_path: Path, form: ExportFormat, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"car.{form}"
    first = export_session(SESSION, path, form).paths
    before = {place: place.read_bytes() for place in first}
    with pytest.raises(InputError, match="exists already"):
        export_session(SESSION, path, form)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(InputError, match="No space left"):
            export_session(SESSION, path, form, force=True)
    assert {place: place.read_bytes() for place in tmp_path.iterdir()} == before
    export_session(SESSION, path, form, force=True)
    assert set(tmp_path.iterdir()) == set(first)


def test_what_the_system_or_a_library_refuses_is_one_line(tmp_path: Path) -> None:
    """SciPy says `Reader needs file name or open file-like object` of a name that is too long.

    The name of the file fits, but not that of the hidden file that is written first.
    """
    with pytest.raises(InputError, match="cannot be written: File name too long"):
        export_session(SESSION, tmp_path / f"{'x' * 246}.mat", ExportFormat.MAT)
    early = replace(SESSION, runs=(replace(SESSION.runs[0], t0_ns=-(2**62)),))
    with pytest.raises(InputError, match=r"car\.mf4: cannot be written"):
        export_session(early, tmp_path / "car.mf4", ExportFormat.MF4)
    empty = replace(SESSION, runs=(replace(SESSION.runs[2], groups=()),))
    for form in (ExportFormat.CSV, ExportFormat.BLF):
        with pytest.raises(InputError, match="hold no"):
            export_session(empty, tmp_path / "car.x", form)
    assert not list(tmp_path.iterdir())


def test_exported_logs_are_read_as_any_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench, first = tmp_path / "bench.toml", tmp_path / "first.h5"
    bench.write_text(BENCH.replace("pre_s = 0.1", "pre_s = 0.3"))  # rest enough before each bump
    write_log(tmp_path / "all.log", bumps(small_codec(), 4))
    assert run(["import", str(tmp_path / "all.log"), str(bench), "--out", str(first)]) == 0
    one = read_session(first)
    for form in ("blf", "asc", "log"):
        log, second = tmp_path / f"car.{form}", tmp_path / f"{form}.h5"
        assert run(["export", str(first), "--out", str(log)]) == 0
        assert run(["import", str(log), str(bench), "--out", str(second)]) == 0
        capsys.readouterr()
        two = read_session(second)
        assert [r.label for r in two.runs] == [r.label for r in one.runs], form
        for before, after in zip(one.runs, two.runs, strict=True):
            assert abs(after.t0_ns - before.t0_ns) <= 1000
            assert after.losses == before.losses


def test_a_notebook_is_written_once_and_its_folder_is_created(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    target = tmp_path / "a.ipynb"
    out, _ = said(capsys, "notebook", "--out", str(target), code=0)
    assert out.startswith(str(target))
    assert json.loads(target.read_text())["nbformat"] == 4
    out, _ = said(capsys, "notebook", "--out", str(target), "--force", "--json", code=0)
    assert json.loads(out) == {"files": [str(target)]}
    assert "exists" in said(capsys, "notebook", "--out", str(target), code=2)[1]
    assert list(tmp_path.iterdir()) == [target]
    said(capsys, "notebook", "--out", str(tmp_path / "new" / "folder" / "a.ipynb"), code=0)
    below = str(target / "b.ipynb")  # a file is no folder
    assert "name another folder" in said(capsys, "notebook", "--out", below, code=2)[1]


def test_a_decoding_anew_needs_what_was_corrected(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    bench = str(tmp_path / "bench.toml")
    log = str(write_log(tmp_path / "all.log", bumps(small_codec(), 4)))
    session = str(tmp_path / "s.h5")
    said(capsys, "import", log, bench, "--out", session, code=0)
    assert "neither a DBC nor" in said(capsys, "redecode", session, code=2)[1]
    out, _ = said(capsys, "redecode", session, bench, code=0)
    assert out.splitlines()[-1] == f"session: {tmp_path / 's_redecoded.h5'}"
    assert out.count("accepted") == 4
    (dbc := tmp_path / "new.dbc").write_text(shipped_dbc())
    bare = replace(daq.read_session(session), provenance={})
    daq.write_session(tmp_path / "bare.h5", bare)
    words = ["redecode", str(tmp_path / "bare.h5"), "--dbc", str(dbc)]
    assert "holds no bench.toml" in said(capsys, *words, code=2)[1]
