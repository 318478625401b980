"""Channels of MDF files: names, units, clocks, and values that the file calls invalid."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from daq.formats.columns import read_columns

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
