"""Writes a session file: under a temporary name, synced, then renamed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py.h5g import GroupID

from dbc.frames import FrameBatch

from ..channels import Channel
from ..errors import InputError
from ..files import make_room, write_bytes
from ..runs import Event, Run, SampleGroup
from ..sessions import Session
from ..vehicle import BodyWeight, MassState
from .datasets import (
    attach,
    write_along,
    write_attributes,
    write_column,
    write_count,
    write_group,
    write_scale,
)
from .schema import (
    CHANNEL_COLUMNS,
    EVENT_COLUMNS,
    FACT_COLUMNS,
    FRAME_COLUMNS,
    QUALITY_FLAGS,
    QUALITY_MASKS,
    RAW_PREFIX,
    RESERVED_IN_GROUP,
    RESERVED_IN_RUN,
    SCHEMA,
    TEXTS,
    VERSION,
    WEIGHT_COLUMNS,
)


def write_session(path: Path | str, session: Session) -> None:
    """Write a session file; after any failure it is complete or absent.

    Parameters
    ----------
    path : Path or str
        Replaced if it exists.
    session : Session
        The session to write.

    Raises
    ------
    InputError
        If the file cannot be written (no permission, no space), or a name in the session
        is not possible in HDF5.
    """
    path = Path(path)
    check_names(session, session.runs)
    try:
        # HDF5 never accesses the disk: after a write that failed because the disk was full it
        # crashes the process at its end.
        image = BytesIO()
        with h5py.File(image, "w") as file:
            _fill(file, session)
        make_room(path)
        write_bytes(path, image.getbuffer())
    except OSError as error:
        raise InputError(
            str(path),
            f"cannot be written: {error.strerror or error}",
            "check folder, rights and free space; the journal or log still holds everything",
        ) from error


def check_names(session: Session, runs: Sequence[Run]) -> None:
    """Raise InputError for names that HDF5 would split into groups or truncate."""
    groups = {group.name for run in runs for group in run.groups}
    channels = {channel.name for channel in session.channels}
    states = {state.name for state in session.mass_states}
    for name in groups | channels | states:
        if not name.isprintable() or not 0 < len(name.encode()) <= 64 or set(name) & set("/."):
            what = f"name {name!r} cannot be written"
            raise InputError("session", what, "use 1 to 64 printable bytes without / and .")
    taken = (channels & RESERVED_IN_GROUP) | {n for n in groups if n.startswith(RESERVED_IN_RUN)}
    if taken:
        what = f"name {min(taken)!r} has another meaning in a session file"
        raise InputError("session", what, "choose another name")


def _fill(file: h5py.File, session: Session) -> None:
    write_head(file, session)
    for number, run in enumerate(session.runs, start=1):
        write_run(file, number, run, session.channels)
        write_verdict(file, number, run)
    write_provenance(file, session.provenance)


def write_head(file: h5py.File, session: Session) -> None:
    """Write a session without its runs and the short texts of its provenance."""
    root = file["/"].id
    write_attributes(
        root,
        {
            "Conventions": "CF-1.10",
            "NX_class": "NXroot",
            "schema": SCHEMA,
            "schema_version": VERSION,
        },
    )
    about = write_group(root, "session")
    vehicle = session.vehicle
    geometry = {} if vehicle.geometry is None else asdict(vehicle.geometry)
    structure, elements = asdict(vehicle.structure), vehicle.elements
    write_attributes(
        about,
        {"vehicle": vehicle.name}
        | {f"{name}_m": value for name, value in geometry.items()}
        | {f"structure_{name}": int(value) for name, value in structure.items()}
        | {f"element_{name}": int(value) for name, value in elements.items()},
    )
    facts = [asdict(fact) for fact in vehicle.facts]
    _table(write_group(about, "facts"), "fact", FACT_COLUMNS, facts)
    config = write_group(root, "config")
    for name, text in session.provenance.items():
        if name in TEXTS:
            raw = text.encode("utf-8", "surrogateescape")
            whole = write_scale(config, name, np.frombuffer(raw, np.uint8))
            write_attributes(whole, {"sha256": sha256(raw).hexdigest()})
    rows = [asdict(channel) | {"corner": channel.corner or ""} for channel in session.channels]
    _table(write_group(root, "channels"), "channel", CHANNEL_COLUMNS, rows)
    states = write_group(root, "mass_states")
    for order, state in enumerate(session.mass_states):
        group = write_group(states, state.name)
        write_attributes(group, {"order": order})
        _mass_state(group, state)
    write_group(root, "runs")


def write_provenance(file: h5py.File, provenance: Mapping[str, str]) -> None:
    """Write the short texts of a session's provenance."""
    texts = {f"provenance_{name}": t for name, t in provenance.items() if name not in TEXTS}
    write_attributes(file["session"].id, texts)


