"""Checks that a tree has the structure of schema v1, and that its hashes match."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from hashlib import sha256

import numpy as np

from dbc.finding import Finding

from ..runs import Losses
from ..vehicle import ELEMENTS, Structure, VehicleGeometry
from .findings import error, note
from .schema import (
    CHANNEL_COLUMNS,
    EVENT_COLUMNS,
    FACT_COLUMNS,
    FRAME_COLUMNS,
    RAW_PREFIX,
    WEIGHT_COLUMNS,
)
from .tree import Group

_RUN_ATTRIBUTES: Mapping[str, type] = {
    "mass_state": str,
    "excitation": str,
    "repeat": int,
    "t0_ns": int,
    "bump_s": float,
    "status": str,
    "reasons": str,
    "sample_groups": str,
}
_REQUIRED_OF_CHANNEL = {"name", "quantity", "unit"}
"""Required columns; the others have defaults, for older files without them."""


def check_structure(root: Group) -> Iterator[Finding]:
    """Yield findings on violations of schema v1 (see `daq.session`)."""
    yield from _members(root, "/", {"session", "config", "channels", "mass_states", "runs"}, set())
    default = str(root.attributes.get("default", ""))
    if default and not _reaches(root, default):
        yield error("/", f"attribute default names {default}, which is absent")
    if "session" in root.groups:
        yield from _about(root.groups["session"])
    for name, config in _groups(root, "config"):
        yield from _members(config, f"/config/{name}", set(), set())
    if "config" in root.groups:
        yield from _hashes(root.groups["config"])
    if "channels" in root.groups:
        channels = root.groups["channels"]
        yield from _table(channels, "/channels", CHANNEL_COLUMNS, _REQUIRED_OF_CHANNEL, "channel")
    for name, state in _groups(root, "mass_states"):
        yield from _mass_state(state, f"/mass_states/{name}")
    for name, run in _groups(root, "runs"):
        yield from _run(run, f"/runs/{name}")


def _reaches(root: Group, path: str) -> bool:
    group = root
    for name in path.split("/"):
        if name not in group.groups:
            return False
        group = group.groups[name]
    return True


def _groups(root: Group, name: str) -> Iterable[tuple[str, Group]]:
    return root.groups[name].groups.items() if name in root.groups else ()


def _about(group: Group) -> Iterator[Finding]:
    yield from _typed(group, "/session", {"vehicle": str})
    lengths = {f"{field.name}_m" for field in fields(VehicleGeometry)}
    given = lengths & set(group.attributes)
    if given and given != lengths:
        yield error("/session", f"attribute {min(lengths - given)} is absent, the others are not")
    yield from _typed(group, "/session", dict.fromkeys(sorted(given), float))
    structure = [f"structure_{field.name}" for field in fields(Structure)]
    elements = [f"element_{name}" for name in ELEMENTS]
    present = [name for name in (*structure, *elements) if name in group.attributes]
    yield from _typed(group, "/session", dict.fromkeys(present, int))
    yield from _members(group, "/session", set(), {"facts"})
    if "facts" in group.groups:
        yield from _table(
            group.groups["facts"], "/session/facts", FACT_COLUMNS, set(FACT_COLUMNS), "fact"
        )


def _hashes(config: Group) -> Iterator[Finding]:
    for name, text in config.datasets.items():
        where = f"/config/{name}"
        if text.values.dtype != np.uint8 or text.values.ndim != 1:
            yield error(where, "is not a row of bytes")
        elif "sha256" not in text.attributes:
            yield error(where, "attribute sha256 is absent")
        elif text.attributes["sha256"] != sha256(text.values.tobytes()).hexdigest():
            yield error(where, "does not match its attribute sha256: it was changed")


def _mass_state(group: Group, where: str) -> Iterator[Finding]:
    yield from _typed(group, where, {"order": int})
    extra = {"delta_mass", "row", "column"}
    required = set(WEIGHT_COLUMNS) - {"position_sigma_m"}  # files of 2026 do not have it
    yield from _table(group, where, WEIGHT_COLUMNS, required, "weight", extra)
    matrix = group.datasets.get("delta_mass")
    if matrix is None or matrix.values.shape != (7, 7) or matrix.values.dtype.kind != "f":
        yield error(where, "delta_mass is not a 7 x 7 matrix of numbers")


def _run(group: Group, where: str) -> Iterator[Finding]:
    yield from _typed(group, where, _RUN_ATTRIBUTES)
    losses = [f"lost_{field.name}" for field in fields(Losses)]
    present = [name for name in losses if name in group.attributes]
    yield from _typed(group, where, dict.fromkeys(present, int))
    samples = {name for name in str(group.attributes.get("sample_groups", "")).split("\n") if name}
    buses = {name for name in group.groups if name.startswith(RAW_PREFIX)}
    yield from _members(group, where, samples | {"events"}, buses)
    for name in sorted(samples & set(group.groups)):
        yield from _samples(group.groups[name], f"{where}/{name}")
    for name in sorted(buses):
        yield from _frames(group.groups[name], f"{where}/{name}")
    if "events" in group.groups:
        events = group.groups["events"]
        yield from _table(events, f"{where}/events", EVENT_COLUMNS, set(EVENT_COLUMNS), "event")


def _samples(group: Group, where: str) -> Iterator[Finding]:
    yield from _typed(group, where, {"channels": str})
    channels = [name for name in str(group.attributes.get("channels", "")).split("\n") if name]
    columns = {"time": "f8", "t_ns": "i8", "quality": "u1", **dict.fromkeys(channels, "f8")}
    yield from _table(group, where, columns, set(columns), "time")
    for name in channels:
        if name in group.datasets and "units" not in group.datasets[name].attributes:
            yield error(f"{where}/{name}", "attribute units is absent")


def _frames(group: Group, where: str) -> Iterator[Finding]:
    yield from _typed(group, where, {"bus": int})
    narrow = {name: dtype for name, dtype in FRAME_COLUMNS.items() if name != "data"}
    extra = {"data", "byte"}
    yield from _table(group, where, narrow, set(narrow), "frame", extra)
    data = group.datasets.get("data")
    rows = len(group.datasets["t_ns"].values) if "t_ns" in group.datasets else 0
    shapes = ((rows, 8), (rows, 64))
    if data is None or data.values.dtype != np.uint8 or data.values.shape not in shapes:
        yield error(where, f"data is not a table of {rows} rows of 8 or 64 bytes")


def _table(
    group: Group,
    where: str,
    columns: Mapping[str, str],
    required: set[str],
    scale: str,
    extra: Iterable[str] = (),
) -> Iterator[Finding]:
    """Yield findings on a table: columns that are absent, of another type, of unequal length."""
    lengths = set()
    for name, dtype in columns.items():
        if name not in group.datasets:
            if name in required:
                yield error(where, f"column {name} is absent")
            continue
        values = group.datasets[name].values
        kind = np.dtype(dtype).kind
        if values.ndim != 1 or (
            values.dtype.kind != kind and not {kind, values.dtype.kind} <= {"i", "u"}
        ):
            yield error(f"{where}/{name}", f"has type {values.dtype} and shape {values.shape}")
        lengths.add(values.shape[:1])
    if len(lengths) > 1:
        yield error(where, "its columns are not equally long")
    for name in sorted(set(group.datasets) - set(columns) - {scale, *extra}):
        yield note(f"{where}/{name}", "is not part of schema v1")


def _typed(group: Group, where: str, kinds: Mapping[str, type]) -> Iterator[Finding]:
    for name, kind in kinds.items():
        value = group.attributes.get(name)
        if value is None:
            yield error(where, f"attribute {name} is absent")
        elif not isinstance(value, (int, float) if kind is float else kind):
            yield error(where, f"attribute {name} is {value!r}, not of type {kind.__name__}")


def _members(group: Group, where: str, required: set[str], allowed: set[str]) -> Iterator[Finding]:
    """Yield findings on groups that are absent or not part of the schema."""
    for name in sorted(required - set(group.groups)):
        yield error(where, f"group {name} is absent")
    for name in sorted(set(group.groups) - required - allowed):
        place = f"{where.rstrip('/')}/{name}"
        yield note(place, "is not part of schema v1")
