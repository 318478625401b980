"""Reads datasets of any HDF5 file, including MATLAB 7.3.

Only data in the file itself are read: no external and no virtual storage.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .opened import ColumnFile, Heading

_MAX_OBJECTS = 100_000
_MOST_COLUMNS = 256
"""Largest number of columns of a table in one dataset; a dataset with more is an image."""
_UNIT_KEYS = ("units", "unit", "Unit", "Units")


@contextmanager
def open_hdf5(path: Path) -> Iterator[ColumnFile]:
    """Open a file; a table of several columns is `name:1`, `name:2` and so on."""
    with h5py.File(path, "r", locking=False) as file:
        datasets = _datasets(file, str(path))
        places: dict[str, tuple[Any, int]] = {}
        headings = []
        for name, dataset in datasets.items():
            shape = [size for size in dataset.shape if size != 1]
            n = min(shape) if len(shape) == 2 else 1
            for i in range(n):
                full = f"{name}:{i + 1}" if n > 1 else name
                places[full] = dataset, i
                clock = _clock(name, dataset)
                headings.append(Heading(full, _unit(dataset), clock, max(shape, default=1)))

        def read(wanted: Sequence[Heading]) -> Mapping[str, NDArray[Any]]:
            return {each.name: _column(*places[each.name]) for each in wanted}

        def times(clock: str) -> NDArray[np.float64] | None:
            scale = datasets.get(clock)
            return None if scale is None else np.asarray(scale[()], np.float64).reshape(-1)

        yield ColumnFile(headings, read, times)


def _datasets(file: Any, where: str) -> dict[str, Any]:
    """Return the datasets of numbers that have one dimension or are narrow tables."""
    datasets: dict[str, Any] = {}
    seen = 0

    def visit(name: str, item: Any) -> None:
        nonlocal seen
        seen += 1
        if seen > _MAX_OBJECTS:
            raise InputError(where, f"has over {_MAX_OBJECTS} objects", "check what it is")
        if not isinstance(item, h5py.Dataset) or name.startswith("#refs#"):
            return
        if item.dtype.kind not in "iuf" or item.shape is None or _is_text(item):
            return
        if item.is_virtual or item.external:
            return
        shape = [size for size in item.shape if size != 1]
        if len(shape) == 1 or (len(shape) == 2 and min(shape) <= _MOST_COLUMNS):
            datasets[name] = item

    file.visititems(visit)
    return datasets


def _is_text(dataset: Any) -> bool:
    return bytes(dataset.attrs.get("MATLAB_class", b"")) == b"char"


def _unit(dataset: Any) -> str:
    for key in _UNIT_KEYS:
        if key in dataset.attrs:
            unit = dataset.attrs[key]
            return unit.decode("utf-8", "replace") if isinstance(unit, bytes) else str(unit)
    return ""


def _clock(name: str, dataset: Any) -> str:
    """Return the clock of a dataset: the scale of the first dimension (netCDF), else the folder."""
    scales: Any = dataset.dims[0] if dataset.ndim == 1 and not dataset.is_scale else ()
    if len(scales):
        return str(scales[0].name).lstrip("/")
    return name.rpartition("/")[0]


def _column(dataset: Any, number: int) -> NDArray[Any]:
    """Return a column of a table, whose longer dimension is time, or the only one."""
    values: Any = np.atleast_1d(np.squeeze(dataset[()]))
    if values.ndim == 2:
        values = values[number] if len(values) < len(values.T) else values[:, number]
    return np.asarray(values)
