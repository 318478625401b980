"""Builds a session from the tree of a session file, and checks everything once more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from dbc.frames import FrameBatch

from ..channels import Channel, Quantity
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
from .sandbox.guard import load_guarded
from .schema import (
    CHANNEL_COLUMNS,
    DAMAGED_ADVICE,
    EVENT_COLUMNS,
    FACT_COLUMNS,
    FRAME_COLUMNS,
    RAW_PREFIX,
    WEIGHT_COLUMNS,
)
from .tree import Attribute, Group, Part


def read_session(path: Path | str) -> Session:
    """Read a session file that this bench, or someone you trust, has written.

    Parameters
    ----------
    path : Path or str
        HDF5, schema v1.

    Returns
    -------
    Session
        The whole session, including raw frames.

    Raises
    ------
    InputError
        If the file does not exist, is not a session, has a newer schema, or is damaged.
    """
    from .load import load_tree  # imports h5py, which only the child needs for a foreign session

    return session_of(load_tree(path), str(path))


def read_samples(path: Path | str) -> Session:
    """Read a session file as `read_session` does, but no raw frames: in half of the time.

    What identifies, compares and tabulates looks at samples alone.

    Raises
    ------
    InputError
        As `read_session`.
    """
    from .load import load_tree

    return session_of(load_tree(path, Part.SAMPLES), str(path))


def read_foreign_session(path: Path | str) -> Session:
    """Read a session file of any origin; as `read_session`, but in a process with limits.

    A file that crashes libhdf5, makes it hang or fills the memory ends that process, not this one.

    Raises
    ------
    InputError
        As `read_session`, and if reading crashes, takes too long or needs too much memory.
    """
    return session_of(load_guarded(path), str(path))


def read_foreign_samples(path: Path | str) -> Session:
    """Read a session file as `read_foreign_session` does, but no raw frames, as `read_samples`.

    Raises
    ------
    InputError
        As `read_foreign_session`.
    """
    return session_of(load_guarded(path, Part.SAMPLES), str(path))


def session_of(tree: Group, where: str) -> Session:
    """Return the session that a tree holds.

    `tree`: root of a session file.  `where`: the file, for the error.  Raises InputError if
    anything is missing or contradicts itself.
    """
    try:
        return _session(tree)
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, DAMAGED_ADVICE) from error


def _session(file: Group) -> Session:
    about = file.group("session").attributes
    provenance = {
        name.removeprefix("provenance_"): str(value)
        for name, value in about.items()
        if name.startswith("provenance_")
    }
    for name, text in file.group("config").datasets.items():
        provenance[name] = text.values.tobytes().decode("utf-8", "surrogateescape")
    states = file.group("mass_states").groups
    order = sorted(states, key=lambda name: _int(states[name].attribute("order")))
    channels = tuple(_channel(row) for row in _rows(file.group("channels"), CHANNEL_COLUMNS))
    runs = tuple(_run(run) for run in file.group("runs").groups.values())
    measured = {name for run in runs for group in run.groups for name in group.values}
    unknown = measured - {channel.name for channel in channels}
    if unknown:
        raise ValueError(f"{min(unknown)} is not a channel of /channels")
    return Session(
        vehicle=_vehicle(file.group("session")),
        channels=channels,
        mass_states=tuple(_mass_state(name, states[name]) for name in order),
        runs=runs,
        provenance=provenance,
    )


def _int(value: Attribute) -> int:
    if not isinstance(value, int) or not -(2**63) <= value < 2**63:
        raise ValueError(f"{value!r} is not a whole number of 64 bits")
    return value


def _float(value: Attribute) -> float:
    if not isinstance(value, int | float):
        raise ValueError(f"{value!r} is not a number")
    return float(value)


def _vehicle(group: Group) -> Vehicle:
    about = group.attributes
    chosen = {f.name: bool(about.get(f"structure_{f.name}", f.default)) for f in fields(Structure)}
    facts = _rows(group.group("facts"), FACT_COLUMNS) if "facts" in group.groups else []
    return Vehicle(
        str(group.attribute("vehicle")),
        _geometry(about),
        Structure(**chosen),
        tuple(Fact(**row) for row in facts),
        {name: bool(about[f"element_{name}"]) for name in ELEMENTS if f"element_{name}" in about},
    )


def _geometry(about: Mapping[str, Attribute]) -> VehicleGeometry | None:
    names = [field.name for field in fields(VehicleGeometry)]
    if not all(f"{name}_m" in about for name in names):
        return None
    return VehicleGeometry(*(_float(about[f"{name}_m"]) for name in names))


def _channel(row: dict[str, Any]) -> Channel:
    row["quantity"] = Quantity(row["quantity"])
    row["corner"] = Corner(row["corner"]) if row.get("corner") else None
    row["at_cg"] = bool(row.get("at_cg"))
    return Channel(**row)


def _mass_state(name: str, group: Group) -> MassState:
    weights: list[BodyWeight | HubWeight] = []
    for row in _rows(group, WEIGHT_COLUMNS):
        hub = row.pop("hub")
        if hub:
            weights.append(HubWeight(row["mass_kg"], Corner(hub), row["sigma_kg"]))
        else:
            weights.append(BodyWeight(**row))
    return MassState(name, AddedMass(tuple(weights), group.values("delta_mass")))


def _run(group: Group) -> Run:
    losses = {
        field.name: _int(group.attributes.get(f"lost_{field.name}", 0)) for field in fields(Losses)
    }
    raw = [_frames(bus) for name, bus in group.groups.items() if name.startswith(RAW_PREFIX)]
    frames = FrameBatch.concatenate(raw)
    frames = frames.by_time() if len(raw) > 1 else frames
    return Run(
        mass_state=str(group.attribute("mass_state")),
        excitation=Excitation(str(group.attribute("excitation"))),
        repeat=_int(group.attribute("repeat")),
        t0_ns=_int(group.attribute("t0_ns")),
        bump_s=_float(group.attribute("bump_s")),
        groups=tuple(_samples(group, name) for name in _lines(group, "sample_groups")),
        status=RunStatus(str(group.attribute("status"))),
        reasons=tuple(_lines(group, "reasons")),
        losses=Losses(**losses),
        events=tuple(Event(**row) for row in _rows(group.group("events"), EVENT_COLUMNS)),
        frames=frames,
    )


def _samples(run: Group, name: str) -> SampleGroup:
    group = run.group(name)
    return SampleGroup(
        name=name,
        time_s=group.values("time").astype(np.float64),
        t_ns=group.values("t_ns").astype(np.int64),
        values={name: group.values(name).astype(np.float64) for name in _lines(group, "channels")},
        quality=group.values("quality").astype(np.uint8),
    )


def _lines(group: Group, name: str) -> list[str]:
    return [line for line in str(group.attribute(name)).split("\n") if line]


def _frames(group: Group) -> FrameBatch:
    columns = {name: group.values(name) for name in FRAME_COLUMNS}
    bus = _int(group.attribute("bus"))
    if not 0 <= bus <= 255:
        raise ValueError(f"there is no bus {bus}")
    return FrameBatch(bus=np.full(len(columns["t_ns"]), bus, np.uint8), **columns)


def _rows(group: Group, columns: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the rows of a table; a column that is missing in an older file gets its default."""
    cells = {
        name: _column(group, name, dtype)
        for name, dtype in columns.items()
        if name in group.datasets
    }
    return [dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True)]


def _column(group: Group, name: str, dtype: str) -> list[Any]:
    """Return the cells of a column as Python values."""
    values = group.values(name)
    if values.ndim != 1 or (values.dtype.kind == "S") != dtype.startswith("S"):
        raise ValueError(f"column {name} has shape {values.shape} and type {values.dtype}")
    if values.dtype.kind == "S":
        return [cell.decode("utf-8", "surrogateescape") for cell in values.tolist()]
    return list(values.astype(dtype).tolist())
