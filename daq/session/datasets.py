"""Writes groups, datasets and attributes of a session file, by HDF5's own calls.

A run has about 50 datasets and 190 attributes.  h5py's objects look each one up by name again and
guess its type, which takes several times as long as writing it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from typing import Any, NamedTuple

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5g, h5p, h5s, h5t
from h5py.h5d import DatasetID
from h5py.h5g import GroupID
from numpy.typing import NDArray

from .chunks import LEVEL, ROWS, packed_chunks

_TEXT = h5py.string_dtype()
_COUNTED = np.dtype(np.int64)


def write_group(parent: GroupID, name: str) -> GroupID:
    """Make a group in another one, and return it."""
    return h5g.create(parent, name.encode(), None if name.isascii() else _utf8())


def write_attributes(item: GroupID | DatasetID, values: Mapping[str, Any]) -> None:
    """Write new attributes: texts, numbers or arrays of numbers."""
    for name, value in values.items():
        cell = _kept_cell(value) if isinstance(value, str | int) else _cell(np.asarray(value))
        made = h5a.create(item, _encoded(name), cell.stored, cell.space)
        made.write(cell.array, cell.held)


def write_column(group: GroupID, name: str, values: NDArray[Any]) -> DatasetID:
    """Write a packed dataset with a checksum, and return it."""
    return _column(group, name, values.shape, values.dtype, packed_chunks(values))


def write_scale(group: GroupID, name: str, values: NDArray[Any]) -> DatasetID:
    """Write a dataset with the times of other datasets' rows, and return it."""
    scale = write_column(group, name, values)
    h5ds.set_scale(scale, name.encode())
    return scale


def write_count(group: GroupID, name: str, count: int) -> DatasetID:
    """Write a dataset that counts the rows of other datasets from 0, and return it."""
    scale = _column(group, name, (count,), _COUNTED, _counted(count))
    h5ds.set_scale(scale, name.encode())
    return scale


def write_along(scale: DatasetID, group: GroupID, name: str, values: NDArray[Any]) -> DatasetID:
    """Write a dataset whose rows belong to those of `scale`, and return it."""
    column = write_column(group, name, values)
    attach(scale, column, 0)
    return column


def attach(scale: DatasetID, column: DatasetID, axis: int) -> None:
    """Attach `scale`, which counts or dates rows, to an axis of a dataset."""
    h5ds.attach_scale(column, scale, axis)


class _Cell(NamedTuple):
    """Value of an attribute with its HDF5 types."""

    array: NDArray[Any]
    stored: h5t.TypeID
    """Type in the file."""
    held: h5t.TypeID
    """Type in memory."""
    space: h5s.SpaceID


@lru_cache(1024, typed=True)  # most of them equal those of the previous run
def _kept_cell(value: str | int) -> _Cell:
    return _cell(np.asarray(value, _TEXT if isinstance(value, str) else None))


def _cell(array: NDArray[Any]) -> _Cell:
    held = _type_in_memory(array.dtype)
    return _Cell(array, _type(array.dtype), held, _space(array.shape))


@lru_cache(1024)
def _encoded(name: str) -> bytes:
    return name.encode()


def _column(
    group: GroupID,
    name: str,
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    chunks: Iterable[tuple[tuple[int, ...], bytes]],
) -> DatasetID:
    space, properties = _space(shape), _packed((min(shape[0], ROWS), *shape[1:]))
    made = h5d.create(group, _encoded(name), _type(dtype), space, properties)
    for offset, packed in chunks:
        made.write_direct_chunk(offset, packed)
    return made


@lru_cache(64)  # most runs have as many frames, samples or events as an earlier one
def _counted(count: int) -> tuple[tuple[tuple[int, ...], bytes], ...]:
    return tuple(packed_chunks(np.arange(count, dtype=_COUNTED)))


@lru_cache(1024)
def _space(shape: tuple[int, ...]) -> h5s.SpaceID:
    return h5s.create_simple(shape) if shape else h5s.create(h5s.SCALAR)


@cache
def _type(dtype: np.dtype[Any]) -> h5t.TypeID:
    return h5t.py_create(dtype, logical=True)


@cache
def _type_in_memory(dtype: np.dtype[Any]) -> h5t.TypeID:
    return h5t.py_create(dtype)


@cache
def _utf8() -> h5p.PropLCID:
    properties = h5p.create(h5p.LINK_CREATE)
    properties.set_char_encoding(h5t.CSET_UTF8)
    return properties


@cache
def _packed(chunk: tuple[int, ...]) -> h5p.PropDCID:
    """Return the properties of a dataset, without time of creation: equal data give equal files."""
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    if chunk[0]:  # HDF5 has no chunks of size 0
        properties.set_chunk(chunk)
        properties.set_shuffle()
        properties.set_deflate(LEVEL)
        properties.set_fletcher32()
    return properties
