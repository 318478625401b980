"""The session file as others open it: xarray, netCDF-C, and the page that describes it."""

import re
from pathlib import Path
from typing import Literal

import h5py
import netCDF4
import numpy as np
import pytest
from numpy.testing import assert_array_equal

import daq.session
from daq.session import write_session

from ..small_session import small_session


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_session(tmp_path / "car.h5", small_session())
    return tmp_path / "car.h5"


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_xarray_opens_every_group(path: Path, engine: Literal["h5netcdf", "netcdf4"]) -> None:
    import xarray

    session = small_session()
    tree = xarray.open_groups(path, engine=engine)
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


def test_the_page_names_everything_that_a_file_holds(path: Path) -> None:
    page = re.findall(r"\w+", daq.session.__doc__ or "")
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


def test_the_page_gives_the_types(path: Path) -> None:
    page = daq.session.__doc__ or ""
    with h5py.File(path) as file:
        for place, name, dtype in [
            ("channels", "signal", "S128"),
            ("channels", "low_pass_order", "i4"),
            ("runs/r001_baseline_roll_1/events", "text", "S160"),
            ("runs/r001_baseline_roll_1/raw_bus0", "flags", "u2"),
        ]:
            assert file[place][name].dtype == np.dtype(dtype)
            assert f"{name} {dtype}" in page
    assert len(page.splitlines()) < 80


def test_netcdf_c_opens_it(path: Path) -> None:
    session = small_session()
    with netCDF4.Dataset(path) as file:
        assert file.Conventions == "CF-1.10"
        hub = file["runs/r001_baseline_roll_1/HUB_Front"]
        assert hub["hub_fl"].units == "m/s2"
        assert_array_equal(hub["hub_fl"][:], session.runs[0].groups[0].values["hub_fl"])
        raw = file["runs/r001_baseline_roll_1/raw_bus0"]
        frames = session.runs[0].frames
        assert_array_equal(raw["data"][:], frames.data[frames.bus == 0])
        assert raw["data"].dimensions == ("frame", "byte")
