"""Reads session files back, and judges them: checksums, schema, completeness, plausibility."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import fields
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch
from dbc.words import Finding, InputError, Severity, counted, printable

from ..channels import Channel
from ..files import input_bytes
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
from . import writing
from .writing import Attribute, Content, Item

if TYPE_CHECKING:
    import h5py

_ADVICE = "name a session file that bumpbench record or demo wrote"
_DAMAGED_ADVICE = "build it again from its journal"
_RAISED = (OSError, RuntimeError, LookupError, ValueError, TypeError, MemoryError, AttributeError)
"""Exceptions that h5py raises on damaged files."""
_Kind = TypeVar("_Kind", str, int, float)


class SchemaError(ValueError):
    """Something in a session file that breaks its schema."""

    def __init__(self, where: str, what: str) -> None:
        super().__init__(f"{where} {what}")
        self.where = where
        self.what = what


def read_session(path: Path | str) -> Session:
    """Return the session in a file, with its raw frames.

    Raises InputError if there is no file, or it is no session, of a newer schema, or was changed.
    """
    content, is_as_written = read_content(path)
    if not is_as_written and (changed := _changed_parts(content)):
        what = f"{changed[0]} was changed or damaged after the file was written"
        raise InputError(str(path), what, "build it again with bumpbench recover, or take a copy")
    return session_of(content, str(path))


def _has_checksums(content: Content) -> bool:
    """Return whether a file has checksums: older ones have none."""
    return any(writing.CHECKSUM in item.attributes for item in content.values())


def _changed_parts(content: Content) -> tuple[str, ...]:
    """Return the parts of a file that do not match their checksums; none without checksums."""
    if not _has_checksums(content):
        return ()
    computed = writing.digests(content)
    return tuple(
        part
        for part in (*writing.PARTS, *sorted(set(computed) - set(writing.PARTS)))
        if part not in computed or content[part].attributes.get(writing.CHECKSUM) != computed[part]
    )


def read_content(path: Path | str) -> tuple[Content, bool]:
    """Return the content of a session file, and whether its last line has the checksum of the rest.

    Raises InputError if there is no file, or it is no session, of a newer schema, or damaged.
    """
    import h5py

    where, image = str(path), input_bytes(Path(path), _ADVICE)
    end = len(image) - len(writing.MARK) - 9  # of the HDF5: mark, eight digits, line feed follow
    is_marked = end > 0 and image.startswith(writing.MARK, end)
    is_as_written = is_marked and image[end:] == b"%s%08x\n" % (writing.MARK, crc32(image[:end]))
    if is_marked and not is_as_written:
        what = "is damaged: it does not match the checksum at its end"
        raise InputError(where, what, _DAMAGED_ADVICE)
    try:
        # Each chunk is read once: a cache of them would only cost memory for each dataset.
        file = h5py.File(path, "r", rdcc_nbytes=0, rdcc_nslots=1)
    except _RAISED as error:
        raise InputError(where, "is not an HDF5 file, or is cut off", _ADVICE) from error
    items: list[tuple[str, h5py.Group | h5py.Dataset]] = [("/", file)]
    try:
        with file:
            root_attributes = _plain_attributes(file)
            if root_attributes.get("schema") != writing.SCHEMA:
                raise InputError(where, "is HDF5, but not a bench session", _ADVICE)
            version = root_attributes.get("schema_version")
            if version != writing.VERSION:
                what = f"has schema version {version}, this program reads {writing.VERSION}"
                raise InputError(where, what, "use a newer bumpbench")
            file.visititems(lambda name, item: items.append((f"/{name}", item)))
            _check_datasets(items, len(image))
            content = {
                name: Item(
                    _plain_attributes(item), item[()] if isinstance(item, h5py.Dataset) else None
                )
                for name, item in items
            }
    except InputError:  # of the file as a whole
        raise
    except _RAISED as error:  # among them SchemaError
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, _DAMAGED_ADVICE) from error
    return content, is_as_written


def _check_datasets(
    items: Sequence[tuple[str, h5py.Group | h5py.Dataset]], file_bytes: int
) -> None:
    """Raise SchemaError if a file states types or sizes that no session has."""
    import h5py

    # Unpacked at most 8 GB, and 64 times the file beyond 128 MB: only zeros pack a thousandfold.
    bytes_left = min(8 << 30, (128 << 20) + 64 * file_bytes)
    for path, item in items:
        if isinstance(item, h5py.Group):
            continue
        # The type is first, because h5py has a shape and a size only for types that it knows.
        dtype = getattr(item, "dtype", np.dtype(object))
        if dtype.kind not in "iufS" or dtype.itemsize > 4096:
            raise SchemaError(path, f"has type {dtype}, which no session has")
        if item.shape is None or len(item.shape) > 2:
            raise SchemaError(path, f"has shape {item.shape}, which no session has")
        if item.is_virtual or item.external:
            raise SchemaError(path, "is not a dataset of this file")
        dataset_bytes = prod(item.shape) * dtype.itemsize
        chunk_bytes = prod(item.chunks or ()) * dtype.itemsize
        bytes_left -= dataset_bytes
        if bytes_left < 0 or chunk_bytes > 64 << 20:  # ours have 8,192 rows
            sizes = f"{dataset_bytes} bytes in chunks of {chunk_bytes}"
            raise SchemaError(path, f"claims {sizes}, too much")


def _plain_attributes(item: h5py.Group | h5py.Dataset) -> Mapping[str, Attribute]:
    """Return the attributes of simple types; sessions have no others."""
    attributes: dict[str, Attribute] = {}
    h5_attributes = item.attrs
    # With these HDF5 stores dimension scales; they hold references, not data.
    hdf5_names = {"CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "DIMENSION_LABELS"}
    for name in h5_attributes:
        value = None if name in hdf5_names else h5_attributes[name]
        if isinstance(value, np.ndarray):
            is_simple = value.dtype.kind in "iufS"
        else:
            is_simple = isinstance(value, str | bytes | np.integer | np.floating)
        if is_simple:
            attributes[_plain(name)] = _plain(value)
    return attributes


def _plain(value: Any) -> Any:
    """Return a name or an attribute as a Python value: text, number, or a tuple of either."""
    if isinstance(value, np.ndarray):
        return tuple(_plain(each) for each in value.ravel().tolist())
    if isinstance(value, bytes):
        return value.decode("utf-8", "surrogateescape")
    return value.item() if isinstance(value, np.generic) else value


def groups_in(content: Content, path: str) -> list[str]:
    """Return the names of the groups in a group, sorted."""
    groups = (group.rpartition("/") for group, item in content.items() if item.values is None)
    return sorted(name for parent, _, name in groups if parent == path)


def session_of(content: Content, where: str) -> Session:
    """Return the session that a file's content describes.

    `where`: the file, for the error.  Raises InputError if anything is absent or contradictory.
    """
    try:
        session_attributes = _attributes(content, "/session")
        provenance = {
            name.removeprefix("provenance_"): str(value)
            for name, value in session_attributes.items()
            if name.startswith("provenance_")
        }
        for path in content:
            folder, _, name = path.rpartition("/")
            if folder == "/config":
                file_bytes = _values(content, path, "u1")
                provenance[name] = file_bytes.tobytes().decode("utf-8", "surrogateescape")
        state_paths = [f"/mass_states/{name}" for name in groups_in(content, "/mass_states")]
        state_paths.sort(key=lambda path: _attribute(content, path, "order", int))
        rows = _rows(content, "/channels", writing.CHANNEL_COLUMNS, {"name", "quantity", "unit"})
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
            mass_states=tuple(_read_mass_state(content, path) for path in state_paths),
            runs=runs,
            provenance=provenance,
        )
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        what = f"is damaged: {str(error) or type(error).__name__}"
        raise InputError(where, what, _DAMAGED_ADVICE) from error


def _vehicle(content: Content) -> Vehicle:
    """Return the vehicle from the attributes and the facts of the session's group."""
    session_attributes = _attributes(content, "/session")
    length_names = [f"{field.name}_m" for field in fields(VehicleGeometry)]
    present = [name for name in length_names if name in session_attributes]
    if 0 < len(present) < len(length_names):
        raise SchemaError("/session", f"has not all of {', '.join(length_names)}")
    lengths_m = [_attribute(content, "/session", name, float) for name in present]
    defaults = {f"structure_{field.name}": bool(field.default) for field in fields(Structure)}
    structure = [_attribute(content, "/session", n, int, int(d)) for n, d in defaults.items()]
    facts = []
    if "/session/facts" in content:
        facts = _rows(content, "/session/facts", writing.FACT_COLUMNS, set(writing.FACT_COLUMNS))
    return Vehicle(
        _attribute(content, "/session", "vehicle", str),
        VehicleGeometry(*lengths_m) if lengths_m else None,
        Structure(*map(bool, structure)),
        tuple(Fact(**row) for row in facts),
        {
            name: bool(_attribute(content, "/session", f"element_{name}", int))
            for name in ELEMENTS
            if f"element_{name}" in session_attributes
        },
    )


