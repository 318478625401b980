"""MATLAB v5: one struct of runs, in it one struct a sample clock, with times and units."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...runs import Run, SampleGroup
from ...sessions import Session
from .raw_frames import frames_left_out

_NAME_LENGTH = 63
_MAX_BYTES = 2**31 - 1
"""Bytes of one variable, the most that a file of this version can hold."""


def write_mat(session: Session, path: Path) -> tuple[str, ...]:
    """Write a MAT file: ``runs.RUN.GROUP.CHANNEL``, with ``t`` in s and ``units.CHANNEL``.

    Beside the channels of a group stand ``t_ns`` (int64, bus time) and ``quality`` (uint8); a run
    has ``mass_state``, ``excitation``, ``repeat``, ``status``, ``reasons`` and ``t0_ns``.
    ``vehicle`` and ``channels`` state what was measured and where.

    Returns what the format cannot hold, of what there is in the session.  Raises InputError if the
    session is larger than such a file can be.
    """
    from scipy.io import savemat

    size = sum(g.time_s.nbytes * (3 + len(g.values)) for run in session.runs for g in run.groups)
    if size > _MAX_BYTES:
        what = f"has {size} bytes of samples, and MATLAB v5 holds 2 GB"
        raise InputError("session", what, "choose runs with --run, or another format")
    runs = _fields((run.label, _run(run, session)) for run in session.runs)
    vehicle: dict[str, Any] = {"name": session.vehicle.name}
    if session.vehicle.geometry is not None:
        vehicle |= {f"{name}_m": v for name, v in asdict(session.vehicle.geometry).items()}
    channels = _fields(
        (
            channel.name,
            {
                "name": channel.name,
                "quantity": str(channel.quantity),
                "unit": channel.unit,
                "signal": channel.signal,
                "corner": str(channel.corner or ""),
                "x_m": channel.x_m,
                "y_m": channel.y_m,
            },
        )
        for channel in session.channels
    )
    savemat(
        path,
        {"runs": runs, "channels": channels, "vehicle": vehicle},
        long_field_names=True,
        do_compression=True,
        oned_as="column",
    )
    return frames_left_out(session)


def _run(run: Run, session: Session) -> dict[str, Any]:
    units = {channel.name: channel.unit for channel in session.channels}
    about = {
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": run.repeat,
        "status": str(run.status),
        "reasons": "\n".join(run.reasons),
        "t0_ns": np.int64(run.t0_ns),
    }
    groups = ((group.name, _group(group, units)) for group in run.groups)
    return about | _fields(groups, taken=set(about))


def _group(group: SampleGroup, units: dict[str, str]) -> dict[str, Any]:
    fixed = {"t": group.time_s, "t_ns": group.t_ns, "quality": group.quality}
    values = _fields(group.values.items(), taken={*fixed, "units"})
    own = _fields(((name, units[name]) for name in group.values), taken={*fixed, "units"})
    return {**fixed, **values, "units": {"t": "s", **own}}


def _fields(items: Iterable[tuple[str, Any]], taken: Collection[str] = ()) -> dict[str, Any]:
    """Return items under names that MATLAB allows for fields, each once."""
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
