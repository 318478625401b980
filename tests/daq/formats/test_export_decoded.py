"""Decoded channels as other tools read them: values, times, names, units."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import pyuff
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat
from sdypy_sep005.sep005 import assert_sep005

from daq.channels import Channel, Quantity
from daq.errors import InputError
from daq.formats.export import (
    CsvStyle,
    ExportFormat,
    ModeShapes,
    export_session,
    format_of,
    sep005_channels,
)
from daq.sessions import Session
from daq.vehicle import VehicleGeometry

from ..small_session import START_NS, small_session

if TYPE_CHECKING:
    import pandas as pd

UNITS = {"hub_fl": "m/s2", "hub_fr": "m/s2", "az": "m/s2", "pitch": "rad/s"}


@pytest.fixture
def session() -> Session:
    return small_session()


def _export(session: Session, path: Path, **options: Any) -> list[Path]:
    return list(export_session(session, path, format_of(path), **options).paths)


def test_mf4(tmp_path: Path, session: Session) -> None:
    import asammdf

    _export(session, tmp_path / "car.mf4")
    with asammdf.MDF(tmp_path / "car.mf4") as mdf:
        groups: list[Any] = list(mdf.groups)
        named = {group.channel_group.acq_name: i for i, group in enumerate(groups)}
        start_ns = START_NS // 1_000_000_000 * 1_000_000_000
        assert mdf.header.start_time.timestamp() == start_ns / 1e9
        for run in session.runs:
            for group in run.groups:
                for name, values in group.values.items():
                    got = mdf.get(name, group=named[f"{run.label}/{group.name}"])
                    assert_array_equal(got.samples, values)
                    assert got.unit == UNITS[name]
                    t0_s = (run.t0_ns - start_ns) * 1e-9
                    assert_allclose(got.timestamps - t0_s, group.time_s, atol=1e-12)
                quality = mdf.get("quality", group=named[f"{run.label}/{group.name}"])
                assert_array_equal(quality.samples, group.quality)


def test_mat(tmp_path: Path, session: Session) -> None:
    _export(session, tmp_path / "car.mat")
    held = loadmat(tmp_path / "car.mat", simplify_cells=True)
    assert list(held["runs"]) == [run.label for run in session.runs]
    for run in session.runs:
        got = held["runs"][run.label]
        assert (got["mass_state"], got["status"]) == ("baseline", "rejected")
        assert got["t0_ns"] == START_NS
        for group in run.groups:
            assert_array_equal(got[group.name]["t"], group.time_s)
            assert_array_equal(got[group.name]["t_ns"], group.t_ns)
            assert_array_equal(got[group.name]["quality"], group.quality)
            for name, values in group.values.items():
                assert_array_equal(got[group.name][name], values)
                assert got[group.name]["units"][name] == UNITS[name]
    assert held["channels"]["hub_fl"]["corner"] == "FL"
    assert held["vehicle"]["t_r_m"] == 0.75


def test_names_that_matlab_has_not(tmp_path: Path, session: Session) -> None:
    names = {"hub_fl": "1 hub (fl)", "hub_fr": "1 hub [fl]", "az": "t", "pitch": "x" * 64}
    channels = tuple(replace(c, name=names[c.name]) for c in session.channels)
    groups = tuple(
        replace(g, values={names[n]: v for n, v in g.values.items()})
        for g in session.runs[0].groups
    )
    odd = replace(session, channels=channels, runs=(replace(session.runs[0], groups=groups),))
    _export(odd, tmp_path / "car.mat")
    hub, imu = (
        loadmat(tmp_path / "car.mat", simplify_cells=True)["runs"]["baseline_roll_1"][name]
        for name in ("HUB_Front", "A_IMU")
    )
    assert_array_equal(hub["x1_hub__fl_"], groups[0].values["1 hub (fl)"])
    assert_array_equal(hub["x1_hub__fl__2"], groups[0].values["1 hub [fl]"])
    assert_array_equal(imu["t"], groups[1].time_s)
    assert_array_equal(imu["t_2"], groups[1].values["t"])
    assert_array_equal(imu["x" * 63], groups[1].values["x" * 64])


@pytest.mark.parametrize(
    ("style", "point"), [(CsvStyle(), "."), (CsvStyle(";", ","), ","), (CsvStyle("\t"), ".")]
)
def test_csv(tmp_path: Path, session: Session, style: CsvStyle, point: str) -> None:
    import pandas as pd

    paths = _export(session, tmp_path / "car.csv", style=style)
    assert paths[0] == tmp_path / "car_baseline_roll_1_HUB_Front.csv"
    assert len(paths) == 7  # the last one describes the session
    assert sorted(tmp_path.iterdir()) == sorted(paths)
    group = session.runs[0].groups[0]
    with paths[0].open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream, delimiter=style.separator)
    assert head == ["time_s", "hub_fl [m/s2]", "hub_fr [m/s2]", "quality"]
    assert rows[7][2] == ""
    assert all("." not in cell for row in rows for cell in row) == (point == ",")
    table = pd.read_csv(paths[0], sep=style.separator, decimal=point)
    assert_array_equal(table["time_s"], group.time_s)
    assert_array_equal(table["hub_fl [m/s2]"], group.values["hub_fl"])
    assert_array_equal(table["hub_fr [m/s2]"], group.values["hub_fr"])
    assert_array_equal(table["quality"], group.quality)


@pytest.mark.parametrize("style", [(",", ","), ("ab", "."), ("1", "."), (";", "x"), ('"', ".")])
def test_csv_that_no_program_could_read(style: tuple[str, str]) -> None:
    with pytest.raises(InputError, match=r"--separator|--decimal"):
        CsvStyle(*style)


def _same_rows(table: pd.DataFrame, session: Session) -> None:
    for run in session.runs:
        for group in run.groups:
            rows = table[(table["run"] == run.label) & (table["group"] == group.name)]
            assert_array_equal(rows["time_s"], group.time_s)
            assert_array_equal(rows["t_ns"], group.t_ns)
            assert_array_equal(rows["quality"], group.quality)
            assert set(rows["status"]) == {"rejected"}
            for name in UNITS:
                assert_array_equal(rows[name], group.values.get(name, np.full(len(rows), np.nan)))


def test_parquet(tmp_path: Path, session: Session) -> None:
    import pandas as pd
    import pyarrow.parquet

    _export(session, tmp_path / "car.parquet")
    table = pd.read_parquet(tmp_path / "car.parquet")
    assert list(table.columns) == ["run", "group", "status", "time_s", "t_ns", "quality", *UNITS]
    _same_rows(table, session)
    assert table.attrs["units"]["az"] == "m/s2"
    schema = pyarrow.parquet.read_schema(tmp_path / "car.parquet")
    assert {name: schema.field(name).metadata[b"unit"].decode() for name in UNITS} == UNITS


def test_dataframe_and_xarray(session: Session) -> None:
    table = session.to_dataframe()
    _same_rows(table, session)
    assert table.attrs["units"] == {"time_s": "s", "t_ns": "ns", **UNITS}
    assert replace(session, runs=()).to_dataframe().empty
    tree = session.to_xarray()
    hub = tree["baseline_roll_1/HUB_Front"]
    assert_array_equal(hub["hub_fl"], session.runs[0].groups[0].values["hub_fl"])
    assert_array_equal(hub["time"], session.runs[0].groups[0].time_s)
    assert (hub["hub_fl"].attrs["units"], hub["time"].attrs["units"]) == ("m/s2", "s")
    assert tree["baseline_roll_2"].attrs["repeat"] == 2
    assert len(tree.children) == 3


def test_sep005(tmp_path: Path, session: Session) -> None:
    assert_sep005(sep005_channels(session))
    _export(session, tmp_path / "car.json")
    channels = json.loads((tmp_path / "car.json").read_text())
    assert_sep005(channels)
    assert len(channels) == 3 * 4
    first = channels[0]
    group = session.runs[0].groups[0]
    assert first["name"] == "baseline_roll_1/hub_fl"
    assert (first["unit_str"], first["quantity"]) == ("m/s2", "a")
    assert first["start_timestamp"] == "2023-11-14T22:13:20.123456+00:00"
    assert_array_equal(first["data"], group.values["hub_fl"])
    assert_array_equal(first["time"], group.time_s)
    assert channels[1]["data"][7] is None
    assert channels[3]["quantity"] == "v"


def test_uff(tmp_path: Path, session: Session) -> None:
    travel = Channel("s", Quantity.SUSPENSION_TRAVEL, "m", corner=session.channels[1].corner)
    hub, imu = session.runs[0].groups
    even = replace(imu, values={**imu.values, "s": np.array([1.0, 2.0, 3.0])})
    session = replace(
        session,
        channels=(*session.channels, travel),
        runs=(replace(session.runs[0], groups=(hub, even)),),
    )
    # A rigid body that turns about y: z = -(x + a), with a = 1.25 m.
    turning = np.array([[0.0], [1.0 + 2.0j], [0.0], [1.0], [2.0], [3.0], [4.0j]])
    geometry = session.vehicle.geometry
    assert geometry is not None
    modes = ModeShapes("added", geometry, np.array([-1.0 + 8.0j]), turning)
    _export(session, tmp_path / "car.uff", modes=(modes,))
    file = pyuff.UFF(str(tmp_path / "car.uff"))
    assert file.get_set_types().tolist() == [164, 15, 82, 82, 82, 58, 58, 58, 58, 58, 55]
    units, nodes, *rest = file.read_sets()
    assert (units["units_code"], units["length"], units["force"]) == (1, 1.0, 1.0)

    labels = [int(label) for label in nodes["node_nums"]]
    places = dict(zip(labels, zip(nodes["x"], nodes["y"], nodes["z"], strict=True), strict=True))
    assert places[11] == (0.0, 0.74, 0.0)  # the hub at the front left
    assert places[14] == (-2.76, -0.75, 0.0)
    assert places[5][:2] == (-1.25, 0.0)
    assert places[103][:2] == (-1.0, 0.1)
    assert {int(node) for line in rest[:3] for node in line["nodes"]} <= {0, *labels}

    fl, fr, az, pitch, s = rest[3:8]
    assert (fl["id1"], fl["ordinate_axis_units_lab"]) == ("hub_fl", "m/s2")
    assert (fl["rsp_node"], fl["rsp_dir"], fl["ordinate_spec_data_type"]) == (11, 3, 12)
    assert (fl["abscissa_spacing"], fl["abscissa_axis_units_lab"]) == (0, "s")
    assert_array_equal(fl["x"], hub.time_s)
    assert_array_equal(fl["data"], hub.values["hub_fl"])
    assert_array_equal(fr["x"], np.delete(hub.time_s, 7))  # that one is missing
    assert (az["rsp_node"], az["rsp_dir"]) == (103, 3)
    assert az["abscissa_spacing"] == 1
    assert_array_equal(az["x"], imu.time_s)
    assert_array_equal(az["data"], imu.values["az"])
    assert (pitch["rsp_node"], pitch["rsp_dir"], pitch["ordinate_spec_data_type"]) == (5, 5, 11)
    assert (s["rsp_node"], s["ref_node"], s["ordinate_spec_data_type"]) == (12, 2, 8)

    mode = rest[8]
    assert mode["eig"] == -1.0 + 8.0j
    shape = dict(zip(mode["node_nums"].tolist(), mode["r3"], strict=True))
    assert shape[11] == 1.0
    assert shape[14] == 4.0j
    assert_allclose(shape[1], -1.25 * (1 + 2j))
    assert_allclose(shape[103], -0.25 * (1 + 2j))
    assert_allclose(shape[5], 0.0)
    assert not np.any([mode["r1"], mode["r2"]])  # up and down alone


def test_uff_of_a_car_that_was_not_measured(tmp_path: Path, session: Session) -> None:
    unknown = replace(session, vehicle=replace(session.vehicle, geometry=None))
    path = tmp_path / "car.unv"
    done = export_session(unknown, path, ExportFormat.UFF)
    assert any("wheel positions are not known" in note for note in done.notes)
    assert set(pyuff.UFF(str(path)).get_set_types().tolist()) == {164, 58}
    identified = ModeShapes(
        "baseline", VehicleGeometry(1.0, 1.5, 0.7, 0.8), np.array([1j]), np.ones((7, 1), complex)
    )
    export_session(unknown, path, ExportFormat.UFF, modes=(identified,), force=True)
    nodes = pyuff.UFF(str(path)).read_sets(1)
    assert nodes["x"][nodes["node_nums"].index(13.0)] == -2.5


@pytest.mark.parametrize("form", list(ExportFormat))
def test_files_are_whole_or_absent_and_never_overwritten(
    tmp_path: Path, session: Session, form: ExportFormat, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"car{form.suffix}"
    first = export_session(session, path, form).paths
    before = {place: place.read_bytes() for place in first}
    with pytest.raises(InputError, match="exists already"):
        export_session(session, path, form)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", full)
        with pytest.raises(InputError, match="No space left"):
            export_session(session, path, form, force=True)
    assert {place: place.read_bytes() for place in tmp_path.iterdir()} == before
    export_session(session, path, form, force=True)
    assert set(tmp_path.iterdir()) == set(first)


@pytest.mark.parametrize("form", [ExportFormat.MAT, ExportFormat.PARQUET])
def test_a_refusal_of_the_system_is_in_its_words(
    form: ExportFormat, tmp_path: Path, session: Session
) -> None:
    """SciPy says `Reader needs file name or open file-like object`.

    The name of the file fits, but not that of the hidden file that is written first.
    """
    with pytest.raises(InputError) as caught:
        export_session(session, tmp_path / f"{'x' * 246}.{form}", form)
    assert caught.value.what == "cannot be written: File name too long"


def test_nowhere_to_write(tmp_path: Path, session: Session) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="name another folder"):
        export_session(session, tmp_path / "file" / "car.mat", ExportFormat.MAT)
    with pytest.raises(InputError, match="is a directory"):
        export_session(session, tmp_path, ExportFormat.MAT)
    with pytest.raises(InputError, match=r"\.xls is not an export format"):
        format_of(Path("car.xls"))


def test_names_lead_to_no_other_folder(tmp_path: Path, session: Session) -> None:
    run = replace(session.runs[0], mass_state="../../x\n", groups=session.runs[0].groups[1:])
    path, _ = _export(replace(session, runs=(run,)), tmp_path / "car.csv")
    assert path == tmp_path / "car_______x__roll_1_A_IMU.csv"
    with pytest.raises(InputError, match="the file of two runs"):
        _export(replace(session, runs=(run, replace(run, mass_state="..:..|x\t"))), path)


def test_what_a_library_cannot_write_is_reported_in_one_line(
    tmp_path: Path, session: Session
) -> None:
    early = replace(session.runs[0], t0_ns=-(2**62))
    with pytest.raises(InputError, match=r"car\.mf4: cannot be written"):
        _export(replace(session, runs=(early,)), tmp_path / "car.mf4")
    assert not list(tmp_path.iterdir())