def _read_mass_state(content: Content, path: str) -> MassState:
    """Return the mass state in a group, from its table of weights and its matrix."""
    weights: list[BodyWeight | HubWeight] = []
    needed = set(writing.WEIGHT_COLUMNS) - {"position_sigma_m"}  # files of 2026 do not have it
    for row in _rows(content, path, writing.WEIGHT_COLUMNS, needed):
        hub = row.pop("hub")
        if hub:
            weights.append(HubWeight(row["mass_kg"], Corner(hub), row["sigma_kg"]))
        else:
            weights.append(BodyWeight(**row))
    matrix = _values(content, f"{path}/delta_mass", "f8", (7, 7))
    if not np.all(np.isfinite(matrix)):  # no model of the vehicle could be evaluated
        raise ValueError(f"{path}/delta_mass is not finite")
    return MassState(path.rpartition("/")[2], AddedMass(tuple(weights), matrix))


def _read_run(content: Content, path: str) -> Run:
    """Return the run in a group, with its samples, raw frames and events."""
    losses = {
        field.name: _attribute(content, path, f"lost_{field.name}", int, 0)
        for field in fields(Losses)
    }
    groups = []
    for name in _lines(content, path, "sample_groups"):
        group_path = f"{path}/{name}"
        channels = _lines(content, group_path, "channels")
        groups.append(
            SampleGroup(
                name=name,
                time_s=_values(content, f"{group_path}/time", "f8"),
                t_ns=_values(content, f"{group_path}/t_ns", "i8"),
                values={c: _values(content, f"{group_path}/{c}", "f8") for c in channels},
                quality=_values(content, f"{group_path}/quality", "u1"),
            )
        )
    buses = [name for name in groups_in(content, path) if name.startswith(writing.RAW_PREFIX)]
    frames = FrameBatch.concatenate([_frames(content, f"{path}/{name}") for name in buses])
    events = _rows(content, f"{path}/events", writing.EVENT_COLUMNS, set(writing.EVENT_COLUMNS))
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
    """Return the raw frames in the group of one bus."""
    bus = _attribute(content, path, "bus", int)
    if not 0 <= bus <= 255:
        raise SchemaError(path, f"is of bus {bus}, which there is not")
    n = len(_values(content, f"{path}/t_ns", "i8"))
    data = content[f"{path}/data"].values if f"{path}/data" in content else None
    width = 64 if data is not None and data.shape[1:] == (64,) else 8
    columns = {
        name: _values(content, f"{path}/{name}", dtype, (n, width) if name == "data" else (n,))
        for name, dtype in writing.FRAME_COLUMNS.items()
    }
    return FrameBatch(bus=np.full(n, bus, np.uint8), **columns)


