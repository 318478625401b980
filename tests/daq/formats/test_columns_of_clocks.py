"""Columns and clocks of Parquet and TDMS: units, times of day, waveforms, what is no number."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter

from .channel_files import read_here

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
    held = read_here(tmp_path / "a.parquet").columns
    assert list(held) == [name for name, (_, values) in arrays.items() if values is not None]
    for name, column in held.items():
        np.testing.assert_array_equal(column.values, np.array(arrays[name][1]))
        assert column.clock == "table"
    units = {name: column.unit for name, column in held.items() if column.unit}
    assert units == {"f8": "g", "f2": "mm", "i4": "V", "second": "ns", "micro": "ns"}


def _tdms(path: Path, channels: dict[str, tuple[Any, dict[str, Any]]]) -> None:
    with TdmsWriter(path) as writer:
        writer.write_segment(
            [ChannelObject(*name.split("/"), v, about) for name, (v, about) in channels.items()]
        )


X = np.arange(3.0)
START = np.datetime64("2026-05-31T10:00:00")


def test_waveforms_of_tdms(tmp_path: Path) -> None:
    path = tmp_path / "a.tdms"
    step = {"wf_increment": 0.25}
    _tdms(
        path,
        {
            "g/first": (X, {**step, "wf_start_time": START, "wf_start_offset": 0.5}),
            "g/late": (X, {**step, "wf_start_time": START + np.timedelta64(1500, "ms")}),
            "g/same": (X, {**step, "wf_start_time": START, "wf_start_offset": 0.5}),
            "g/unset": (X, {"wf_increment": 0.5, "wf_start_offset": 2.0}),
            "h/none": (X, {"wf_increment": 0.0}),
            "h/back": (X, {"wf_increment": -1.0}),
        },
    )
    held = read_here(path)
    assert held.start_ns == BEGAN_NS
    times = {name: held.times_s.get(column.clock) for name, column in held.columns.items()}
    assert {n: None if t is None else t.tolist() for n, t in times.items()} == {
        "g/first": [0.5, 0.75, 1.0],
        "g/late": [1.5, 1.75, 2.0],
        "g/same": [0.5, 0.75, 1.0],
        "g/unset": [2.0, 2.5, 3.0],
        "h/none": None,
        "h/back": None,
    }
    clocks = {name: column.clock for name, column in held.columns.items()}
    assert clocks["g/first"] == clocks["g/same"] != clocks["g/late"]
    assert clocks["h/none"] == clocks["h/back"] == "h"


@pytest.mark.parametrize("key", ["unit_string", "NI_UnitDescription", "unit"])
def test_units_and_times_of_day_of_tdms(tmp_path: Path, key: str) -> None:
    path = tmp_path / "a.tdms"
    times = START + np.arange(3).astype("m8[s]")
    _tdms(path, {"g/x": (X, {key: "g"}), "g/t": (times, {key: "s"}), "g/w": (["a", "b"], {})})
    held = read_here(path)
    assert {name: column.unit for name, column in held.columns.items()} == {"g/x": "g", "g/t": "ns"}
    assert held.columns["g/t"].values.tolist() == [BEGAN_NS + n * 10**9 for n in range(3)]
    assert held.start_ns == 0
    assert not held.times_s
