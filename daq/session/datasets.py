"""Writes datasets and attributes of a session file, by h5py's calls of the HDF5 library.

A run has some 50 datasets and 130 attributes.  h5py's own objects look each one up by its name
again and guess its type, which took four times as long as packing the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t
from numpy.typing import NDArray

_CHUNK_ROWS = 8192
_GZIP_LEVEL = 1
_TEXT = h5py.string_dtype()


def write_attributes(item: h5py.HLObject, values: Mapping[str, Any]) -> None:
    """Write attributes that are not there yet: texts, numbers or arrays of numbers."""
    for name, value in values.items():
        array = np.asarray(value, _TEXT if isinstance(value, str) else None)
        space = h5s.create_simple(array.shape) if array.shape else _scalar()
        attribute = h5a.create(item.id, name.encode(), _type(array.dtype), space)
        attribute.write(array)


def write_column(group: h5py.Group, name: str, values: NDArray[Any]) -> h5py.Dataset:
    """Write a packed dataset with a checksum, and return it."""
    values = np.ascontiguousarray(values)
    space = h5s.create_simple(values.shape)
    chunk = (min(len(values), _CHUNK_ROWS), *values.shape[1:])
    made = h5d.create(group.id, name.encode(), _type(values.dtype), space, _packed(chunk))
    if values.size:
        made.write(h5s.ALL, h5s.ALL, values)
    return h5py.Dataset(made)


def write_scale(group: h5py.Group, name: str, values: NDArray[Any]) -> h5py.Dataset:
    """Write a dataset that counts or dates the rows of others, and return it."""
    scale = write_column(group, name, values)
    scale.make_scale(name)
    return scale


def write_along(
    scale: h5py.Dataset, group: h5py.Group, name: str, values: NDArray[Any]
) -> h5py.Dataset:
    """Write a dataset whose rows are those of `scale`, and return it."""
    column = write_column(group, name, values)
    column.dims[0].attach_scale(scale)
    return column


@cache
def _scalar() -> h5s.SpaceID:
    return h5s.create(h5s.SCALAR)


@cache
def _type(dtype: np.dtype[Any]) -> h5t.TypeID:
    return h5t.py_create(dtype, logical=True)


@cache
def _packed(chunk: tuple[int, ...]) -> h5p.PropDCID:
    """Return the properties of a dataset: no time of creation, so that equal files are equal."""
    properties = h5p.create(h5p.DATASET_CREATE)
    properties.set_obj_track_times(False)
    if chunk[0]:  # HDF5 cannot chunk nothing
        properties.set_chunk(chunk)
        properties.set_shuffle()
        properties.set_deflate(_GZIP_LEVEL)
        properties.set_fletcher32()
    return properties