def _mass_state(group: GroupID, state: MassState) -> None:
    rows: list[dict[str, Any]] = []
    for weight in state.added.weights:
        row: dict[str, Any] = dict.fromkeys(WEIGHT_COLUMNS, 0.0) | {"hub": ""}
        if isinstance(weight, BodyWeight):
            row |= asdict(weight)
        else:
            row |= {"mass_kg": weight.mass_kg, "sigma_kg": weight.sigma_kg, "hub": weight.corner}
        rows.append(row)
    _table(group, "weight", WEIGHT_COLUMNS, rows)
    matrix = write_column(group, "delta_mass", state.added.matrix)
    for axis, name in enumerate(("row", "column")):
        attach(write_count(group, name, 7), matrix, axis)


def write_run(file: h5py.File, number: int, run: Run, channels: Sequence[Channel]) -> None:
    """Write the measured data of a run, and its events; `number` counts from one."""
    group = write_group(file["runs"].id, _name(number, run))
    facts = {
        "NX_class": "NXentry",
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": run.repeat,
        "t0_ns": run.t0_ns,
        "bump_s": run.bump_s,
        "sample_groups": "\n".join(samples.name for samples in run.groups),
    }
    lost = {f"lost_{name}": count for name, count in asdict(run.losses).items()}
    write_attributes(group, facts | lost)
    for samples in run.groups:
        _samples(write_group(group, samples.name), samples, channels)
    for bus in np.flatnonzero(np.bincount(run.frames.bus)):
        own = run.frames.bus == bus
        frames = run.frames if own.all() else run.frames.select(own)
        _frames(write_group(group, f"{RAW_PREFIX}{bus}"), frames)
    _events(write_group(group, "events"), run.events)
    if number == 1 and run.groups:
        first = f"runs/{_name(number, run)}/{run.groups[0].name}"
        write_attributes(file["/"].id, {"default": first})


def write_verdict(file: h5py.File, number: int, run: Run) -> None:
    """Write the verdict on a run that was written before; nothing else of `run` is used."""
    group = file["runs"][_name(number, run)].id
    write_attributes(group, {"status": str(run.status), "reasons": "\n".join(run.reasons)})


def _name(number: int, run: Run) -> str:
    return f"r{number:03d}_{run.label}"


def _samples(group: GroupID, samples: SampleGroup, channels: Sequence[Channel]) -> None:
    names = list(samples.values)
    time = write_scale(group, "time", samples.time_s)
    write_attributes(time, {"units": "s", "long_name": "time since t0 of the run"})
    t_ns = write_along(time, group, "t_ns", samples.t_ns)
    write_attributes(t_ns, {"units": "ns", "long_name": "bus time since 1970-01-01 UTC"})
    by_name = {channel.name: channel for channel in channels}
    for name, values in samples.values.items():
        channel = by_name[name]
        column = write_along(time, group, name, values)
        said = {"units": channel.unit, "quantity": str(channel.quantity)}
        write_attributes(column, said | {"dbc_signal": channel.signal})
    quality = write_along(time, group, "quality", samples.quality)
    write_attributes(quality, {"flag_masks": QUALITY_MASKS, "flag_meanings": QUALITY_FLAGS})
    about: dict[str, Any] = {"NX_class": "NXdata", "axes": "time", "channels": "\n".join(names)}
    if names:
        about |= {"signal": names[0], "auxiliary_signals": np.array(names[1:], "S64")}
    write_attributes(group, about)


def _frames(group: GroupID, frames: FrameBatch) -> None:
    write_attributes(group, {"bus": int(frames.bus[0])})
    frame = write_count(group, "frame", len(frames))
    for name, dtype in FRAME_COLUMNS.items():
        column = write_along(frame, group, name, np.asarray(getattr(frames, name), dtype))
        if name == "data":
            byte = write_count(group, "byte", frames.data.shape[1])
            attach(byte, column, 1)


def _events(group: GroupID, events: Sequence[Event]) -> None:
    _table(group, "event", EVENT_COLUMNS, [asdict(event) for event in events])


def _table(
    group: GroupID, dimension: str, columns: Mapping[str, str], rows: Sequence[Mapping[str, Any]]
) -> None:
    """Write rows as one dataset per column."""
    scale = write_count(group, dimension, len(rows))
    for name, dtype in columns.items():
        cells = [_cell(row[name], dtype) for row in rows]
        write_along(scale, group, name, np.array(cells, dtype=dtype))


def _cell(value: Any, dtype: str) -> Any:
    if not dtype.startswith("S"):
        return value
    raw = str(value).encode("utf-8", "surrogateescape")
    if len(raw) > int(dtype[1:]):
        what = f"{value!r} is longer than {dtype[1:]} bytes"
        raise InputError("session", what, "shorten that text")
    return raw
