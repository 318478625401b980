"""Describes a session, without samples and raw frames, as a JSON text for every export.

Other tools ignore the text and see only their own format; `daq.formats.exported` rebuilds the
session from the text and the samples.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from dbc.words import counted

from ..channels import Channel
from ..errors import InputError
from ..runs import Event, Excitation, Losses, Run, RunStatus, SampleGroup, run_label
from ..sessions import Session
from ..vehicle import (
    AddedMass,
    BodyWeight,
    Fact,
    HubWeight,
    MassState,
    Structure,
    Vehicle,
    VehicleGeometry,
)

NAME = "bumpbench.json"
"""Name of the text as an attachment, and part of a sidecar's name."""
KEY = "bumpbench"
"""Name of the text as an item of metadata or a variable."""
_VERSION = 1
_ADVICE = "export the session again"
_MAX_SAMPLES = 1 << 28


@dataclass(frozen=True, slots=True)
class GroupDescription:
    """Channels that share one sample clock."""

    name: str
    """Name of the message."""
    channels: tuple[str, ...]
    """Names of the channels, in their order."""
    samples: int
    """Number of samples."""
    marks: tuple[tuple[int, int], ...]
    """Position and quality bits of the samples with any quality bit."""
    file: str
    """File with the samples, if each group has its own."""


@dataclass(frozen=True, slots=True)
class FrameSpan:
    """Frames of a run in the log that the description belongs to."""

    first: int
    """Position of the first frame in the log."""
    count: int
    """Number of frames."""
    t_ns: int
    """Time stamp of the first frame, ns, which a log may state in another time zone."""


@dataclass(frozen=True, slots=True)
class RunDescription:
    """A run without its samples; fields as in `daq.runs.Run`."""

    mass_state: str
    excitation: Excitation
    repeat: int
    t0_ns: int
    bump_s: float
    status: RunStatus
    reasons: tuple[str, ...]
    losses: Losses
    events: tuple[Event, ...]
    groups: tuple[GroupDescription, ...]
    span: FrameSpan | None

    @property
    def label(self) -> str:
        """`baseline_bounce_1` and the like."""
        return run_label(self.mass_state, self.excitation, self.repeat)


@dataclass(frozen=True, slots=True)
class StateDescription:
    """A mass state; fields as in `daq.vehicle`."""

    name: str
    body: tuple[BodyWeight, ...]
    hubs: tuple[HubWeight, ...]
    order: tuple[bool, ...]
    """True for each weight on the body, in the order of all weights."""
    matrix: tuple[tuple[float, ...], ...]


@dataclass(frozen=True, slots=True)
class VehicleDescription:
    """The vehicle as far as it is known beforehand; fields as in `daq.vehicle.Vehicle`."""

    name: str
    geometry: VehicleGeometry | None
    structure: Structure
    facts: tuple[Fact, ...]
    elements: dict[str, bool]


@dataclass(frozen=True, slots=True)
class Description:
    """A session without its samples and raw frames."""

    version: int
    """Version of the description's format."""
    vehicle: VehicleDescription
    """The vehicle."""
    channels: tuple[Channel, ...]
    """All channels with all of their fields."""
    mass_states: tuple[StateDescription, ...]
    """States of loading of the vehicle."""
    runs: tuple[RunDescription, ...]
    """Runs, in order of recording."""
    provenance: dict[str, Any]
    """Origin of the session; bench.toml and databases in full, with all of their bytes."""
    style: tuple[str, str] = (",", ".")
    """Separator and decimal mark, if the samples are text."""


def sidecar_of(path: Path) -> Path:
    """Return the path of a description next to its export: ``car.uff.bumpbench.json``."""
    return path.with_name(f"{path.name}.{NAME}")


def describe(
    session: Session,
    files: Mapping[tuple[str, str], str] | None = None,
    spans: Mapping[str, FrameSpan] | None = None,
    style: tuple[str, str] = (",", "."),
) -> Description:
    """Return the description of a session.

    `files`: the file of each run and group, if each has its own.  `spans`: the frames of each run,
    if the samples are in a log.  `style`: separator and decimal mark, if the samples are text.
    """
    vehicle = session.vehicle
    return Description(
        _VERSION,
        VehicleDescription(
            vehicle.name, vehicle.geometry, vehicle.structure, vehicle.facts, dict(vehicle.elements)
        ),
        session.channels,
        tuple(_state(state) for state in session.mass_states),
        tuple(_run(run, files or {}, (spans or {}).get(run.label)) for run in session.runs),
        dict(session.provenance),
        style,
    )


def text_of(description: Description) -> str:
    """Return a description as JSON."""
    return json.dumps(_plain(asdict(description)), indent=1)


