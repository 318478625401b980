"""Session files written and read again, as others open them, and their outlines for lists."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import daq.session
from daq.runs import Event
from daq.session import read_session, write_session
from daq.sessions import Session
from daq.vehicle import MassState
from dbc import FrameBatch
from dbc.words import InputError

from ..small_session import small_file, small_session


@pytest.fixture
def session() -> Session:
    return small_session()


def plain(value: Any) -> Any:
    """Return a noun as values that are equal if it is the same, arrays bit for bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return type(value), [plain(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, Mapping):
        return [(name, plain(each)) for name, each in value.items()]
    if isinstance(value, tuple):
        return [plain(each) for each in value]
    return repr(value)


def test_round_trip(tmp_path: Path, session: Session) -> None:
    path = tmp_path / "car.h5"
    write_session(path, session)
    again = read_session(path)
    assert dict(again.provenance) == dict(session.provenance)
    assert plain(again) == plain(replace(session, provenance=again.provenance))
    assert [p.name for p in tmp_path.iterdir()] == ["car.h5"]


def test_a_full_disk_is_one_error_and_no_crash(tmp_path: Path) -> None:
    # A limit on the size of files stands for a disk that is full; what HDF5 does after a failed
    # write, it does when the process ends.
    golden = Path(__file__).parents[2] / "golden" / "session_v1_2026-11.h5"
    script = f"""
import resource, signal, sys
from daq import InputError, read_session, write_session
session = read_session({str(golden)!r})
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    write_session({str(tmp_path / "full.h5")!r}, session)
except InputError as error:
    print(error)
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert "cannot be written" in ran.stdout
    assert list(tmp_path.iterdir()) == []


# Other programs, and the page that describes the file ---------------------------------------------


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "car.h5").write_bytes(small_file())
    return tmp_path / "car.h5"


@pytest.mark.long  # these imports take longer than all else here
def test_xarray_and_netcdf_open_every_group(path: Path) -> None:
    import netCDF4
    import xarray

    session = small_session()
    tree = xarray.open_groups(path, engine="h5netcdf")
    for number, run in enumerate(session.runs, start=1):
        for group in run.groups:
            data = tree[f"/runs/r{number:03d}_{run.label}/{group.name}"]
            assert_array_equal(data["time"], group.time_s)
            assert_array_equal(data["t_ns"], group.t_ns)
            for name, values in group.values.items():
                assert data[name].dims == ("time",)
                assert_array_equal(data[name], values)
                assert data[name].attrs["units"] == ("rad/s" if name == "pitch" else "m/s2")
    assert_array_equal(tree["/mass_states/added"]["delta_mass"], np.eye(7))
    for data in tree.values():
        data.close()
    with netCDF4.Dataset(path) as file:
        assert file.Conventions == "CF-1.10"
        raw = file["runs/r001_baseline_roll_1/raw_bus0"]
        frames = session.runs[0].frames
        assert_array_equal(raw["data"][:], frames.data[frames.bus == 0])
        assert raw["data"].dimensions == ("frame", "byte")


def test_the_page_names_everything_that_a_file_holds(path: Path) -> None:
    page = re.findall(r"\w+", (files(daq.session) / "schema.txt").read_text())
    own = {"hub_fl", "hub_fr", "az", "pitch", "r001_baseline_roll_1", "HUB_Front", "A_IMU"}
    own |= {"r002_baseline_roll_2", "r003_baseline_roll_3", "baseline", "added"}
    own |= {"raw_bus0", "raw_bus1"}  # raw_busN there
    hdf5 = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST"}
    names: set[str] = set()
    with h5py.File(path) as file:
        names |= set(file.attrs)

        def visit(name: str, item: h5py.Group | h5py.Dataset) -> None:
            names.add(name.rsplit("/", 1)[-1])
            names.update(item.attrs)

        file.visititems(visit)
    names = {name for name in names if not name.startswith("provenance_")}
    assert names - own - hdf5 - set(page) == set()


# Names and texts ----------------------------------------------------------------------------------

SESSION = small_session()
_RUN = replace(SESSION.runs[0], groups=SESSION.runs[0].groups[1:], frames=FrameBatch.empty())
BARE = replace(SESSION, runs=(_RUN,), mass_states=SESSION.mass_states[:1], provenance={})


def _renamed(kind: str, name: str) -> Session:
    """Return a session in which a channel, a group or a mass state has another name."""
    run = BARE.runs[0]
    if kind == "state":
        return replace(BARE, mass_states=(*BARE.mass_states, MassState(name)))
    group = run.groups[0]
    if kind == "group":
        return replace(BARE, runs=(replace(run, groups=(replace(group, name=name),)),))
    channels = tuple(replace(c, name=name) if c.name == "az" else c for c in BARE.channels)
    values = {name if n == "az" else n: v for n, v in group.values.items()}
    runs = (replace(run, groups=(replace(group, values=values),)),)
    return replace(BARE, channels=channels, runs=runs)


@pytest.mark.parametrize("kind", ["channel", "group", "state"])
def test_a_name_has_1_to_64_printable_bytes(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "car.h5"
    for name in ("q" * 65, "ä" * 33, "", "a/b", "a.b", "a\tb"):
        with pytest.raises(InputError, match="cannot be written"):
            write_session(path, _renamed(kind, name))
    session = _renamed(kind, "ä b-" + "q" * 59)
    write_session(path, session)
    found = read_session(path)
    assert [channel.name for channel in found.channels] == [c.name for c in session.channels]
    assert {state.name for state in found.mass_states} == {s.name for s in session.mass_states}
    assert [g.name for g in found.runs[0].groups] == [g.name for g in session.runs[0].groups]


@pytest.mark.parametrize(("text", "good"), [("ä" * 80, True), ("ä" * 80 + "b", False)])
def test_a_text_of_an_event_has_160_bytes(tmp_path: Path, text: str, good: bool) -> None:
    run = replace(BARE.runs[0], events=(Event(1, "note", 0.0, text),))
    session = replace(BARE, runs=(run,))
    if good:
        write_session(tmp_path / "car.h5", session)
        assert read_session(tmp_path / "car.h5").runs[0].events == run.events
        return
    with pytest.raises(InputError, match="longer than 160 bytes"):
        write_session(tmp_path / "car.h5", session)


def test_the_first_group_of_the_first_run_is_the_default(tmp_path: Path) -> None:
    path = tmp_path / "car.h5"
    write_session(path, SESSION)
    with h5py.File(path) as file:
        assert file.attrs["default"] == "runs/r001_baseline_roll_1/HUB_Front"
        hub = file["runs/r002_baseline_roll_2/HUB_Front"]
        assert hub.attrs["signal"] == "hub_fl"
        assert hub.attrs["auxiliary_signals"].tolist() == [b"hub_fr"]
        assert (hub.attrs["axes"], hub.attrs["channels"]) == ("time", "hub_fl\nhub_fr")
        assert hub["quality"].attrs["flag_masks"].tolist() == [1, 2, 4, 8, 16, 32]
        assert len(hub["quality"].attrs["flag_meanings"].split()) == 6
        assert hub["hub_fl"].attrs["dbc_signal"] == "HUB_Front.a"
        assert hub["hub_fl"].attrs["quantity"] == "hub_acceleration"
        assert hub["time"].attrs["units"] == "s"
        assert hub["t_ns"].attrs["units"] == "ns"
        assert file["mass_states/added"].attrs["order"] == 1
    none = replace(BARE, runs=(replace(BARE.runs[0], groups=()), *SESSION.runs[1:2]))
    write_session(path, none)
    with h5py.File(path) as file:
        assert "default" not in file.attrs
