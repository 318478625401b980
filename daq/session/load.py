"""Reads HDF5 to a tree of plain data, from files of any origin, which may be hostile.

Everything that libhdf5 would follow out of the file is refused (external and soft links, virtual
datasets, external storage, filters from plugins), and sizes are added up before anything is
unpacked.  `guard` protects against files that crash or hang libhdf5 itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .schema import (
    DAMAGED_ADVICE,
    MAX_ATTRIBUTE,
    MAX_BYTES,
    MAX_CHUNK_BYTES,
    MAX_DEPTH,
    MAX_OBJECTS,
    RAW_PREFIX,
    SCHEMA,
    VERSION,
    max_total_bytes,
)
from .tree import Attribute, Dataset, Group, Part

ADVICE = "name a session file that bumpbench record or demo wrote"
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_WHAT_H5PY_RAISES = (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError)
_OF_HDF5 = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"}
"""Attributes with which HDF5 stores dimension scales; they hold references, not data."""


def load_tree(path: Path | str, part: Part = Part.WHOLE) -> Group:
    """Read a session file.

    `path`: HDF5, schema v1.  `part`: how much of it to read; all of it is surveyed.  Returns its
    root.  Raises InputError if the file does not exist, is not a session, has a newer schema, or is
    damaged.
    """
    path = Path(path)
    where = str(path)
    try:
        with open_session(path) as file:
            survey = _Survey(max_total_bytes(path.stat().st_size))
            survey.visit(file.id, "/", 0)
            return _group(file.id, part)
    except InputError:
        raise
    except _WHAT_H5PY_RAISES as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, DAMAGED_ADVICE) from error


@contextmanager
def open_session(path: Path) -> Iterator[h5py.File]:
    """Open a session file, and check only its root.

    Raises InputError if the file does not exist, is not a session, or has a newer schema.
    """
    where = str(path)
    if path.is_dir():
        raise InputError(where, "is a directory", ADVICE)
    if not path.exists():
        raise InputError(where, "no such file", ADVICE)
    if not path.is_file():
        raise InputError(where, "is not a regular file", ADVICE)
    try:
        file = h5py.File(path, "r")
    except PermissionError as error:
        raise InputError(where, "cannot be read: no permission", "get read permission") from error
    except (OSError, RuntimeError) as error:
        raise InputError(where, "is not an HDF5 file, or is cut off", ADVICE) from error
    with file:
        about = plain_attributes(file.id)
        if about.get("schema") != SCHEMA:
            raise InputError(where, "is HDF5, but not a bench session", ADVICE)
        version = about.get("schema_version")
        if version != VERSION:
            what = f"has schema version {version}, this program reads {VERSION}"
            raise InputError(where, what, "use a newer bumpbench")
        yield file


class _Survey:
    """Adds up the sizes that a file states, before anything is read."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._bytes = 0
        self._seen: set[int] = set()

    def visit(self, group: h5py.h5g.GroupID, where: str, depth: int) -> None:
        """Check a group and everything below it.

        Raises ValueError if anything refers to data outside the file, or states a too large size.
        """
        if depth > MAX_DEPTH:
            raise ValueError(f"its groups are nested more than {MAX_DEPTH} deep")
        self._count(group, where)
        for key in group:
            name = _text(key)
            if group.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                raise ValueError(f"{name} is absent or a link")
            item = h5py.h5o.open(group, key)
            if isinstance(item, h5py.h5g.GroupID):
                self.visit(item, f"{where.rstrip('/')}/{name}", depth + 1)
            elif isinstance(item, h5py.h5d.DatasetID):
                self._count(item, f"{where.rstrip('/')}/{name}")
                self._dataset(name, item)
            else:
                raise ValueError(f"{name} is neither group nor dataset")

    def _count(self, item: h5py.h5g.GroupID | h5py.h5d.DatasetID, where: str) -> None:
        address = h5py.h5o.get_info(item).addr
        if address in self._seen:
            raise ValueError(f"{where} occurs in it twice")
        self._seen.add(address)
        if len(self._seen) > MAX_OBJECTS:
            raise ValueError(f"it holds more than {MAX_OBJECTS} objects")

    def _dataset(self, name: str, item: h5py.h5d.DatasetID) -> None:
        # The type is first, because h5py has a shape and a size only for types that it knows.
        dtype = item.dtype
        if dtype.kind not in "iufS" or dtype.hasobject or dtype.itemsize > 4096:
            raise ValueError(f"{name} has type {dtype}, which no session has")
        null = item.get_space().get_simple_extent_type() == h5py.h5s.NULL
        shape = None if null else item.shape
        if shape is None or len(shape) > 2:
            raise ValueError(f"{name} has shape {shape}, which no session has")
        layout = item.get_create_plist()
        kind = layout.get_layout()
        if kind == h5py.h5d.VIRTUAL or layout.get_external_count():
            raise ValueError(f"{name} is not a dataset of this file")
        filters = {layout.get_filter(i)[0] for i in range(layout.get_nfilters())}
        if not filters <= _FILTERS:
            raise ValueError(f"{name} is packed in a way that no session uses")
        size = prod(shape) * dtype.itemsize
        if size > MAX_BYTES:
            raise ValueError(f"{name} claims {size} bytes")
        chunks = layout.get_chunk() if kind == h5py.h5d.CHUNKED else ()
        if prod(chunks) * dtype.itemsize > MAX_CHUNK_BYTES:
            raise ValueError(f"{name} claims chunks of {chunks}")
        self._bytes += size
        if self._bytes > self._limit:
            raise ValueError(f"its datasets claim {self._bytes} bytes and more")


