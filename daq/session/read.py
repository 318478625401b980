"""File to session: everything is checked, for the file may come from anywhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch

from ..channels import Channel, Quantity
from ..errors import InputError
from ..runs import Event, Excitation, Losses, Run, RunStatus, SampleGroup, Session
from ..vehicle import (
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
from .schema import (
    CHANNEL_COLUMNS,
    EVENT_COLUMNS,
    FACT_COLUMNS,
    FRAME_COLUMNS,
    MAX_BYTES,
    MAX_TOTAL_BYTES,
    SCHEMA,
    VERSION,
    WEIGHT_COLUMNS,
)

_ADVICE = "name a session file that bumpbench record or demo wrote"


def read_session(path: Path | str) -> Session:
    """Read a session file.

    Parameters
    ----------
    path : Path or str
        HDF5, schema v1.

    Returns
    -------
    Session
        Everything in it, raw frames included.

    Raises
    ------
    InputError
        If there is no such file, it is no session, of a newer schema, or damaged.
    """
    path = Path(path)
    where = str(path)
    if path.is_dir():
        raise InputError(where, "is a directory", _ADVICE)
    if not path.exists():
        raise InputError(where, "no such file", _ADVICE)
    try:
        file = h5py.File(path, "r")
    except (OSError, RuntimeError) as error:
        raise InputError(where, "is not an HDF5 file, or is cut off", _ADVICE) from error
    with file:
        if file.attrs.get("schema") != SCHEMA:
            raise InputError(where, "is HDF5, but not a bench session", _ADVICE)
        version = file.attrs.get("schema_version")
        if version != VERSION:
            what = f"has schema version {version}, this program reads {VERSION}"
            raise InputError(where, what, "use a newer bumpbench")
        try:
            return _session(file)
        except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
            what = f"is damaged: {str(error) or type(error).__name__}"
            raise InputError(where, what, "build it again from its journal") from error


def _check_size(file: h5py.File) -> None:
    """Refuse a file whose datasets unpack to more than a session can hold, before reading any."""
    sizes: list[int] = []
    file.visititems(lambda _, item: sizes.append(getattr(item, "nbytes", 0)))
    if sum(sizes) > MAX_TOTAL_BYTES:
        raise ValueError(f"its datasets claim {sum(sizes)} bytes")


def _session(file: h5py.File) -> Session:
    _check_size(file)
    about = _group(file, "session").attrs
    provenance = {
        name.removeprefix("provenance_"): str(value)
        for name, value in about.items()
        if name.startswith("provenance_")
    }
    config = _group(file, "config")
    for name in config:
        raw = _dataset(config, name).tobytes()
        provenance[name] = raw.decode("utf-8", "surrogateescape")
    states = _group(file, "mass_states")
    runs = _group(file, "runs")
    return Session(
        vehicle=_vehicle(_group(file, "session")),
        channels=tuple(_channel(row) for row in _rows(_group(file, "channels"), CHANNEL_COLUMNS)),
        mass_states=tuple(_mass_state(name, _group(states, name)) for name in _ordered(states)),
        runs=tuple(_run(_group(runs, name)) for name in sorted(runs)),
        provenance=provenance,
    )


def _ordered(states: h5py.Group) -> list[str]:
    """Return the names of the mass states as they were written, the baseline first."""
    return sorted(states, key=lambda name: int(_group(states, name).attrs["order"]))


def _vehicle(group: h5py.Group) -> Vehicle:
    about = group.attrs
    chosen = {f.name: bool(about.get(f"structure_{f.name}", f.default)) for f in fields(Structure)}
    facts = _rows(_group(group, "facts"), FACT_COLUMNS) if "facts" in group else []
    return Vehicle(
        str(about["vehicle"]),
        _geometry(about),
        Structure(**chosen),
        tuple(Fact(**row) for row in facts),
    )


def _geometry(about: h5py.AttributeManager) -> VehicleGeometry | None:
    names = [field.name for field in fields(VehicleGeometry)]
    if not all(f"{name}_m" in about for name in names):
        return None
    return VehicleGeometry(*(float(about[f"{name}_m"]) for name in names))


def _channel(row: dict[str, Any]) -> Channel:
    row["quantity"] = Quantity(row["quantity"])
    row["corner"] = Corner(row["corner"]) if row["corner"] else None
    row["at_cg"] = bool(row["at_cg"])
    return Channel(**row)


def _mass_state(name: str, group: h5py.Group) -> MassState:
    weights: list[BodyWeight | HubWeight] = []
    for row in _rows(group, WEIGHT_COLUMNS):
        hub = row.pop("hub")
        if hub:
            weights.append(HubWeight(row["mass_kg"], Corner(hub), row["sigma_kg"]))
        else:
            weights.append(BodyWeight(**row))
    return MassState(name, AddedMass(tuple(weights), _dataset(group, "delta_mass")))


def _run(group: h5py.Group) -> Run:
    about = group.attrs
    losses = {field.name: int(about[f"lost_{field.name}"]) for field in fields(Losses)}
    raw = [_frames(_group(group, name)) for name in group if name.startswith("raw_bus")]
    frames = FrameBatch.concatenate(raw)
    frames = frames.select(np.argsort(frames.t_ns, kind="stable")) if len(raw) > 1 else frames
    return Run(
        mass_state=str(about["mass_state"]),
        excitation=Excitation(about["excitation"]),
        repeat=int(about["repeat"]),
        t0_ns=int(about["t0_ns"]),
        bump_s=float(about["bump_s"]),
        groups=tuple(_samples(group, name) for name in _lines(about, "sample_groups")),
        status=RunStatus(about["status"]),
        reasons=tuple(_lines(about, "reasons")),
        losses=Losses(**losses),
        events=tuple(Event(**row) for row in _rows(_group(group, "events"), EVENT_COLUMNS)),
        frames=frames,
    )


def _samples(run: h5py.Group, name: str) -> SampleGroup:
    group = _group(run, name)
    channels = _lines(group.attrs, "channels")
    return SampleGroup(
        name=name,
        time_s=_dataset(group, "time").astype(np.float64),
        t_ns=_dataset(group, "t_ns").astype(np.int64),
        values={name: _dataset(group, name).astype(np.float64) for name in channels},
        quality=_dataset(group, "quality").astype(np.uint8),
    )


def _lines(attributes: h5py.AttributeManager, name: str) -> list[str]:
    return [line for line in str(attributes[name]).split("\n") if line]


def _frames(group: h5py.Group) -> FrameBatch:
    columns = {name: _dataset(group, name) for name in FRAME_COLUMNS}
    bus = np.full(len(columns["t_ns"]), int(group.attrs["bus"]), np.uint8)
    return FrameBatch(bus=bus, **columns)


def _rows(group: h5py.Group, columns: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the rows of a table; a column that an older file lacks keeps its default."""
    cells = {name: _dataset(group, name).tolist() for name in columns if name in group}
    texts = [name for name in cells if columns[name].startswith("S")]
    rows = [dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True)]
    for row in rows:
        row |= {name: row[name].decode("utf-8", "surrogateescape") for name in texts}
    return rows


def _group(parent: h5py.Group, name: str) -> h5py.Group:
    item = _own(parent, name)
    if not isinstance(item, h5py.Group):
        raise ValueError(f"{name} is no group")
    return item


def _dataset(parent: h5py.Group, name: str) -> NDArray[Any]:
    """Read a dataset, unless it reaches outside the file or claims an absurd size."""
    item = _own(parent, name)
    if not isinstance(item, h5py.Dataset) or item.is_virtual or item.external:
        raise ValueError(f"{name} is no dataset of this file")
    if item.nbytes > MAX_BYTES:
        raise ValueError(f"{name} claims {item.nbytes} bytes")
    return np.asarray(item[()])


def _own(parent: h5py.Group, name: str) -> Any:
    link = parent.get(name, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise ValueError(f"{name} is absent or a link")
    return parent[name]
