"""Reads HDF5 to a tree of plain data, from files of any origin, which may be hostile.

Everything that libhdf5 would follow out of the file is refused (external and soft links, virtual
datasets, external storage, filters from plugins), and sizes are added up before anything is
unpacked.  `guard` protects against files that crash or hang libhdf5 itself.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
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
_OF_VIEWERS = {"NX_class", "axes", "signal", "auxiliary_signals"}
"""Attributes of each group of samples that only viewers need, half of a file's attributes."""


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
            return _group(survey.root(file.id), part)
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
        # Each chunk is read once: a cache of them would only cost memory for each dataset.
        file = h5py.File(path, "r", rdcc_nbytes=0, rdcc_nslots=1)
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


_Kind = tuple[tuple[int, ...], np.dtype[Any]]
"""Shape and type of a dataset."""


@dataclass(frozen=True, slots=True)
class _Group:
    """A group that was surveyed."""

    item: h5py.h5g.GroupID
    """The group, open."""
    groups: Mapping[str, _Group]
    """Its groups by name."""
    datasets: Mapping[str, _Kind]
    """Kind of its datasets by name; open ones would fill the memory."""


class _Survey:
    """Opens what is in a file and adds up the sizes that it states, before anything is read."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._bytes = 0
        self._seen: set[int] = set()

    def root(self, file: h5py.h5f.FileID) -> _Group:
        """Return the root of a file with everything below it.

        Raises ValueError if anything refers to data outside the file, or states a too large size.
        """
        self._count(h5py.h5o.get_info(file).addr, "/")
        return self._group(file, "/", 0)

    def _group(self, group: h5py.h5g.GroupID, where: str, depth: int) -> _Group:
        if depth > MAX_DEPTH:
            raise ValueError(f"its groups are nested more than {MAX_DEPTH} deep")
        groups: dict[str, _Group] = {}
        datasets: dict[str, _Kind] = {}
        for key in sorted(group):
            name = _text(key)
            link = group.links.get_info(key)
            if link.type != h5py.h5l.TYPE_HARD:
                raise ValueError(f"{name} is absent or a link")
            path = f"{where.rstrip('/')}/{name}"
            self._count(link.u, path)  # of a hard link, the address that it leads to
            item = h5py.h5o.open(group, key)
            if isinstance(item, h5py.h5g.GroupID):
                groups[name] = self._group(item, path, depth + 1)
            elif isinstance(item, h5py.h5d.DatasetID):
                datasets[name] = self._dataset(name, item)
            else:
                raise ValueError(f"{name} is neither group nor dataset")
        return _Group(group, groups, datasets)

    def _count(self, address: int, where: str) -> None:
        if address in self._seen:
            raise ValueError(f"{where} occurs in it twice")
        self._seen.add(address)
        if len(self._seen) > MAX_OBJECTS:
            raise ValueError(f"it holds more than {MAX_OBJECTS} objects")

    def _dataset(self, name: str, item: h5py.h5d.DatasetID) -> _Kind:
        # The type is first, because h5py has a shape and a size only for types that it knows.
        dtype = item.dtype
        if dtype.kind not in "iufS" or dtype.hasobject or dtype.itemsize > 4096:
            raise ValueError(f"{name} has type {dtype}, which no session has")
        space = item.get_space()
        null = space.get_simple_extent_type() == h5py.h5s.NULL
        shape = None if null else space.get_simple_extent_dims()
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
        return shape, dtype


def _group(found: _Group, part: Part) -> Group:
    whole = part is Part.WHOLE
    attributes = plain_attributes(found.item, _OF_HDF5 if whole else _OF_HDF5 | _OF_VIEWERS)
    # Only a run has sample groups; elsewhere, as among mass states, any name may occur.
    left_out = () if whole or "sample_groups" not in attributes else (RAW_PREFIX,)
    return Group(
        attributes,
        {
            name: _group(group, part)
            for name, group in found.groups.items()
            if not name.startswith(left_out)
        },
        {
            name: _dataset(found.item, name, kind, whole)
            for name, kind in found.datasets.items()
            if not name.startswith(left_out)
        },
    )


def _dataset(group: h5py.h5g.GroupID, name: str, kind: _Kind, whole: bool) -> Dataset:
    item = h5py.h5d.open(group, name.encode("utf-8", "surrogateescape"))
    values = np.empty(*kind)
    if values.size:
        item.read(h5py.h5s.ALL, h5py.h5s.ALL, values)
    return Dataset(values, plain_attributes(item) if whole else {})


def plain_attributes(
    item: h5py.h5g.GroupID | h5py.h5d.DatasetID | h5py.h5f.FileID,
    left_out: Collection[str] = _OF_HDF5,
) -> Mapping[str, Attribute]:
    """Return the attributes of simple types, some left out; sessions have no others."""
    result: dict[str, Attribute] = {}
    names: list[bytes] = []
    h5py.h5a.iterate(item, names.append)
    for key in names:
        name = _text(key)
        if name in left_out:
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
