"""Reads and writes HDF5: the content of a session file, and the outlines of many for a list."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from hashlib import sha256
from io import SEEK_END, BytesIO
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from dbc.words import InputError

SCHEMA = "bumpbench-session"
VERSION = 1
DAMAGED_ADVICE = "build it again from its journal"
"""Advice if a session file is damaged."""
CHECKSUM = "content_sha256"
"""Attribute of a part of a session: SHA-256 of its content."""
PARTS = ("/session", "/config", "/channels", "/mass_states", "/runs")
"""Parts of a session, each with its checksum; each run is a part by itself."""

Attribute = str | int | float | tuple[str, ...] | tuple[int, ...] | tuple[float, ...]


class SchemaError(ValueError):
    """Something in a session file that breaks its schema."""

    def __init__(self, where: str, what: str) -> None:
        super().__init__(f"{where} {what}")
        self.where = where
        self.what = what


@dataclass(frozen=True, slots=True)
class Item:
    """One group or dataset."""

    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    """Attributes of simple types."""
    values: NDArray[Any] | None = None
    """Values of a dataset: numbers or byte strings of fixed length; None: a group."""
    scales: tuple[str, ...] = ()
    """Names of the datasets in the same group, written before it, that count or date the rows along
    each axis, for writing; a scale names itself."""


Content = dict[str, Item]
"""Items by path, from the root: `/runs/r001_baseline_bounce_1/HUB_Front/time`."""


def groups_in(content: Content, path: str) -> list[str]:
    """Return the names of the groups in a group, sorted."""
    groups = (name.rpartition("/") for name, item in content.items() if item.values is None)
    return sorted(last for above, _, last in groups if above == path)


def with_checksums(content: Content) -> Content:
    """Return a content with the checksum of each part as an attribute of its group."""
    sealed = {part: {CHECKSUM: digest} for part, digest in _digests(content).items()}
    return {
        path: replace(item, attributes={**item.attributes, **sealed.get(path, {})})
        for path, item in content.items()
    }


def has_checksums(content: Content) -> bool:
    """Return whether a file has checksums: older ones have none."""
    return any(CHECKSUM in item.attributes for item in content.values())


def changed_parts(content: Content) -> tuple[str, ...]:
    """Return the parts of a file that do not match their checksums; none without checksums."""
    if not has_checksums(content):
        return ()
    digests = _digests(content)
    return tuple(
        part
        for part in (*PARTS, *sorted(set(digests) - set(PARTS)))
        if part not in digests or content[part].attributes.get(CHECKSUM) != digests[part]
    )


def _digests(content: Content) -> dict[str, str]:
    """Return the SHA-256 of each part: of each run, and of each of `PARTS`.

    Hashed are, in order of the paths, the path, the attributes in order of their names (name and
    value as Python's `ascii` writes them), and of a dataset the type, the shape and the bytes,
    little endian; of a run, in `/runs`, its path and its checksum.
    """
    runs = tuple(f"/runs/{name}" for name in groups_in(content, "/runs"))
    totals = {part: sha256() for part in (*runs, *PARTS) if part in content}
    for path in sorted(content):
        parts = path.split("/")
        run = "/".join(parts[:3])
        total = totals.get(run) or totals.get("/".join(parts[:2]))
        if total is not None:
            item = content[path]
            shown = {k: v for k, v in item.attributes.items() if k != CHECKSUM}
            total.update(ascii((path, sorted(shown.items()))).encode())
            if item.values is not None:
                values = np.asarray(item.values, item.values.dtype.newbyteorder("<"), order="C")
                total.update(ascii((values.dtype.str, values.shape)).encode())
                total.update(values.tobytes())
    for run in runs:
        stated = content[run].attributes.get(CHECKSUM, totals[run].hexdigest())
        totals["/runs"].update(ascii((run, stated)).encode())
    return {part: total.hexdigest() for part, total in totals.items()}


if TYPE_CHECKING:
    import h5py

_ADVICE = "name a session file that bumpbench record or demo wrote"
_RAISED = (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError, AttributeError)
"""Exceptions that h5py raises on damaged files."""
_MARK = b"\nbumpbench crc32 "
"""Beginning of the last line of a session file; its checksum follows."""


def write_image(content: Content) -> memoryview:
    """Return the bytes of a session file with a content, groups before what is in them.

    Equal contents give equal bytes.  It is made in memory, because HDF5 crashes the process at its
    end when a disk was full.
    """
    import h5py

    image = BytesIO()
    with h5py.File(image, "w") as file:
        parents: dict[str, h5py.Group] = {"": file}
        scales: dict[str, h5py.Dataset] = {}
        for path, item in content.items():
            place, _, name = path.rpartition("/")
            values = item.values
            if values is None:
                made = parents[path] = parents[place].create_group(name) if name else file
                scales.clear()  # an open dataset holds its last chunk in memory
            else:
                packed: dict[str, Any] = {}
                if values.size:  # HDF5 has no chunks of size 0
                    packed["chunks"] = (min(len(values), 8192), *values.shape[1:])
                    # A higher level than 1 packs hardly better.
                    packed |= {"compression": "gzip", "compression_opts": 1}
                    packed |= {"shuffle": True, "fletcher32": True}
                made = parents[place].create_dataset(name, data=values, **packed)
                for axis, scale in enumerate(item.scales):
                    if scale == name:
                        made.make_scale(name)
                        scales[scale] = made
                    else:
                        made.dims[axis].attach_scale(scales[scale])
            for key, value in item.attributes.items():
                made.attrs[key] = _stored(value)
    image.seek(0, SEEK_END)
    image.write(_end(image.getvalue()))
    return image.getbuffer()


def _end(image: bytes | memoryview) -> bytes:
    """Return the last bytes of a session file: the checksum of those before them."""
    return b"%s%08x\n" % (_MARK, crc32(image))


def _stored(value: Attribute) -> Any:
    """Return an attribute as h5py writes it: texts of fixed length, masks as narrow integers."""
    if not isinstance(value, tuple):
        return value
    cells = np.array([each.encode() if isinstance(each, str) else each for each in value])
    return cells.astype(np.min_scalar_type(cells.max())) if cells.dtype.kind == "i" else cells


def read_content(path: Path | str) -> Content:
    """Return the content of a session file.

    Raises InputError if the file does not exist, is not a session, has a newer schema, states what
    no session has, or cannot be unpacked.
    """
    import h5py

    path = Path(path)
    items: list[tuple[str, h5py.Group | h5py.Dataset]] = []
    try:
        with _opened(path) as file:
            file.visititems(lambda name, item: items.append((f"/{name}", item)))
            _check(items, path.stat().st_size)
            return {
                name: Item(_attributes(item), item[()] if isinstance(item, h5py.Dataset) else None)
                for name, item in [("/", file), *items]
            }
    except InputError:  # of the file as a whole
        raise
    except SchemaError as error:
        raise InputError(str(path), f"is damaged: {error}", DAMAGED_ADVICE) from error
    except _RAISED as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(str(path), what, DAMAGED_ADVICE) from error


def _check(items: Sequence[tuple[str, h5py.Group | h5py.Dataset]], file_bytes: int) -> None:
    """Raise SchemaError if a file states types or sizes that no session has."""
    import h5py

    # Unpacked at most 8 GB, and 64 times the file beyond 128 MB: zeros pack a thousandfold, but
    # measurements do not.
    spare = min(8 << 30, (128 << 20) + 64 * file_bytes)
    for path, item in items:
        if isinstance(item, h5py.Group):
            continue
        # The type is first, because h5py has a shape and a size only for types that it knows.
        dtype = getattr(item, "dtype", np.dtype(object))
        if dtype.kind not in "iufS" or dtype.itemsize > 4096:
            raise SchemaError(path, f"has type {dtype}, which no session has")
        if item.shape is None or len(item.shape) > 2:
            raise SchemaError(path, f"has shape {item.shape}, which no session has")
        if item.is_virtual or item.external:
            raise SchemaError(path, "is not a dataset of this file")
        whole = prod(item.shape) * dtype.itemsize
        chunk = prod(item.chunks or ()) * dtype.itemsize
        spare -= whole
        if spare < 0 or chunk > 64 << 20:
            raise SchemaError(path, f"claims {whole} bytes in chunks of {chunk}, too much")


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    """Open a session file, and check that its root says so.

    Raises InputError if the file does not exist, is not a session, or has a newer schema.
    """
    import h5py

    where = str(path)
    if path.is_dir():
        raise InputError(where, "is a directory", _ADVICE)
    if not path.exists():
        raise InputError(where, "no such file", _ADVICE)
    if not path.is_file():
        raise InputError(where, "is not a regular file", _ADVICE)
    try:
        raw = memoryview(path.read_bytes())
        length = len(_end(b""))
        if raw[-length:][: len(_MARK)] == _MARK and raw[-length:] != _end(raw[:-length]):
            raise SchemaError("the file", "does not match the checksum at its end")
        # Each chunk is read once: a cache of them would only cost memory for each dataset.
        file = h5py.File(path, "r", rdcc_nbytes=0, rdcc_nslots=1)
    except SchemaError as error:
        raise InputError(where, f"is damaged: {error}", DAMAGED_ADVICE) from error
    except PermissionError as error:
        raise InputError(where, "cannot be read: no permission", "get read permission") from error
    except _RAISED as error:
        raise InputError(where, "is not an HDF5 file, or is cut off", _ADVICE) from error
    with file:
        about = _attributes(file)
        if about.get("schema") != SCHEMA:
            raise InputError(where, "is HDF5, but not a bench session", _ADVICE)
        version = about.get("schema_version")
        if version != VERSION:
            what = f"has schema version {version}, this program reads {VERSION}"
            raise InputError(where, what, "use a newer bumpbench")
        yield file


def _attributes(item: h5py.Group | h5py.Dataset) -> Mapping[str, Attribute]:
    """Return the attributes of simple types; sessions have no others."""
    result: dict[str, Attribute] = {}
    stored = item.attrs
    # With these HDF5 stores dimension scales; they hold references, not data.
    of_hdf5 = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"}
    for name in stored:
        value = None if name in of_hdf5 else stored[name]
        if isinstance(value, np.ndarray):
            simple = value.dtype.kind in "iufS"
        else:
            simple = isinstance(value, str | bytes | np.integer | np.floating)
        if simple:
            result[_plain(name)] = _plain(value)
    return result


def _plain(value: Any) -> Any:
    """Return a name or an attribute as a Python value: text, number, or a tuple of either."""
    if isinstance(value, np.ndarray):
        return tuple(_plain(each) for each in value.ravel().tolist())
    if isinstance(value, bytes):
        return value.decode("utf-8", "surrogateescape")
    return value.item() if isinstance(value, np.generic) else value
