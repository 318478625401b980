"""Columns of Parquet: units, times of day, what is no number."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from daq.formats.columns import read_columns

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
