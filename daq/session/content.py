"""Makes the content of a session file of a session, and a session of a content."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, fields
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import InputError

from ..channels import Channel
from ..files import make_room, write_bytes
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
from .hdf5 import (
    DAMAGED_ADVICE,
    SCHEMA,
    VERSION,
    Attribute,
    Content,
    Item,
    SchemaError,
    changed_parts,
    groups_in,
    read_content,
    with_checksums,
    write_image,
)

TEXTS = ("dbc", "bench_toml", "channel_map")
"""Items of the provenance that are complete files and are stored in /config."""

RAW_PREFIX = "raw_bus"
"""Prefix of the groups of raw frames in a run."""

CHANNEL_COLUMNS = {
    "name": "S64",
    "quantity": "S32",
    "unit": "S16",
    "signal": "S128",
    "corner": "S2",
    "x_m": "f8",
    "y_m": "f8",
    "position_sigma_m": "f8",
    "at_cg": "u1",
    "sign": "f8",
    "gain": "f8",
    "gain_sigma": "f8",
    "tare": "f8",
    "motion_ratio": "f8",
    "motion_ratio_sigma": "f8",
    "delay_s": "f8",
    "delay_sigma_s": "f8",
    "low_pass_hz": "f8",
    "low_pass_order": "i4",
    "signal_unit": "S16",
    "serial_number": "S64",
    "calibrated": "S10",
}
WEIGHT_COLUMNS = {
    "mass_kg": "f8",
    "sigma_kg": "f8",
    "x_m": "f8",
    "y_m": "f8",
    "height_m": "f8",
    "position_sigma_m": "f8",
    "hub": "S2",
}
FACT_COLUMNS = {"quantity": "S32", "value": "f8", "sigma": "f8"}
EVENT_COLUMNS = {"t_ns": "i8", "code": "S32", "value": "f8", "text": "S160"}
FRAME_COLUMNS = {"t_ns": "i8", "can_id": "u4", "flags": "u2", "length": "u1", "data": "u1"}


def write_session(path: Path | str, session: Session) -> None:
    """Write a session file; after any failure it is complete or absent.  It replaces an older one.

    Raises InputError if the file cannot be written (no permission, no space), or a name in the
    session is not possible in HDF5.
    """
    path = Path(path)
    image = write_image(with_checksums(_content(session)))
    try:
        make_room(path)
        write_bytes(path, image)
    except OSError as error:
        what = f"cannot be written: {error.strerror or error}"
        advice = "check folder, rights and free space; the journal or log still holds everything"
        raise InputError(str(path), what, advice) from error


def _content(session: Session) -> Content:
    """Return the content of a session's file.

    Raises InputError for names that HDF5 would split into groups or truncate, and for those that
    have another meaning in the file.
    """
    groups = {group.name for run in session.runs for group in run.groups}
    channels = {channel.name for channel in session.channels}
    states = {state.name for state in session.mass_states}
    for name in groups | channels | states:
        if not name.isprintable() or not 0 < len(name.encode()) <= 64 or set(name) & set("/."):
            what = f"name {name!r} cannot be written"
            raise InputError("session", what, "use 1 to 64 printable bytes without / and .")
    taken = channels & {"time", "t_ns", "quality"}
    taken |= {name for name in groups if name.startswith((RAW_PREFIX, "events"))}
    if taken:
        what = f"name {min(taken)!r} has another meaning in a session file"
        raise InputError("session", what, "choose another name")
    root: dict[str, Attribute] = {
        "Conventions": "CF-1.10",
        "NX_class": "NXroot",
        "schema": SCHEMA,
        "schema_version": VERSION,
    }
    runs = [(f"/runs/r{n:03d}_{run.label}", run) for n, run in enumerate(session.runs, start=1)]
    if runs and runs[0][1].groups:
        root["default"] = f"{runs[0][0][1:]}/{runs[0][1].groups[0].name}"
    vehicle = session.vehicle
    geometry = {} if vehicle.geometry is None else asdict(vehicle.geometry)
    texts = {name: text for name, text in session.provenance.items() if name not in TEXTS}
    about: dict[str, Attribute] = {
        "vehicle": vehicle.name,
        **{f"{name}_m": float(value) for name, value in geometry.items()},
        **{f"structure_{name}": int(value) for name, value in asdict(vehicle.structure).items()},
        **{f"element_{name}": int(value) for name, value in vehicle.elements.items()},
        **{f"provenance_{name}": text for name, text in texts.items()},
    }
    content = {"/": Item(root), "/session": Item(about), "/config": Item()}
    facts = [asdict(fact) for fact in vehicle.facts]
    content |= _table("/session/facts", "fact", FACT_COLUMNS, facts)
    for name, text in session.provenance.items():
        if name in TEXTS:
            raw = text.encode("utf-8", "surrogateescape")
            hashed = {"sha256": sha256(raw).hexdigest()}
            content[f"/config/{name}"] = Item(hashed, np.frombuffer(raw, np.uint8), (name,))
    rows = [asdict(channel) | {"corner": channel.corner or ""} for channel in session.channels]
    content |= _table("/channels", "channel", CHANNEL_COLUMNS, rows)
    content["/mass_states"] = Item()
    for order, state in enumerate(session.mass_states):
        content |= _mass_state(f"/mass_states/{state.name}", order, state)
    content["/runs"] = Item()
    for path, run in runs:
        content |= _run(path, run, session.channels)
    return content


def _mass_state(path: str, order: int, state: MassState) -> Content:
    rows: list[dict[str, Any]] = []
    for weight in state.added.weights:
        row: dict[str, Any] = dict.fromkeys(WEIGHT_COLUMNS, 0.0) | {"hub": ""}
        if isinstance(weight, BodyWeight):
            row |= asdict(weight)
        else:
            row |= {"mass_kg": weight.mass_kg, "sigma_kg": weight.sigma_kg, "hub": weight.corner}
        rows.append(row)
    return {
        **_table(path, "weight", WEIGHT_COLUMNS, rows, {"order": order}),
        **_columns(path, ("row", "column"), (7, 7), {"delta_mass": state.added.matrix}),
    }


def _run(path: str, run: Run, channels: Sequence[Channel]) -> Content:
    """Return the group of a run: its samples, the raw frames of each bus, and its events."""
    about: dict[str, Attribute] = {
        "NX_class": "NXentry",
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": int(run.repeat),
        "t0_ns": int(run.t0_ns),
        "bump_s": float(run.bump_s),
        "status": str(run.status),
        "reasons": "\n".join(run.reasons),
        "sample_groups": "\n".join(samples.name for samples in run.groups),
        **{f"lost_{name}": int(count) for name, count in asdict(run.losses).items()},
    }
    content = {path: Item(about)}
    for samples in run.groups:
        content |= _samples(f"{path}/{samples.name}", samples, channels)
    for bus in np.unique(run.frames.bus):
        frames = run.frames.select(run.frames.bus == bus)
        place = f"{path}/{RAW_PREFIX}{bus}"
        columns = {n: np.asarray(getattr(frames, n), dtype) for n, dtype in FRAME_COLUMNS.items()}
        content[place] = Item({"bus": int(bus)})
        content |= _columns(place, ("frame", "byte"), frames.data.shape, columns)
    events = [asdict(event) for event in run.events]
    return content | _table(f"{path}/events", "event", EVENT_COLUMNS, events)


def _samples(path: str, samples: SampleGroup, channels: Sequence[Channel]) -> Content:
    names = list(samples.values)
    about: dict[str, Attribute] = {
        "NX_class": "NXdata",
        "axes": "time",
        "channels": "\n".join(names),
        **({"signal": names[0]} if names else {}),
        **({"auxiliary_signals": tuple(names[1:])} if names[1:] else {}),
    }
    since = {"units": "s", "long_name": "time since t0 of the run"}
    stamps = {"units": "ns", "long_name": "bus time since 1970-01-01 UTC"}
    flags: dict[str, Attribute] = {
        "flag_masks": (1, 2, 4, 8, 16, 32),
        "flag_meanings": "counter_gap crc_bad sentinel out_of_range interpolated missing",
    }
    content = {
        path: Item(about),
        f"{path}/time": Item(since, samples.time_s, ("time",)),
        f"{path}/t_ns": Item(stamps, samples.t_ns, ("time",)),
        f"{path}/quality": Item(flags, samples.quality, ("time",)),
    }
    described = {channel.name: channel for channel in channels}
    for name, values in samples.values.items():
        channel = described[name]
        said = {"units": channel.unit, "quantity": str(channel.quantity)}
        content[f"{path}/{name}"] = Item(said | {"dbc_signal": channel.signal}, values, ("time",))
    return content


def _table(
    path: str,
    dimension: str,
    columns: Mapping[str, str],
    rows: Sequence[Mapping[str, Any]],
    attributes: Mapping[str, Attribute] | None = None,
) -> Content:
    """Return a group with rows as one dataset per column."""
    arrays = {}
    for name, dtype in columns.items():
        cells = [row[name] for row in rows]
        if dtype[0] == "S":
            cells = [str(cell).encode("utf-8", "surrogateescape") for cell in cells]
            if too_long := [cell for cell in cells if len(cell) > int(dtype[1:])]:
                what = f"{too_long[0].decode(errors='replace')!r} is longer than {dtype[1:]} bytes"
                raise InputError("session", what, "shorten that text")
        arrays[name] = np.array(cells, dtype)
    group = {path: Item(attributes or {})}
    return group | _columns(path, (dimension,), (len(rows),), arrays)


def _columns(
    path: str,
    dimensions: Sequence[str],
    shape: Sequence[int],
    columns: Mapping[str, NDArray[Any]],
) -> Content:
    """Return datasets along dimensions that are counted from 0, and the counts."""
    counts = {
        f"{path}/{name}": Item({}, np.arange(n, dtype=np.int64), (name,))
        for name, n in zip(dimensions, shape, strict=True)
    }
    arrays = {
        f"{path}/{name}": Item({}, values, tuple(dimensions[: values.ndim]))
        for name, values in columns.items()
    }
    return counts | arrays


_OF_THE_BENCH = ("/session", "/channels", "/mass_states")
"""Parts of a session that are made again from a bench.toml when it is decoded again."""
_Kind = TypeVar("_Kind", str, int, float)


def read_session(path: Path | str) -> Session:
    """Return the session in a file, with its raw frames.

    Raises InputError if the file does not exist, is not a session, has a newer schema, is
    damaged, or was changed after it was written.
    """
    return read_changed_session(path, ())[0]


def read_changed_session(
    path: Path | str, may_change: Collection[str] = _OF_THE_BENCH
) -> tuple[Session, tuple[str, ...]]:
    """Return a session, and the parts of it that were changed although a bench.toml states them.

    For a reader that replaces sensors, weights and vehicle by those of a bench.toml.  Raises
    InputError as `read_session` if anything but `may_change` was changed.
    """
    content = read_content(path)
    changed = changed_parts(content)
    for part in changed:
        if part not in may_change:
            what = f"{part} was changed or damaged after the file was written"
            redecoded = part in _OF_THE_BENCH
            or_else = "with redecode from a right bench.toml" if redecoded else "take a copy"
            advice = f"build it again with bumpbench recover, or {or_else}"
            raise InputError(str(path), what, advice)
    return session_of(content, str(path)), changed


def session_of(content: Content, where: str) -> Session:
    """Return the session that a file's content describes.

    `where`: the file, for the error.  Raises InputError if anything is absent or contradicts
    itself.
    """
    try:
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
        runs = tuple(_read_run(content, f"/runs/{name}") for name in groups_in(content, "/runs"))
        measured = {name for run in runs for group in run.groups for name in group.values}
        if unknown := measured - {channel.name for channel in channels}:
            raise SchemaError("/channels", f"does not describe {min(unknown)}")
        return Session(
            vehicle=_vehicle(content),
            channels=channels,
            mass_states=tuple(_read_mass_state(content, path) for path in states),
            runs=runs,
            provenance=provenance,
        )
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, DAMAGED_ADVICE) from error


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


def _read_mass_state(content: Content, path: str) -> MassState:
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


def _read_run(content: Content, path: str) -> Run:
    losses = {
        field.name: _attribute(content, path, f"lost_{field.name}", int, 0)
        for field in fields(Losses)
    }
    groups = []
    for name in _lines(content, path, "sample_groups"):
        place = f"{path}/{name}"
        channels = _lines(content, place, "channels")
        groups.append(
            SampleGroup(
                name=name,
                time_s=_values(content, f"{place}/time", "f8"),
                t_ns=_values(content, f"{place}/t_ns", "i8"),
                values={each: _values(content, f"{place}/{each}", "f8") for each in channels},
                quality=_values(content, f"{place}/quality", "u1"),
            )
        )
    buses = [name for name in groups_in(content, path) if name.startswith(RAW_PREFIX)]
    frames = FrameBatch.concatenate([_frames(content, f"{path}/{name}") for name in buses])
    events = _rows(content, f"{path}/events", EVENT_COLUMNS, set(EVENT_COLUMNS))
    return Run(
        mass_state=_attribute(content, path, "mass_state", str),
        excitation=Excitation(_attribute(content, path, "excitation", str)),
        repeat=_attribute(content, path, "repeat", int),
        t0_ns=_attribute(content, path, "t0_ns", int),
        bump_s=_attribute(content, path, "bump_s", float),
        groups=tuple(groups),
        status=RunStatus(_attribute(content, path, "status", str)),
        reasons=_lines(content, path, "reasons"),
        losses=Losses(**losses),
        events=tuple(Event(**row) for row in events),
        frames=frames.by_time() if len(buses) > 1 else frames,
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
