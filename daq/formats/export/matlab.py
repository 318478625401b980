"""Writes MATLAB v5: a struct of runs, each with a struct per sample clock with times and units."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...runs import Run, SampleGroup
from ...session.schema import TEXTS
from ...sessions import Session
from .. import description
from .raw_frames import frames_left_out

RUN_FIELDS = (
    "mass_state",
    "excitation",
    "repeat",
    "status",
    "reasons",
    "t0_ns",
    "bump_s",
    "events",
)
"""Fields of a run that are not sample groups."""
SAMPLE_FIELDS = ("t", "t_ns", "quality", "units")
"""Fields of a sample group that are not channels."""
_NAME_LENGTH = 63
_MAX_BYTES = 2**31 - 1
"""Largest size of one variable in a file of this version, bytes."""


def write_mat(session: Session, path: Path) -> tuple[str, ...]:
    """Write a MAT file: ``runs.RUN.GROUP.CHANNEL``, with ``t`` in s and ``units.CHANNEL``.

    In addition to its channels a group has ``t_ns`` (int64, bus time) and ``quality`` (uint8); a
    run has ``mass_state``, ``excitation``, ``repeat``, ``status``, ``reasons``, ``t0_ns``,
    ``bump_s`` and ``events``.  ``vehicle``, ``channels`` and ``mass_states`` describe the measured
    quantities and their places, ``config`` has bench.toml and databases, ``bumpbench`` the
    description of the session.

    Returns notes on the contents of the session that the format cannot hold.  Raises InputError if
    the session is too large for such a file.
    """
    from scipy.io import savemat

    size = sum(g.time_s.nbytes * (3 + len(g.values)) for run in session.runs for g in run.groups)
    if size > _MAX_BYTES:
        what = f"has {size} bytes of samples, and MATLAB v5 holds 2 GB"
        raise InputError("session", what, "choose runs with --run, or another format")
    runs = fields_of((run.label, _run(run, session)) for run in session.runs)
    vehicle: dict[str, Any] = {"name": session.vehicle.name}
    if session.vehicle.geometry is not None:
        vehicle |= {f"{name}_m": v for name, v in asdict(session.vehicle.geometry).items()}
    channels = fields_of(
        (
            channel.name,
            asdict(channel)
            | {"quantity": str(channel.quantity), "corner": str(channel.corner or "")},
        )
        for channel in session.channels
    )
    states = fields_of(
        (
            state.name,
            {
                "matrix": state.added.matrix,
                "weights": [
                    {name: str(v) if name == "corner" else v for name, v in asdict(weight).items()}
                    for weight in state.added.weights
                ],
            },
        )
        for state in session.mass_states
    )
    texts = {
        name: session.provenance[name].encode("utf-8", "replace").decode()
        for name in set(TEXTS) & session.provenance.keys()
    }
    about = description.session_text(session)
    savemat(
        path,
        {
            "runs": runs,
            "channels": channels,
            "vehicle": vehicle,
            "mass_states": states,
            "config": texts,
            description.KEY: about,
        },
        long_field_names=True,
        do_compression=True,
        oned_as="column",
    )
    return frames_left_out(session)


def _run(run: Run, session: Session) -> dict[str, Any]:
    about = {
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": run.repeat,
        "status": str(run.status),
        "reasons": "\n".join(run.reasons),
        "t0_ns": np.int64(run.t0_ns),
        "bump_s": run.bump_s,
        "events": [asdict(event) for event in run.events],
    }
    groups = ((group.name, _group(group, session.units)) for group in run.groups)
    return about | fields_of(groups, taken=RUN_FIELDS)


def _group(group: SampleGroup, units: dict[str, str]) -> dict[str, Any]:
    fixed = {"t": group.time_s, "t_ns": group.t_ns, "quality": group.quality}
    values = fields_of(group.values.items(), taken=SAMPLE_FIELDS)
    unit_fields = fields_of(((name, units[name]) for name in group.values), taken=SAMPLE_FIELDS)
    return {**fixed, **values, "units": {"t": "s", **unit_fields}}


def fields_of(items: Iterable[tuple[str, Any]], taken: Collection[str] = ()) -> dict[str, Any]:
    """Return items under different names that MATLAB allows for fields and that are not `taken`."""
    result: dict[str, Any] = {}
    for name, value in items:
        plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        field, number = plain[:_NAME_LENGTH], 1
        while field in result or field in taken:
            number += 1
            field = f"{plain[: _NAME_LENGTH - 4]}_{number}"
        result[field] = value
    return result