def _attributes(content: Content, path: str) -> Mapping[str, Any]:
    """Return the attributes of a group; raises SchemaError if there is no such group."""
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
    """Return the lines of an attribute of text, without empty ones."""
    return tuple(line for line in _attribute(content, path, name, str).split("\n") if line)


def _values(
    content: Content, path: str, dtype: str, shape: tuple[int, ...] | None = None
) -> NDArray[Any]:
    """Return the values of a dataset as `dtype`; text stays as it is stored.

    `shape`: None for one column of any length.  Raises SchemaError if it is absent, or has another
    kind of type or another shape.
    """
    values = content[path].values if path in content else None
    if values is None:
        raise SchemaError(path, "is absent")
    wanted_kind, stored_kind = np.dtype(dtype).kind, values.dtype.kind
    is_of_kind = stored_kind == wanted_kind or {stored_kind, wanted_kind} <= {"i", "u"}
    has_shape = values.ndim == 1 if shape is None else values.shape == shape
    if not has_shape or not is_of_kind:
        raise SchemaError(path, f"has type {values.dtype} and shape {values.shape}")
    return values if wanted_kind == "S" else values.astype(dtype, copy=False)


def _rows(
    content: Content, path: str, columns: Mapping[str, str], needed: Collection[str]
) -> list[dict[str, Any]]:
    """Return the rows of a table by column, without columns that an older file does not have.

    `columns`: their types.  Raises SchemaError if there is no table, or a column of `needed` is
    absent.
    """
    _attributes(content, path)  # raises if it is no group
    present = [name for name in columns if name in needed or f"{path}/{name}" in content]
    cells = {
        name: [
            cell.decode("utf-8", "surrogateescape") if isinstance(cell, bytes) else cell
            for cell in _values(content, f"{path}/{name}", columns[name]).tolist()
        ]
        for name in present
    }
    return [dict(zip(cells, row, strict=True)) for row in zip(*cells.values(), strict=True)]


