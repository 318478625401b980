"""Arrays, tables and structs of HDF5 and MATLAB files: which are columns, under which names."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from daq.errors import InputError
from daq.formats.columns.hdf5 import _datasets

from .channel_files import read_here

ROW = np.arange(300.0)
WIDE = np.arange(300.0 * 256).reshape(300, 256)
DATASETS: dict[str, tuple[Any, dict[str, float]]] = {
    "one dimension": (ROW, {"x": 1}),
    "a row": (ROW.reshape(1, -1), {"x": 1}),
    "a column": (ROW.reshape(-1, 1), {"x": 1}),
    "a pile": (ROW.reshape(1, -1, 1), {"x": 1}),
    "a tall table": (np.column_stack([ROW, -ROW]), {"x:1": 1, "x:2": -1}),
    "a broad table": (np.stack([ROW, -ROW]), {"x:1": 1, "x:2": -1}),
    "a square": (np.array([[1.0, 2.0], [3.0, 4.0]]), {"x:1": 3, "x:2": 4}),
    "whole numbers": (np.arange(5, dtype="i4"), {"x": 1}),
    "unsigned": (np.arange(5, dtype="u1"), {"x": 1}),
    "big-endian": (np.arange(5, dtype=">f4"), {"x": 1}),
}


@pytest.mark.parametrize("name", DATASETS)
def test_columns_of_hdf5(tmp_path: Path, name: str) -> None:
    values, expected = DATASETS[name]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["x"] = values
    held = read_here(tmp_path / "a.h5").columns
    assert {each: float(column.values[1]) for each, column in held.items()} == expected


@pytest.mark.parametrize("name", DATASETS)
def test_columns_of_matlab(tmp_path: Path, name: str) -> None:
    values, expected = DATASETS[name]
    savemat(tmp_path / "a.mat", {"x": values})
    held = read_here(tmp_path / "a.mat").columns
    assert {each: float(column.values[1]) for each, column in held.items()} == expected


def test_tables_are_not_wider_than_256_columns_and_no_images(tmp_path: Path) -> None:
    wider = np.zeros((300, 257))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["wide"], file["wider"], file["cube"] = WIDE, wider, np.zeros((2, 2, 2))
        file["complex"], file["text"] = np.zeros(3, complex), np.array([b"a", b"b"])
        file["empty"] = h5py.Empty("f8")
        file["char"] = np.zeros(5, "u2")
        file["char"].attrs["MATLAB_class"] = np.bytes_("char")
        file["double"] = np.zeros(5)
        file["double"].attrs["MATLAB_class"] = np.bytes_("double")
        file["#refs#/a"] = np.zeros(5)
        file["refs"] = np.zeros(5)
    savemat(tmp_path / "a.mat", {"wide": WIDE, "wider": wider, "cube": np.zeros((2, 2, 2))})
    wide = {f"wide:{n}" for n in range(1, 257)}
    assert set(read_here(tmp_path / "a.h5").columns) == {*wide, "double", "refs"}
    assert set(read_here(tmp_path / "a.mat").columns) == wide
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["cube"] = np.zeros((2, 2, 2))
    with pytest.raises(InputError, match="no column of numbers"):
        read_here(tmp_path / "b.h5")


@pytest.mark.parametrize("key", ["units", "unit", "Unit", "Units"])
def test_units_and_clocks_of_hdf5(tmp_path: Path, key: str) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a/x"], file["y"] = ROW, ROW
        file["a/x"].attrs[key] = "g"
        file["y"].attrs[key] = np.bytes_("µm".encode())
    held = read_here(tmp_path / "a.h5").columns
    assert [(each, c.unit, c.clock) for each, c in held.items()] == [
        ("a/x", "g", "a"),
        ("y", "µm", ""),
    ]


def test_a_scale_of_hdf5_dates_the_datasets_along_it(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["g/t"], file["g/x"] = ROW * 2, ROW
        file["g/t"].make_scale()
        file["g/x"].dims[0].attach_scale(file["g/t"])
    held = read_here(tmp_path / "a.h5")
    assert held.columns["g/x"].clock == "g/t"
    assert held.columns["g/t"].clock == "g"
    assert held.times_s["g/t"].tolist() == (ROW * 2).tolist()


@pytest.mark.parametrize("offset", [0, 512, 1024, 2048])
def test_hdf5_behind_a_head_of_its_maker(tmp_path: Path, offset: int) -> None:
    with h5py.File(tmp_path / "a.h5", "w", userblock_size=offset) as file:
        file["x"] = ROW
    if offset:
        with (tmp_path / "a.h5").open("r+b") as raw:
            raw.write(b"made by somebody")
    assert list(read_here(tmp_path / "a.h5").columns) == ["x"]


def test_structs_of_matlab(tmp_path: Path) -> None:
    deep: Any = ROW
    for _ in range(12):
        deep = {"s": deep}
    savemat(
        tmp_path / "a.mat",
        {
            "rec": {"t": ROW, "x": -ROW, "units": {"x": "g", "t": 5.0}},
            "box": {"v": ROW, "unit": "mm"},
            "list": [{"name": "front", "v": ROW}, {"v": ROW}, {"Name": "rear", "v": ROW}],
            "words": "text",
            "one": 5.0,
            "deep": deep,
            "deeper": {"s": deep},
        },
    )
    held = read_here(tmp_path / "a.mat").columns
    expected = {
        "rec/t": ("", "rec"),
        "rec/x": ("g", "rec"),
        "box/v": ("mm", "box"),
        "list/front/v": ("", "list/front"),
        "list/2/v": ("", "list/2"),
        "list/rear/v": ("", "list/rear"),
        "deep" + "/s" * 12: ("", "deep" + "/s" * 11),
    }
    assert {name: (c.unit, c.clock) for name, c in held.items()} == expected


@pytest.mark.parametrize(("objects", "refused"), [(100_000, False), (100_001, True)])
def test_a_file_of_more_than_a_hundred_thousand_objects_is_refused(
    objects: int, refused: bool
) -> None:
    def visititems(visit: Callable[[str, object], None]) -> None:
        for _ in range(objects):
            visit("group", None)

    with pytest.raises(InputError, match="over 100000 objects") if refused else nullcontext():
        assert _datasets(SimpleNamespace(visititems=visititems), "a.h5") == {}
