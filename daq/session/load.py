"""HDF5 to a tree of plain data.  The file may come from anywhere and be made to do harm.

What libhdf5 would follow out of the file (external and soft links, virtual datasets, external
storage, filters from plugins) is refused, and sizes are added up before anything is unpacked.  A
file that is made to crash or to hang libhdf5 itself is dealt with in `guard`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from ..errors import InputError
from .schema import (
    MAX_ATTRIBUTE,
    MAX_BYTES,
    MAX_CHUNK_BYTES,
    MAX_DEPTH,
    MAX_OBJECTS,
    SCHEMA,
    VERSION,
    max_total_bytes,
)
from .tree import Attribute, Dataset, Group

ADVICE = "name a session file that bumpbench record or demo wrote"
DAMAGED_ADVICE = "build it again from its journal"
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_WHAT_H5PY_RAISES = (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError)
_OF_HDF5 = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"}
"""Attributes by which HDF5 keeps dimension scales; they hold references, not data."""


def load_tree(path: Path | str) -> Group:
    """Read a session file whole.

    `path`: HDF5, schema v1.  Returns its root.  Raises InputError if there is no such file, it is
    no session, of a newer schema, or damaged.
    """
    path = Path(path)
    where = str(path)
    try:
        with open_session(path) as file:
            _Survey(max_total_bytes(path.stat().st_size)).visit(file, 0)
            return _group(file)
    except InputError:
        raise
    except _WHAT_H5PY_RAISES as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, DAMAGED_ADVICE) from error


@contextmanager
def open_session(path: Path) -> Iterator[h5py.File]:
    """Open a session file; nothing below its root has been looked at yet.

    Raises InputError if there is no such file, it is no session, or of a newer schema.
    """
    where = str(path)
    if path.is_dir():
        raise InputError(where, "is a directory", ADVICE)
    if not path.exists():
        raise InputError(where, "no such file", ADVICE)
    if not path.is_file():
        raise InputError(where, "is no plain file", ADVICE)
    try:
        file = h5py.File(path, "r")
    except PermissionError as error:
        raise InputError(where, "may not be read", "ask for the right to read it") from error
    except (OSError, RuntimeError) as error:
        raise InputError(where, "is not an HDF5 file, or is cut off", ADVICE) from error
    with file:
        about = plain_attributes(file)
        if about.get("schema") != SCHEMA:
            raise InputError(where, "is HDF5, but not a bench session", ADVICE)
        version = about.get("schema_version")
        if version != VERSION:
            what = f"has schema version {version}, this program reads {VERSION}"
            raise InputError(where, what, "use a newer bumpbench")
        yield file


class _Survey:
    """Adds up what a file claims to hold, before anything is read."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._bytes = 0
        self._seen: set[int] = set()

    def visit(self, group: h5py.Group, depth: int) -> None:
        """Check a group and all below it.

        Raises ValueError if anything reaches outside the file, or claims too much.
        """
        if depth > MAX_DEPTH:
            raise ValueError(f"its groups are nested more than {MAX_DEPTH} deep")
        self._count(group)
        for name in group:
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{name} is absent or a link")
            item = group[name]
            if isinstance(item, h5py.Group):
                self.visit(item, depth + 1)
            elif isinstance(item, h5py.Dataset):
                self._dataset(name, item)
            else:
                raise ValueError(f"{name} is neither group nor dataset")

    def _count(self, item: h5py.Group | h5py.Dataset) -> None:
        address = h5py.h5o.get_info(item.id).addr
        if address in self._seen:
            raise ValueError(f"{item.name} stands in it twice")
        self._seen.add(address)
        if len(self._seen) > MAX_OBJECTS:
            raise ValueError(f"it holds more than {MAX_OBJECTS} objects")

    def _dataset(self, name: str, item: h5py.Dataset) -> None:
        self._count(item)
        # The type first: h5py makes a shape and a size only for types that it knows.
        if item.dtype.kind not in "iufS" or item.dtype.hasobject or item.dtype.itemsize > 4096:
            raise ValueError(f"{name} has type {item.dtype}, which no session has")
        if item.shape is None or len(item.shape) > 2:
            raise ValueError(f"{name} has shape {item.shape}, which no session has")
        layout = item.id.get_create_plist()
        if layout.get_layout() == h5py.h5d.VIRTUAL or layout.get_external_count():
            raise ValueError(f"{name} is no dataset of this file")
        filters = {layout.get_filter(i)[0] for i in range(layout.get_nfilters())}
        if not filters <= _FILTERS:
            raise ValueError(f"{name} is packed in a way that no session is")
        if item.nbytes > MAX_BYTES:
            raise ValueError(f"{name} claims {item.nbytes} bytes")
        if prod(item.chunks or ()) * item.dtype.itemsize > MAX_CHUNK_BYTES:
            raise ValueError(f"{name} claims chunks of {item.chunks}")
        self._bytes += item.nbytes
        if self._bytes > self._limit:
            raise ValueError(f"its datasets claim {self._bytes} bytes and more")


def _group(group: h5py.Group) -> Group:
    items = {name: group[name] for name in sorted(group)}
    return Group(
        plain_attributes(group),
        {name: _group(item) for name, item in items.items() if isinstance(item, h5py.Group)},
        {
            name: Dataset(np.asarray(item[()]), plain_attributes(item))
            for name, item in items.items()
            if isinstance(item, h5py.Dataset)
        },
    )


def plain_attributes(item: h5py.Group | h5py.Dataset) -> Mapping[str, Attribute]:
    """Return the attributes of simple types; others are none of ours."""
    result: dict[str, Attribute] = {}
    for name in item.attrs:
        if name in _OF_HDF5:
            continue
        known = item.attrs.get_id(name)
        text = h5py.check_string_dtype(known.dtype) is not None
        small = known.shape is not None and prod(known.shape) <= MAX_ATTRIBUTE
        if small and (text or known.dtype.kind in "iuf"):
            result[name] = _plain(item.attrs[name])
    return result


def _plain(value: Any) -> Any:
    """Return an attribute as Python has it: text, number, or a tuple of either."""
    if isinstance(value, np.ndarray):
        return tuple(_plain(cell) for cell in value.ravel().tolist())
    if isinstance(value, bytes):
        return value.decode("utf-8", "surrogateescape")
    return value.item() if isinstance(value, np.generic) else value
