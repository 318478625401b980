"""Writes session files: groups and datasets of HDF5, with their checksums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from dbc.words import InputError

from ..channels import Channel
from ..files import make_room, write_bytes
from ..runs import Run, SampleGroup
from ..sessions import Session
from ..vehicle import BodyWeight, MassState

if TYPE_CHECKING:
    import h5py

SCHEMA = "bumpbench-session"
VERSION = 1
CHECKSUM = "content_sha256"
"""Attribute of a part of a session: SHA-256 of its content."""
PARTS = ("/session", "/config", "/channels", "/mass_states", "/runs")
"""Parts of a session, each with its checksum; each run is a part by itself."""
MARK = b"\nbumpbench crc32 "
"""Beginning of the last line of a session file; its checksum follows."""
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
_NUMBERS_OF_WEIGHT = ("mass_kg", "sigma_kg", "x_m", "y_m", "height_m", "position_sigma_m")
WEIGHT_COLUMNS = dict.fromkeys(_NUMBERS_OF_WEIGHT, "f8") | {"hub": "S2"}
FACT_COLUMNS = {"quantity": "S32", "value": "f8", "sigma": "f8"}
EVENT_COLUMNS = {"t_ns": "i8", "code": "S32", "value": "f8", "text": "S160"}
FRAME_COLUMNS = {"t_ns": "i8", "can_id": "u4", "flags": "u2", "length": "u1", "data": "u1"}


Attribute = str | int | float | tuple[str, ...] | tuple[int, ...] | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Item:
    """One group or dataset."""

    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    """Attributes of simple types."""
    values: NDArray[Any] | None = None
    """Values of a dataset: numbers or byte strings of fixed length; None: a group."""
    scales: tuple[str, ...] = ()
    """Needed for writing only: of each axis, the dataset in the same group that counts or dates its
    rows and is written before; such a dataset names itself."""


Content = dict[str, Item]
"""Items by path, from the root: `/runs/r001_baseline_bounce_1/HUB_Front/time`."""


def digests(content: Content) -> dict[str, str]:
    """Return the SHA-256 of each part: of each run, and of each of `PARTS`.

    Hashed are, in order of the paths, the path, the attributes in order of their names (name and
    value as Python's `ascii` writes them), and of a dataset the type, the shape and the bytes,
    little endian; of a run, in `/runs`, its path and its checksum.
    """
    run_paths = sorted(p for p in content if p.startswith("/runs/") and p.count("/") == 2)
    hashes = {part: sha256() for part in (*run_paths, *PARTS) if part in content}
    for path in sorted(content):
        names = path.split("/")  # "", part, and in /runs the run
        run_path, part_path = "/".join(names[:3]), "/".join(names[:2])
        part_hash = hashes.get(run_path) or hashes.get(part_path)
        if part_hash is not None:
            item = content[path]
            attributes = {k: v for k, v in item.attributes.items() if k != CHECKSUM}
            part_hash.update(ascii((path, sorted(attributes.items()))).encode())
            if item.values is not None:
                values = np.asarray(item.values, item.values.dtype.newbyteorder("<"), order="C")
                part_hash.update(ascii((values.dtype.str, values.shape)).encode())
                part_hash.update(values.tobytes())
    for run_path in run_paths:
        run_checksum = content[run_path].attributes.get(CHECKSUM, hashes[run_path].hexdigest())
        hashes["/runs"].update(ascii((run_path, run_checksum)).encode())
    return {part: part_hash.hexdigest() for part, part_hash in hashes.items()}


def write_session(path: Path | str, session: Session) -> None:
    """Write a session file, or replace it; after any failure it is complete, or as before.

    Raises InputError if it cannot be written, or a name in the session is not possible in HDF5.
    """
    path = Path(path)
    image = _image(_content(session))
    try:
        make_room(path)
        write_bytes(path, image)
    except OSError as error:
        what = f"cannot be written: {error.strerror or error}"
        advice = "check folder, rights and free space; the journal or log still holds everything"
        raise InputError(str(path), what, advice) from error


def _content(session: Session) -> Content:
    """Return the content of a session's file.

    Raises InputError for names that HDF5 would split or truncate, or that mean something else.
    """
    groups = {group.name for run in session.runs for group in run.groups}
    channels = {channel.name for channel in session.channels}
    states = {state.name for state in session.mass_states}
    for name in groups | channels | states:
        if not name.isprintable() or not 0 < len(name.encode()) <= 64 or set(name) & set("/."):
            what = f"name {name!r} cannot be written"
            raise InputError("session", what, "use 1 to 64 printable bytes without / and .")
    reserved = channels & {"time", "t_ns", "quality"}
    reserved |= {name for name in groups if name.startswith((RAW_PREFIX, "events"))}
    if reserved:
        what = f"name {min(reserved)!r} has another meaning in a session file"
        raise InputError("session", what, "choose another name")
    root_attributes: dict[str, Attribute] = {
        "Conventions": "CF-1.10",
        "NX_class": "NXroot",
        "schema": SCHEMA,
        "schema_version": VERSION,
    }
    runs = [(f"/runs/r{n:03d}_{run.label}", run) for n, run in enumerate(session.runs, start=1)]
    if runs and runs[0][1].groups:
        root_attributes["default"] = f"{runs[0][0][1:]}/{runs[0][1].groups[0].name}"
    vehicle = session.vehicle
    geometry = {} if vehicle.geometry is None else asdict(vehicle.geometry)
    texts = {name: text for name, text in session.provenance.items() if name not in TEXTS}
    session_attributes: dict[str, Attribute] = {
        "vehicle": vehicle.name,
        **{f"{name}_m": float(value) for name, value in geometry.items()},
        **{f"structure_{name}": int(value) for name, value in asdict(vehicle.structure).items()},
        **{f"element_{name}": int(value) for name, value in vehicle.elements.items()},
        **{f"provenance_{name}": text for name, text in texts.items()},
    }
    content = {"/": Item(root_attributes), "/session": Item(session_attributes), "/config": Item()}
    facts = [asdict(fact) for fact in vehicle.facts]
    content |= _table("/session/facts", "fact", FACT_COLUMNS, facts)
    for name, text in session.provenance.items():
        if name in TEXTS:
            raw = text.encode("utf-8", "surrogateescape")
            checksum = {"sha256": sha256(raw).hexdigest()}
            content[f"/config/{name}"] = Item(checksum, np.frombuffer(raw, np.uint8), (name,))
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
    """Return the group of a mass state: a table of its weights, and its matrix."""
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
    run_attributes: dict[str, Attribute] = {
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
    content = {path: Item(run_attributes)}
    for samples in run.groups:
        content |= _samples(f"{path}/{samples.name}", samples, channels)
    for bus in np.unique(run.frames.bus):
        frames = run.frames.select(run.frames.bus == bus)
        bus_path = f"{path}/{RAW_PREFIX}{bus}"
        columns = {n: np.asarray(getattr(frames, n), dtype) for n, dtype in FRAME_COLUMNS.items()}
        content[bus_path] = Item({"bus": int(bus)})
        content |= _columns(bus_path, ("frame", "byte"), frames.data.shape, columns)
    events = [asdict(event) for event in run.events]
    return content | _table(f"{path}/events", "event", EVENT_COLUMNS, events)


def _samples(path: str, samples: SampleGroup, channels: Sequence[Channel]) -> Content:
    """Return the group of samples of one clock: its times, its quality and its channels."""
    names = list(samples.values)
    group_attributes: dict[str, Attribute] = {
        "NX_class": "NXdata",
        "axes": "time",
        "channels": "\n".join(names),
        **({"signal": names[0]} if names else {}),
        **({"auxiliary_signals": tuple(names[1:])} if names[1:] else {}),
    }
    time_attributes = {"units": "s", "long_name": "time since t0 of the run"}
    stamp_attributes = {"units": "ns", "long_name": "bus time since 1970-01-01 UTC"}
    quality_attributes: dict[str, Attribute] = {
        "flag_masks": (1, 2, 4, 8, 16, 32),
        "flag_meanings": "counter_gap crc_bad sentinel out_of_range interpolated missing",
    }
    content = {
        path: Item(group_attributes),
        f"{path}/time": Item(time_attributes, samples.time_s, ("time",)),
        f"{path}/t_ns": Item(stamp_attributes, samples.t_ns, ("time",)),
        f"{path}/quality": Item(quality_attributes, samples.quality, ("time",)),
    }
    channel_of = {channel.name: channel for channel in channels}
    for name, values in samples.values.items():
        channel = channel_of[name]
        attributes = {"units": channel.unit, "quantity": str(channel.quantity)}
        attributes["dbc_signal"] = channel.signal
        content[f"{path}/{name}"] = Item(attributes, values, ("time",))
    return content


def _table(
    path: str,
    dimension: str,
    columns: Mapping[str, str],
    rows: Sequence[Mapping[str, Any]],
    attributes: Mapping[str, Attribute] | None = None,
) -> Content:
    """Return a table: a group with a dataset for each column, and one that counts its rows.

    `dimension`: name of the latter.  `columns`: types by name.
    """
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
    path: str, dimensions: Sequence[str], shape: Sequence[int], columns: Mapping[str, NDArray[Any]]
) -> Content:
    """Return the columns as datasets of a group, and for each dimension one that counts its rows.

    `shape`: number of rows along each dimension.
    """
    counts = {
        f"{path}/{name}": Item({}, np.arange(n, dtype=np.int64), (name,))
        for name, n in zip(dimensions, shape, strict=True)
    }
    arrays = {
        f"{path}/{name}": Item({}, values, tuple(dimensions[: values.ndim]))
        for name, values in columns.items()
    }
    return counts | arrays


def _image(content: Content) -> memoryview:
    """Return the bytes of a session file with a content and its checksums.

    Equal contents give equal bytes.  It is made in memory: HDF5 crashes the process on a full disk.
    """
    import h5py

    image, checksums = BytesIO(), digests(content)
    with h5py.File(image, "w") as file:
        parents: dict[str, h5py.Group] = {"": file}
        scales: dict[str, h5py.Dataset] = {}
        for path, item in content.items():
            parent, _, name = path.rpartition("/")
            values = item.values
            if values is None:
                node = parents[path] = parents[parent].create_group(name) if name else file
                scales.clear()  # an open dataset holds its last chunk in memory
            else:
                options: dict[str, Any] = {}
                if values.size:  # HDF5 has no chunks of size 0
                    options["chunks"] = (min(len(values), 8192), *values.shape[1:])
                    # A higher level than 1 packs hardly better.
                    options |= {"compression": "gzip", "compression_opts": 1}
                    options |= {"shuffle": True, "fletcher32": True}
                node = parents[parent].create_dataset(name, data=values, **options)
                for axis, scale in enumerate(item.scales):
                    if scale == name:
                        node.make_scale(name)
                        scales[scale] = node
                    else:
                        node.dims[axis].attach_scale(scales[scale])
            for key, value in item.attributes.items():
                node.attrs[key] = _h5_attribute(value)
            if path in checksums:
                node.attrs[CHECKSUM] = checksums[path]
    image.seek(0, SEEK_END)
    image.write(b"%s%08x\n" % (MARK, crc32(image.getvalue())))
    return image.getbuffer()


def _h5_attribute(value: Attribute) -> Any:
    """Return an attribute for h5py: tuples of text as fixed lengths, of numbers as narrow ones."""
    if not isinstance(value, tuple):
        return value
    cells = np.array([each.encode() if isinstance(each, str) else each for each in value])
    return cells.astype(np.min_scalar_type(cells.max())) if cells.dtype.kind == "i" else cells
