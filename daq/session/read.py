"""Reads a session file: checks its checksums, and makes a session of its content."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..channels import Channel
from ..errors import InputError
from ..runs import Event, Excitation, Losses, Run, RunStatus, SampleGroup
from ..sessions import Session
from ..vehicle import (
    ELEMENTS,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
    VehicleGeometry,
)
from .content import Content, SchemaError, changed_parts, groups_in
from .hdf5 import read_content
from .schema import (
    CHANNEL_COLUMNS,
    DAMAGED_ADVICE,
    EVENT_COLUMNS,
    FACT_COLUMNS,
    FRAME_COLUMNS,
    RAW_PREFIX,
    WEIGHT_COLUMNS,
)

_OF_THE_BENCH = ("/session", "/channels", "/mass_states")
"""Parts of a session that are made again from a bench.toml when it is decoded again."""
_Kind = TypeVar("_Kind", str, int, float)


def read_session(path: Path | str) -> Session:
    """Return the session in a file, with its raw frames.

    Raises InputError if the file does not exist, is not a session, has a newer schema, is
    damaged, or was changed after it was written.
    """
    content = read_content(path)
    for part in changed_parts(content):
        raise _refusal(path, part)
    return session_of(content, str(path))


def read_changed_session(path: Path | str) -> tuple[Session, tuple[str, ...]]:
    """Return a session, and the parts of it that were changed although a bench.toml states them.

    For a reader that replaces sensors, weights and vehicle by those of a bench.toml.  Raises
    InputError as `read_session` if anything else was changed.
    """
    content = read_content(path)
    changed = changed_parts(content)
    for part in changed:
        if part not in _OF_THE_BENCH:
            raise _refusal(path, part)
    return session_of(content, str(path)), changed


def _refusal(path: Path | str, part: str) -> InputError:
    what = f"{part} was changed or damaged after the file was written"
    advice = "build it again with bumpbench recover, or take a copy"
    if part in _OF_THE_BENCH:
        advice = "build it again with bumpbench recover, or with redecode from a right bench.toml"
    return InputError(str(path), what, advice)


def session_of(content: Content, where: str) -> Session:
    """Return the session that a file's content describes.

    `where`: the file, for the error.  Raises InputError if anything is absent or contradicts
    itself.
    """
    try:
        return _session(content)
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, DAMAGED_ADVICE) from error


def _session(content: Content) -> Session:
    about = _attributes(content, "/session")
    provenance = {
        name.removeprefix("provenance_"): str(value)
        for name, value in about.items()
        if name.startswith("provenance_")
    }
    for path in content:
        folder, _, name = path.rpartition("/")
        if folder == "/config":
            raw = _values(content, path, "u1")
            provenance[name] = raw.tobytes().decode("utf-8", "surrogateescape")
    states = [f"/mass_states/{name}" for name in groups_in(content, "/mass_states")]
    states.sort(key=lambda path: _attribute(content, path, "order", int))
    rows = _rows(content, "/channels", CHANNEL_COLUMNS, {"name", "quantity", "unit"})
    for row in rows:
        row["corner"] = row.get("corner") or None
        row["at_cg"] = bool(row.get("at_cg"))
    channels = tuple(Channel(**row) for row in rows)
    runs = tuple(_run(content, f"/runs/{name}") for name in groups_in(content, "/runs"))
    measured = {name for run in runs for group in run.groups for name in group.values}
    unknown = measured - {channel.name for channel in channels}
    if unknown:
        raise SchemaError("/channels", f"does not describe {min(unknown)}")
    return Session(
        vehicle=_vehicle(content),
        channels=channels,
        mass_states=tuple(_mass_state(content, path) for path in states),
        runs=runs,
        provenance=provenance,
    )


def _vehicle(content: Content) -> Vehicle:
    about = _attributes(content, "/session")
    lengths = [f"{field.name}_m" for field in fields(VehicleGeometry)]
    if 0 < len([name for name in lengths if name in about]) < len(lengths):
        raise SchemaError("/session", f"has not all of {', '.join(lengths)}")
    measured = [_attribute(content, "/session", n, float) for n in lengths if n in about]
    defaults = {f"structure_{field.name}": bool(field.default) for field in fields(Structure)}
    structure = [_attribute(content, "/session", n, int, int(d)) for n, d in defaults.items()]
    facts = []
    if "/session/facts" in content:
        facts = _rows(content, "/session/facts", FACT_COLUMNS, set(FACT_COLUMNS))
    return Vehicle(
        _attribute(content, "/session", "vehicle", str),
        VehicleGeometry(*measured) if measured else None,
        Structure(*map(bool, structure)),
        tuple(Fact(**row) for row in facts),
        {
            name: bool(_attribute(content, "/session", f"element_{name}", int))
            for name in ELEMENTS
            if f"element_{name}" in about
        },
    )


def _mass_state(content: Content, path: str) -> MassState:
    weights: list[BodyWeight | HubWeight] = []
    needed = set(WEIGHT_COLUMNS) - {"position_sigma_m"}  # files of 2026 do not have it
    for row in _rows(content, path, WEIGHT_COLUMNS, needed):
        hub = row.pop("hub")
        if hub:
            weights.append(HubWeight(row["mass_kg"], Corner(hub), row["sigma_kg"]))
        else:
            weights.append(BodyWeight(**row))
    matrix = _values(content, f"{path}/delta_mass", "f8", (7, 7))
    return MassState(path.rpartition("/")[2], AddedMass(tuple(weights), matrix))


def _run(content: Content, path: str) -> Run:
    losses = {
        field.name: _attribute(content, path, f"lost_{field.name}", int, 0)
        for field in fields(Losses)
    }
    buses = [name for name in groups_in(content, path) if name.startswith(RAW_PREFIX)]
    frames = FrameBatch.concatenate([_frames(content, f"{path}/{name}") for name in buses])
    events = _rows(content, f"{path}/events", EVENT_COLUMNS, set(EVENT_COLUMNS))
    return Run(
        mass_state=_attribute(content, path, "mass_state", str),
        excitation=Excitation(_attribute(content, path, "excitation", str)),
        repeat=_attribute(content, path, "repeat", int),
        t0_ns=_attribute(content, path, "t0_ns", int),
        bump_s=_attribute(content, path, "bump_s", float),
        groups=tuple(_samples(content, path, n) for n in _lines(content, path, "sample_groups")),
        status=RunStatus(_attribute(content, path, "status", str)),
        reasons=_lines(content, path, "reasons"),
        losses=Losses(**losses),
        events=tuple(Event(**row) for row in events),
        frames=frames.by_time() if len(buses) > 1 else frames,
    )


def _samples(content: Content, run: str, name: str) -> SampleGroup:
    path = f"{run}/{name}"
    channels = _lines(content, path, "channels")
    return SampleGroup(
        name=name,
        time_s=_values(content, f"{path}/time", "f8"),
        t_ns=_values(content, f"{path}/t_ns", "i8"),
        values={channel: _values(content, f"{path}/{channel}", "f8") for channel in channels},
        quality=_values(content, f"{path}/quality", "u1"),
    )


def _frames(content: Content, path: str) -> FrameBatch:
    bus = _attribute(content, path, "bus", int)
    if not 0 <= bus <= 255:
        raise SchemaError(path, f"is of bus {bus}, which there is not")
    n = len(_values(content, f"{path}/t_ns", "i8"))
    data = content[f"{path}/data"].values if f"{path}/data" in content else None
    width = 64 if data is not None and data.shape[1:] == (64,) else 8
    columns = {
        name: _values(content, f"{path}/{name}", dtype, (n, width) if name == "data" else (n,))
        for name, dtype in FRAME_COLUMNS.items()
    }
    return FrameBatch(bus=np.full(n, bus, np.uint8), **columns)


def _attributes(content: Content, path: str) -> Mapping[str, Any]:
    if path not in content or content[path].values is not None:
        raise SchemaError(path, "is absent")
    return content[path].attributes


def _attribute(
    content: Content, path: str, name: str, kind: type[_Kind], default: _Kind | None = None
) -> _Kind:
    """Return an attribute of a group; raises SchemaError if it is absent or of another type."""
    value = _attributes(content, path).get(name, default)
    if value is None:
        raise SchemaError(path, f"has no attribute {name}")
    if not isinstance(value, (int, float) if kind is float else kind):
        raise SchemaError(path, f"has attribute {name} {value!r}, not of type {kind.__name__}")
    return kind(value)


def _lines(content: Content, path: str, name: str) -> tuple[str, ...]:
    return tuple(line for line in _attribute(content, path, name, str).split("\n") if line)


def _values(
    content: Content, path: str, dtype: str, shape: tuple[int, ...] | None = None
) -> NDArray[Any]:
    """Return the values of a dataset; `shape`: default any column.  Raises SchemaError."""
    values = content[path].values if path in content else None
    if values is None:
        raise SchemaError(path, "is absent")
    kind, stored = np.dtype(dtype).kind, values.dtype.kind
    is_kind = stored == kind or {stored, kind} <= {"i", "u"}
    fits = values.ndim == 1 if shape is None else values.shape == shape
    if not fits or not is_kind:
        raise SchemaError(path, f"has type {values.dtype} and shape {values.shape}")
    return values if kind == "S" else values.astype(dtype, copy=False)


def _rows(
    content: Content, path: str, columns: Mapping[str, str], needed: Collection[str]
) -> list[dict[str, Any]]:
    """Return the rows of a table; a column that an older file does not have gets its default."""
    _attributes(content, path)
    present = [name for name in columns if name in needed or f"{path}/{name}" in content]
    cells = {
        name: [
            cell.decode("utf-8", "surrogateescape") if isinstance(cell, bytes) else cell
            for cell in _values(content, f"{path}/{name}", columns[name]).tolist()
        ]
        for name in present
    }
    return [dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True)]
