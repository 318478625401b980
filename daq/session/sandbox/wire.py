"""Sends a tree as a stream of bytes: an outline in JSON, then the arrays one after another.

It is not pickled, so that the reader need not trust the writer.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import prod
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ..schema import MAX_BYTES
from ..tree import Dataset, Group

_LENGTH_BYTES = 8
_MAX_OUTLINE_BYTES = 256 << 20


def send_tree(stream: IO[bytes], tree: Group) -> None:
    """Write a tree."""
    _send_head(stream, {"tree": _outline(tree)})
    for dataset in tree.all_datasets():
        if dataset.values.size:
            stream.write(np.ascontiguousarray(dataset.values).reshape(-1).view(np.uint8).data)
    stream.flush()


def send_error(stream: IO[bytes], error: InputError) -> None:
    """Write the error instead of a tree."""
    _send_head(stream, {"error": [error.where, error.what, error.advice]})
    stream.flush()


def receive(stream: IO[bytes], max_bytes: int) -> Group:
    """Read a tree.

    `stream`: from `send_tree` or `send_error`.  `max_bytes`: largest total size of the arrays.
    Raises the InputError that was sent.  Raises ValueError or LookupError or TypeError if the
    stream ends early or has another form.
    """
    size = int.from_bytes(_exactly(stream, _LENGTH_BYTES), "little")
    if size > _MAX_OUTLINE_BYTES:
        raise ValueError("its outline is too large")
    head = json.loads(_exactly(stream, size))
    if "error" in head:
        raise InputError(*map(str, head["error"]))
    return _Receiver(stream, max_bytes).tree(head["tree"])


class _Receiver:
    """Reads the arrays of an outline in their order."""

    def __init__(self, stream: IO[bytes], max_bytes: int) -> None:
        self._stream = stream
        self._left = max_bytes

    def tree(self, outline: Mapping[str, Any]) -> Group:
        datasets = {name: self._dataset(item) for name, item in outline["datasets"].items()}
        groups = {name: self.tree(item) for name, item in outline["groups"].items()}
        return Group(_attributes(outline), groups, datasets)

    def _dataset(self, outline: Mapping[str, Any]) -> Dataset:
        dtype, shape = np.dtype(str(outline["dtype"])), tuple(map(int, outline["shape"]))
        size = prod(shape) * dtype.itemsize
        self._left -= size
        if dtype.kind not in "iufS" or min(shape, default=0) < 0:
            raise ValueError("an array of a type that no session has")
        if self._left < 0 or size > MAX_BYTES:
            raise ValueError("its arrays are too large")
        values: NDArray[Any] = np.frombuffer(_exactly(self._stream, size), dtype).reshape(shape)
        return Dataset(values, _attributes(outline))


def _send_head(stream: IO[bytes], document: Mapping[str, Any]) -> None:
    head = json.dumps(document).encode("ascii")
    stream.write(len(head).to_bytes(_LENGTH_BYTES, "little"))
    stream.write(head)


def _attributes(outline: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes in their original form, because JSON converts tuples to lists."""
    return {
        str(name): tuple(value) if isinstance(value, list) else value
        for name, value in outline["attributes"].items()
    }


def _outline(group: Group) -> dict[str, Any]:
    return {
        "attributes": dict(group.attributes),
        "datasets": {
            name: {
                "attributes": dict(item.attributes),
                "dtype": item.values.dtype.str,
                "shape": item.values.shape,
            }
            for name, item in group.datasets.items()
        },
        "groups": {name: _outline(item) for name, item in group.groups.items()},
    }


def _exactly(stream: IO[bytes], size: int) -> bytes:
    read = stream.read(size)
    if len(read) != size:
        raise ValueError("reading stopped early")
    return read
