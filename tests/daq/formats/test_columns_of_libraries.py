"""Columns of MDF, Parquet and MATLAB files: names, units, clocks, and what is no number."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.io import savemat

from daq.errors import InputError
from daq.formats.columns.read import read_columns

if TYPE_CHECKING:
    import asammdf

X = np.arange(3.0)


def _signal(name: str, values: Any = X, start_s: float = 0.0, **more: Any) -> asammdf.Signal:
    import asammdf

    values = np.asarray(values)
    return asammdf.Signal(values, start_s + np.arange(len(values)) / 4, name=name, **more)


def _write(path: Path, groups: Sequence[tuple[str, list[asammdf.Signal]]]) -> None:
    import asammdf

    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.start_time = datetime(2026, 5, 31, 10, 0, 0, 250_001, UTC)
        for name, signals in groups:
            mdf.append(signals, acq_name=name, common_timebase=True)
        mdf.save(path, overwrite=True)


def test_channels_have_the_name_and_the_times_of_their_group(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    _write(
        path,
        [
            ("IMU", [_signal("az", unit="g"), _signal("ax")]),
            ("", [_signal("az", start_s=1.0)]),
            ("IMU", [_signal("az", start_s=2.0)]),
        ],
    )
    held = read_columns(path, ())
    assert held.start_ns == 1_780_221_600_250_001_000
    found = {name: (c.unit, float(held.times_s[c.clock][0])) for name, c in held.columns.items()}
    assert found == {
        "IMU/az": ("g", 0.0),
        "IMU/ax": ("", 0.0),
        "group 1/az": ("", 1.0),
        "IMU (group 2)/az": ("", 2.0),
    }
    assert held.times_s[held.columns["IMU/az"].clock].tolist() == [0.0, 0.25, 0.5]


BEGAN = datetime(2026, 5, 31, 10, tzinfo=UTC)
BEGAN_NS = 1_780_221_600_000_000_000


def test_columns_of_parquet(tmp_path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    arrays = {
        "f8": (pa.array([1.5, 2.5]), [1.5, 2.5]),
        "f2": (pa.array(np.array([1.5, 2.5], "f2")), [1.5, 2.5]),
        "i4": (pa.array([1, 2], pa.int32()), [1, 2]),
        "u1": (pa.array([1, 255], pa.uint8()), [1, 255]),
        "holes": (pa.array([1, None], pa.int64()), [1.0, np.nan]),
        "second": (pa.array([BEGAN, BEGAN], pa.timestamp("s", "UTC")), [BEGAN_NS] * 2),
        "micro": (pa.array([BEGAN, BEGAN], pa.timestamp("us")), [BEGAN_NS] * 2),
        "text": (pa.array(["a", "b"]), None),
        "flag": (pa.array([True, False]), None),
    }
    about = {
        "f8": {"unit": "g"},
        "f2": {"units": "mm"},
        "i4": {"Unit": "V"},
        "micro": {"unit": "s"},
    }
    fields = [pa.field(n, a.type, metadata=about.get(n)) for n, (a, _) in arrays.items()]
    table = pa.table([a for a, _ in arrays.values()], schema=pa.schema(fields))
    parquet.write_table(table, tmp_path / "a.parquet")
    held = read_columns(tmp_path / "a.parquet", ()).columns
    assert list(held) == [name for name, (_, values) in arrays.items() if values is not None]
    for name, column in held.items():
        np.testing.assert_array_equal(column.values, np.array(arrays[name][1]))
        assert column.clock == "table"
    units = {name: column.unit for name, column in held.items() if column.unit}
    assert units == {"f8": "g", "f2": "mm", "i4": "V", "second": "ns", "micro": "ns"}


ROW = np.arange(300.0)
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
def test_columns_of_matlab(tmp_path: Path, name: str) -> None:
    values, expected = DATASETS[name]
    savemat(tmp_path / "a.mat", {"x": values})
    held = read_columns(tmp_path / "a.mat", ()).columns
    assert {each: float(column.values[1]) for each, column in held.items()} == expected


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
    held = read_columns(tmp_path / "a.mat", ()).columns
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


def test_a_channel_without_a_unit_has_that_of_its_conversion(tmp_path: Path) -> None:
    from asammdf.blocks.conversion_utils import from_dict

    rule = from_dict({"a": 2.0, "b": 0.0})
    rule.unit = "m/s2"
    path = tmp_path / "a.mf4"
    _write(path, [("IMU", [_signal("az", conversion=rule), _signal("ax")])])
    units = {name: column.unit for name, column in read_columns(path, ()).columns.items()}
    assert units == {"IMU/az": "m/s2", "IMU/ax": ""}


def test_values_that_are_invalid_are_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    bits = np.array([False, True, False])
    _write(path, [("g", [_signal("x", invalidation_bits=bits), _signal("y")])])
    held = read_columns(path, ()).columns
    np.testing.assert_array_equal(held["g/x"].values, [0.0, np.nan, 2.0])
    np.testing.assert_array_equal(held["g/y"].values, X)


WIDE = np.arange(300.0 * 256).reshape(300, 256)


def test_tables_are_not_wider_than_256_columns_and_no_images(tmp_path: Path) -> None:
    tables = {"wide": WIDE, "wider": np.zeros((300, 257)), "cube": np.zeros((2, 2, 2))}
    savemat(tmp_path / "a.mat", tables)
    assert set(read_columns(tmp_path / "a.mat", ()).columns) == {f"wide:{n}" for n in range(1, 257)}


def test_a_name_that_occurs_twice_is_to_be_written_in_full(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"a": {"fl": ROW}, "b": {"fl": -ROW}})
    with pytest.raises(InputError, match=r"has 2 columns 'fl' \(write one of a/fl, b/fl\)"):
        read_columns(path, ("fl",))
    assert read_columns(path, ("b/fl",)).columns["b/fl"].values[1] == -1.0