# Judges -------------------------------------------------------------------------------------------


def validate_session(path: Path | str) -> tuple[Finding, ...]:
    """Return findings on a session file of any origin, errors first; without errors it is valid.

    Raises InputError if it cannot be read at all.
    """
    content, _ = read_content(path)
    what = "was changed or damaged after the file was written"
    findings = [_finding(part, what) for part in _changed_parts(content)]
    if not _has_checksums(content):
        what = "has no checksums, as older files: a change would not be seen"
        findings.append(Finding("foreign", Severity.NOTE, what, where="/"))
    try:
        findings += check_session(session_of(content, str(path)))
    except InputError as fault:
        cause = fault.__cause__
        where = cause.where if isinstance(cause, SchemaError) else "/"
        findings.append(_finding(where, str(getattr(cause, "what", fault.what))))
    return tuple(sorted(findings, key=lambda finding: -finding.severity))


def finding_document(finding: Finding) -> dict[str, str]:
    """Return a finding on a session file as a JSON object."""
    severity = finding.severity.name.lower()
    return {"severity": severity, "where": finding.where, "what": finding.text}


def _finding(where: str, what: str, severity: Severity = Severity.ERROR) -> Finding:
    """Return the finding that a file is invalid, or, as a warning, implausible."""
    code = "invalid" if severity is Severity.ERROR else "implausible"
    return Finding(code, severity, printable(what, 400), where=printable(where))


def check_session(session: Session) -> Iterator[Finding]:
    """Yield findings on contradictions and implausible values in a session."""
    for state in session.mass_states:
        matrix, where = state.added.matrix, f"/mass_states/{state.name}"
        largest = np.abs(matrix).max()  # what is not a number is below no limit
        if not (largest < np.inf and np.all(np.abs(matrix - matrix.T) <= 1e-9 * largest)):
            yield _finding(where, "delta_mass is not finite and symmetric")
    names = [channel.name for channel in session.channels]
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield _finding("/channels", f"{name} occurs in it twice")
    for channel in session.channels:
        if abs(channel.sign) != 1.0:
            yield _finding(f"/channels {channel.name}", f"has sign {channel.sign}")
    labels: set[str] = set()
    states = {state.name for state in session.mass_states}
    for number, run in enumerate(session.runs, start=1):
        where = f"/runs/r{number:03d}_{run.label}"
        if run.label in labels:
            yield _finding(where, "occurs in the file twice")
        labels.add(run.label)
        if run.mass_state not in states:
            yield _finding(where, f"mass state {run.mass_state} is not described")
        if run.is_accepted and not any(len(group.time_s) for group in run.groups):
            yield _finding(where, "is accepted but has no sample")
        for group in run.groups:
            yield from _sample_findings(group, f"{where}/{group.name}")
    if not session.runs:
        yield _finding("/runs", "there is no run", Severity.WARNING)


def _sample_findings(group: SampleGroup, where: str) -> Iterator[Finding]:
    """Yield findings on the times and values of a group."""
    if not np.all(np.isfinite(group.time_s)) or np.any(np.diff(group.time_s) <= 0):
        yield _finding(where, "time is not increasing")
    for name, values in group.values.items():
        if n_infinite := int(np.isinf(values).sum()):
            what = counted(n_infinite, "value is infinite", "values are infinite")
            yield _finding(f"{where}/{name}", what)
        if len(values) and np.isnan(values).all():
            yield _finding(f"{where}/{name}", "has no value in this run", Severity.WARNING)
