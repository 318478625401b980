"""Reads variables of MATLAB files before 7.3 with SciPy: arrays, structs, nested structs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .opened import ColumnFile, Heading

_MOST_COLUMNS = 256
_DEEPEST = 12
_NAMES = ("Name", "name")


@contextmanager
def open_matlab5(path: Path) -> Iterator[ColumnFile]:
    """Open a file: `struct/field`; a matrix of several columns is `name:1`, `name:2` and so on.

    An element of an array of structs is named by its `Name`, if it has one, else by its number.
    """
    from scipy.io import loadmat

    held = loadmat(path, simplify_cells=True)
    arrays: dict[str, NDArray[Any]] = {}
    for name, value in held.items():
        if not name.startswith("__"):
            _collect(name, value, arrays, 0)
    headings = [
        Heading(name, "", name.rpartition("/")[0], len(values)) for name, values in arrays.items()
    ]

    def read(wanted: Sequence[Heading]) -> Mapping[str, NDArray[Any]]:
        return {each.name: arrays[each.name] for each in wanted}

    yield ColumnFile([_with_unit(each, held) for each in headings], read)


def _collect(name: str, value: Any, arrays: dict[str, NDArray[Any]], depth: int) -> None:
    if depth > _DEEPEST:
        return
    if isinstance(value, dict):
        for key, item in value.items():
            _collect(f"{name}/{key}", item, arrays, depth + 1)
    elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        for number, item in enumerate(np.ravel(np.array(value, object)), start=1):
            if isinstance(item, dict):
                named = next((item[k] for k in _NAMES if isinstance(item.get(k), str)), number)
                _collect(f"{name}/{named}", item, arrays, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        _collect_array(name, value, arrays)


def _collect_array(name: str, values: NDArray[Any], arrays: dict[str, NDArray[Any]]) -> None:
    values = np.squeeze(values)
    if values.ndim == 1:
        arrays[name] = values
    elif values.ndim == 2 and min(values.shape) <= _MOST_COLUMNS:
        columns = values.T if values.shape[0] >= values.shape[1] else values
        arrays.update({f"{name}:{i + 1}": column for i, column in enumerate(columns)})


def _with_unit(heading: Heading, held: Mapping[str, Any]) -> Heading:
    """Return a heading with its unit: from `x/units/channel`, or the `unit` of its struct."""
    *folders, last = heading.name.split("/")
    unit_node: Any = held
    for folder in folders:
        unit_node = unit_node.get(folder) if isinstance(unit_node, Mapping) else None
    if not isinstance(unit_node, Mapping):
        return heading
    units = unit_node.get("units", unit_node.get("unit", unit_node.get("Unit", "")))
    unit = units.get(last, "") if isinstance(units, Mapping) else units
    is_text = isinstance(unit, str)
    return Heading(heading.name, unit if is_text else "", heading.clock, heading.samples)