def session_text(session: Session) -> str:
    """Return the description of a session as JSON."""
    return text_of(describe(session))


def description_of(text: str | bytes, where: str) -> Description:
    """Return the description in a JSON text.

    `where`: the file, for messages.  Raises InputError if it is not a description, or of a later
    version.
    """
    try:
        found = TypeAdapter(Description).validate_python(json.loads(text))
    except (ValidationError, ValueError, RecursionError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else None
        place = ".".join(map(str, first["loc"])) if first else "the text"
        what = f"its description of the session is damaged ({place})"
        raise InputError(where, what, _ADVICE) from error
    if not all(isinstance(value, str) for value in found.provenance.values()):
        raise InputError(where, "its provenance is not a text", _ADVICE)
    if found.version > _VERSION:
        what = f"describes a session in version {found.version}; this program knows {_VERSION}"
        raise InputError(where, what, "use a newer bumpbench")
    return found


Columns = tuple[NDArray[np.float64], NDArray[np.int64] | None, Mapping[str, NDArray[np.float64]]]
"""Times since t0, s; bus times, ns, if they are kept; and values by channel."""


def session_of(
    description: Description,
    samples: Callable[[RunDescription, GroupDescription], Columns],
    where: str,
) -> Session:
    """Return a session; `samples` is called for each group.

    Raises InputError if samples do not fit the description.
    """
    try:
        runs = tuple(
            Run(
                one.mass_state,
                one.excitation,
                one.repeat,
                one.t0_ns,
                one.bump_s,
                tuple(_group(one, group, samples(one, group)) for group in one.groups),
                one.status,
                one.reasons,
                one.losses,
                one.events,
            )
            for one in description.runs
        )
        about = description.vehicle
        vehicle = Vehicle(about.name, about.geometry, about.structure, about.facts, about.elements)
        states = tuple(_mass_state(state) for state in description.mass_states)
    except (ValueError, LookupError, TypeError) as error:
        what = f"does not match its description: {error}"
        raise InputError(where, what, _ADVICE) from error
    return Session(vehicle, description.channels, states, runs, description.provenance)


def _group(run: RunDescription, about: GroupDescription, columns: Columns) -> SampleGroup:
    time_s, t_ns, values = columns
    n = len(time_s)
    if n != about.samples or n > _MAX_SAMPLES:
        raise ValueError(
            f"{run.label}/{about.name} has {counted(n, 'sample')}, not {about.samples}"
        )
    if not np.isfinite(time_s).all() or not (np.diff(time_s) > 0.0).all():
        raise ValueError(f"the times of {run.label}/{about.name} do not increase")
    quality = np.zeros(n, np.uint8)
    for position, bits in about.marks:
        if not 0 <= position < n or not 0 <= bits < 256:
            raise ValueError(f"{run.label}/{about.name} has no sample {position}")
        quality[position] = bits
    if t_ns is None:
        t_ns = run.t0_ns + np.rint(time_s * 1e9).astype(np.int64)
    own = {name: np.asarray(values[name], np.float64) for name in about.channels}
    return SampleGroup(about.name, np.asarray(time_s, np.float64), t_ns, own, quality)


def _run(run: Run, files: Mapping[tuple[str, str], str], span: FrameSpan | None) -> RunDescription:
    groups = tuple(
        GroupDescription(
            group.name,
            tuple(group.values),
            len(group.time_s),
            tuple((int(i), int(group.quality[i])) for i in np.flatnonzero(group.quality)),
            files.get((run.label, group.name), ""),
        )
        for group in run.groups
    )
    return RunDescription(
        run.mass_state,
        run.excitation,
        run.repeat,
        run.t0_ns,
        run.bump_s,
        run.status,
        run.reasons,
        run.losses,
        run.events,
        groups,
        span,
    )


def _state(state: MassState) -> StateDescription:
    weights = state.added.weights
    return StateDescription(
        state.name,
        tuple(w for w in weights if isinstance(w, BodyWeight)),
        tuple(w for w in weights if isinstance(w, HubWeight)),
        tuple(isinstance(w, BodyWeight) for w in weights),
        tuple(map(tuple, state.added.matrix.tolist())),
    )


def _mass_state(state: StateDescription) -> MassState:
    body, hubs = iter(state.body), iter(state.hubs)
    if (sum(state.order), len(state.order)) != (len(state.body), len(state.body) + len(state.hubs)):
        raise ValueError(f"the weights of {state.name} are incomplete")
    weights = tuple(next(body) if on_body else next(hubs) for on_body in state.order)
    return MassState(state.name, AddedMass(weights, np.array(state.matrix, np.float64)))


def _plain(value: Any) -> Any:
    """Return a tree for JSON; numbers that JSON lacks become words."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value
