"""Writes a session file: as a whole, under a temporary name, synced, then renamed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..channels import Channel
from ..errors import InputError
from ..files import make_room, write_bytes
from ..runs import Run, SampleGroup
from ..sessions import Session
from ..vehicle import BodyWeight, MassState
from .content import Attribute, Content, Item, with_checksums
from .hdf5 import write_image
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


def _check_names(session: Session) -> None:
    """Raise InputError for names that HDF5 would split into groups or truncate."""
    groups = {group.name for run in session.runs for group in run.groups}
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


def _content(session: Session) -> Content:
    """Return the content of a session's file; raises InputError for impossible names."""
    _check_names(session)
    root: dict[str, Attribute] = {
        "Conventions": "CF-1.10",
        "NX_class": "NXroot",
        "schema": SCHEMA,
        "schema_version": VERSION,
    }
    runs = [(f"/runs/r{n:03d}_{run.label}", run) for n, run in enumerate(session.runs, start=1)]
    if runs and runs[0][1].groups:
        root["default"] = f"{runs[0][0][1:]}/{runs[0][1].groups[0].name}"
    content = {"/": Item(root), "/session": Item(_about(session)), "/config": Item()}
    facts = [asdict(fact) for fact in session.vehicle.facts]
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


def _about(session: Session) -> dict[str, Attribute]:
    vehicle = session.vehicle
    geometry = {} if vehicle.geometry is None else asdict(vehicle.geometry)
    texts = {name: text for name, text in session.provenance.items() if name not in TEXTS}
    return {
        "vehicle": vehicle.name,
        **{f"{name}_m": float(value) for name, value in geometry.items()},
        **{f"structure_{name}": int(value) for name, value in asdict(vehicle.structure).items()},
        **{f"element_{name}": int(value) for name, value in vehicle.elements.items()},
        **{f"provenance_{name}": text for name, text in texts.items()},
    }


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
        **_along(path, ("row", "column"), (7, 7), {"delta_mass": state.added.matrix}),
    }


def _run(path: str, run: Run, channels: Sequence[Channel]) -> Content:
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
        columns = {n: np.asarray(getattr(frames, n), t) for n, t in FRAME_COLUMNS.items()}
        content[place] = Item({"bus": int(bus)})
        content |= _along(place, ("frame", "byte"), frames.data.shape, columns)
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
    flags: dict[str, Attribute] = {"flag_masks": QUALITY_MASKS, "flag_meanings": QUALITY_FLAGS}
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
    arrays = {
        name: np.array(
            [_text(row[name], dtype) if dtype[0] == "S" else row[name] for row in rows], dtype
        )
        for name, dtype in columns.items()
    }
    group = {path: Item(attributes or {})}
    return group | _along(path, (dimension,), (len(rows),), arrays)


def _along(
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


def _text(value: object, dtype: str) -> bytes:
    raw = str(value).encode("utf-8", "surrogateescape")
    if len(raw) > int(dtype[1:]):
        what = f"{value!r} is longer than {dtype[1:]} bytes"
        raise InputError("session", what, "shorten that text")
    return raw
