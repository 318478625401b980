"""Reads columns of Parquet tables with pyarrow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...optional import optional
from .opened import ColumnFile, Heading

_UNIT_KEYS = (b"unit", b"units", b"Unit")


@contextmanager
def open_parquet(path: Path) -> Iterator[ColumnFile]:
    """Open a table; units come from the metadata `unit` of a field; times of day are in ns."""
    pa = optional("pyarrow", "data")
    with optional("pyarrow.parquet", "data").ParquetFile(path) as file:
        rows = file.metadata.num_rows
        headings = [
            Heading(field.name, _unit(pa, field), "table", rows)
            for field in file.schema_arrow
            if _is_time(pa, field.type) or _is_number(pa, field.type)
        ]

        def read(wanted: Sequence[Heading]) -> Mapping[str, NDArray[Any]]:
            table = file.read(columns=[each.name for each in wanted], use_threads=False)
            return {each.name: _numbers(pa, table[each.name]) for each in wanted}

        yield ColumnFile(headings, read)


def _unit(pa: Any, field: Any) -> str:
    if _is_time(pa, field.type):
        return "ns"
    known = field.metadata or {}
    return next((known[key].decode("utf-8", "replace") for key in _UNIT_KEYS if key in known), "")


def _is_time(pa: Any, kind: Any) -> bool:
    return bool(pa.types.is_timestamp(kind))


def _is_number(pa: Any, kind: Any) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))


def _numbers(pa: Any, column: Any) -> NDArray[Any]:
    if _is_time(pa, column.type):
        column = column.cast(pa.timestamp("ns")).cast(pa.int64())
    elif column.null_count or pa.types.is_float16(column.type):
        column = column.cast(pa.float64())
    return np.asarray(column.to_numpy(zero_copy_only=False))
