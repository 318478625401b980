"""Defines the content of a session file: its groups and datasets by path, without HDF5.

Session, file and checksum meet here: writing makes a content from a session, reading makes it from
a file, and the checksums are computed from it in both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    """Names of the datasets in the same group that count or date the rows along each axis, for
    writing; a scale names itself."""


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
