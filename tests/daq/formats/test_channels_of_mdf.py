"""Channels of MDF files: names, units, clocks, and values that the file calls invalid."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from daq.errors import InputError
from daq.formats.columns.child import columns_tree
from daq.formats.columns.opened import ColumnFile, Heading
from daq.formats.columns.read import columns_of

from .channel_files import read_here

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
    held = read_here(path)
    assert held.start_ns == 1_780_221_600_250_001_000
    found = {name: (c.unit, float(held.times_s[c.clock][0])) for name, c in held.columns.items()}
    assert found == {
        "IMU/az": ("g", 0.0),
        "IMU/ax": ("", 0.0),
        "group 1/az": ("", 1.0),
        "IMU (group 2)/az": ("", 2.0),
    }
    assert held.times_s[held.columns["IMU/az"].clock].tolist() == [0.0, 0.25, 0.5]


def test_a_channel_without_a_unit_has_that_of_its_conversion(tmp_path: Path) -> None:
    from asammdf.blocks.conversion_utils import from_dict

    rule = from_dict({"a": 2.0, "b": 0.0})
    rule.unit = "m/s2"
    path = tmp_path / "a.mf4"
    _write(path, [("IMU", [_signal("az", conversion=rule), _signal("ax")])])
    units = {name: column.unit for name, column in read_here(path).columns.items()}
    assert units == {"IMU/az": "m/s2", "IMU/ax": ""}


def test_values_that_are_invalid_are_missing(tmp_path: Path) -> None:
    path = tmp_path / "a.mf4"
    bits = np.array([False, True, False])
    _write(path, [("g", [_signal("x", invalidation_bits=bits), _signal("y")])])
    held = read_here(path).columns
    np.testing.assert_array_equal(held["g/x"].values, [0.0, np.nan, 2.0])
    np.testing.assert_array_equal(held["g/y"].values, X)


def _file(values: Any, clock: str = "a", **more: Any) -> ColumnFile:
    headings = [Heading(name, "m", clock, 5) for name in values]
    return ColumnFile(headings, lambda _: {n: np.asarray(v) for n, v in values.items()}, **more)


def _columns(file: ColumnFile, names: Sequence[str] = ()) -> dict[str, list[float]]:
    held = columns_of(columns_tree(file, names, "a.x"), "a.x")
    return {name: column.values.tolist() for name, column in held.columns.items()}


def test_columns_are_those_that_were_asked_for_under_these_names() -> None:
    file = _file({"g/x": X, "g/y": -X, "h/x": X}, times=lambda _: X * 2, start_ns=7)
    assert _columns(file, ["y", "g/x"]) == {"y": [0.0, -1.0, -2.0], "g/x": [0.0, 1.0, 2.0]}
    whole = columns_of(columns_tree(file, ["y"], "a.x"), "a.x")
    assert (whole.where, whole.start_ns) == ("a.x", 7)
    assert whole.columns["y"].name == "g/y"
    assert whole.times_s["a"].tolist() == [0.0, 2.0, 4.0]
    assert not columns_of(columns_tree(_file({"x": X}), (), "a.x"), "a.x").times_s


def test_a_map_is_proposed_from_2000_columns() -> None:
    values = {f"c{n:04d}": [1.0] for n in range(2001)}
    assert list(_columns(_file(values))) == list(values)[:2000]
    assert _columns(_file(values), ["c2000"]) == {"c2000": [1.0]}


@pytest.mark.parametrize("values", [["a", "b"], np.zeros((2, 2)), np.zeros(2, complex), 1.0])
def test_what_is_no_column_of_numbers_is_refused(values: Any) -> None:
    with pytest.raises(InputError, match="not a column of numbers") as refused:
        _columns(_file({"x": values}))
    assert refused.value.where == "x"


def test_a_file_without_columns_and_one_that_is_too_long_are_refused() -> None:
    with pytest.raises(InputError, match="has no column of numbers") as refused:
        _columns(_file({}))
    assert refused.value.where == "a.x"
    long = ColumnFile([Heading("x", "", "", (1 << 26) + 1)], lambda _: {})
    with pytest.raises(InputError, match="67108865 values"):
        _columns(long)
    with pytest.raises(InputError, match="67108865 values"):
        _columns(_file({"x": np.zeros((1 << 26) + 1, "u1")}))


def test_numbers_of_another_byte_order_are_turned() -> None:
    held = columns_tree(_file({"x": np.array([1, 2], ">i4")}), (), "a.x")
    (column,) = held.groups["columns"].datasets.values()
    assert column.values.dtype.str in ("<i4", "=i4")
    assert column.values.tolist() == [1, 2]
