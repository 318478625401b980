"""Arrays, tables and structs of MATLAB files: which are columns, under which names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from daq.formats.columns import read_columns

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
def test_columns_of_matlab(tmp_path: Path, name: str) -> None:
    values, expected = DATASETS[name]
    savemat(tmp_path / "a.mat", {"x": values})
    held = read_columns(tmp_path / "a.mat", ()).columns
    assert {each: float(column.values[1]) for each, column in held.items()} == expected


def test_tables_are_not_wider_than_256_columns_and_no_images(tmp_path: Path) -> None:
    tables = {"wide": WIDE, "wider": np.zeros((300, 257)), "cube": np.zeros((2, 2, 2))}
    savemat(tmp_path / "a.mat", tables)
    assert set(read_columns(tmp_path / "a.mat", ()).columns) == {f"wide:{n}" for n in range(1, 257)}


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