def _group(group: h5py.h5g.GroupID, part: Part) -> Group:
    whole = part is Part.WHOLE
    attributes = plain_attributes(group)
    # Only a run has sample groups; elsewhere, as among mass states, any name may occur.
    left_out = () if whole or "sample_groups" not in attributes else (RAW_PREFIX.encode(),)
    keys = (key for key in sorted(group) if not key.startswith(left_out))
    items = {_text(key): h5py.h5o.open(group, key) for key in keys}
    return Group(
        attributes,
        {
            name: _group(item, part)
            for name, item in items.items()
            if isinstance(item, h5py.h5g.GroupID)
        },
        {
            name: Dataset(_values(item), plain_attributes(item) if whole else {})
            for name, item in items.items()
            if isinstance(item, h5py.h5d.DatasetID)
        },
    )


def _values(item: h5py.h5d.DatasetID) -> NDArray[Any]:
    values = np.empty(item.shape, item.dtype)
    if values.size:
        item.read(h5py.h5s.ALL, h5py.h5s.ALL, values)
    return values


def plain_attributes(
    item: h5py.h5g.GroupID | h5py.h5d.DatasetID | h5py.h5f.FileID,
) -> Mapping[str, Attribute]:
    """Return the attributes of simple types; sessions have no others."""
    result: dict[str, Attribute] = {}
    names: list[bytes] = []
    h5py.h5a.iterate(item, names.append)
    for key in names:
        name = _text(key)
        if name in _OF_HDF5:
            continue
        one = h5py.h5a.open(item, key)
        dtype, shape = one.dtype, one.shape
        text = h5py.check_string_dtype(dtype) is not None
        small = shape is not None and prod(shape) <= MAX_ATTRIBUTE
        if small and (text or dtype.kind in "iuf"):
            values = np.zeros(shape, dtype)
            one.read(values)
            result[name] = _plain(values)
    return result


def _plain(values: NDArray[Any]) -> Any:
    """Return an attribute as a Python value: text, number, or a tuple of either."""
    cells = [_text(v) if isinstance(v, bytes) else v for v in values.ravel().tolist()]
    return tuple(cells) if values.ndim else cells[0]


def _text(raw: bytes) -> str:
    return raw.decode("utf-8", "surrogateescape")
