"""Writes MATLAB v5: a struct of runs, each with a struct per sample clock with times and units."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...runs import Run, SampleGroup
from ...sessions import Session
from .frames import frames_left_out

_NAME_LENGTH = 63
_MAX_BYTES = 2**31 - 1
"""Largest size of one variable in a file of this version, bytes."""


def write_mat(session: Session, path: Path) -> tuple[str, ...]:
    """Write a MAT file: ``runs.RUN.GROUP.CHANNEL``, with ``t`` in s and ``units.CHANNEL``.

    In addition to its channels a group has ``t_ns`` (int64, bus time) and ``quality`` (uint8); a
    run has ``mass_state``, ``excitation``, ``repeat``, ``status``, ``reasons``, ``t0_ns`` and
    ``bump_s``.  ``vehicle`` and ``channels`` describe the measured quantities and their places.

    Returns notes on the contents of the session that the format cannot hold.  Raises InputError if
    the session is too large for such a file.
    """
    from scipy.io import savemat

    size = sum(g.time_s.nbytes * (3 + len(g.values)) for run in session.runs for g in run.groups)
    if size > _MAX_BYTES:
        what = f"has {size} bytes of samples, and MATLAB v5 holds 2 GB"
        raise InputError("session", what, "choose runs with --run, or another format")
    vehicle: dict[str, Any] = {"name": session.vehicle.name}
    if session.vehicle.geometry is not None:
        vehicle |= {f"{name}_m": v for name, v in asdict(session.vehicle.geometry).items()}
    channels = {
        channel.name: asdict(channel)
        | {"quantity": str(channel.quantity), "corner": str(channel.corner or "")}
        for channel in session.channels
    }
    variables = {
        "runs": _fields((run.label, _run(run, session.units)) for run in session.runs),
        "channels": _fields(channels.items()),
        "vehicle": vehicle,
    }
    savemat(path, variables, long_field_names=True, do_compression=True, oned_as="column")
    return frames_left_out(session)


def _run(run: Run, units: dict[str, str]) -> dict[str, Any]:
    about = {
        "mass_state": run.mass_state,
        "excitation": str(run.excitation),
        "repeat": run.repeat,
        "status": str(run.status),
        "reasons": "\n".join(run.reasons),
        "t0_ns": np.int64(run.t0_ns),
        "bump_s": run.bump_s,
    }
    return about | _fields(((g.name, _group(g, units)) for g in run.groups), about)


def _group(group: SampleGroup, units: dict[str, str]) -> dict[str, Any]:
    taken = ("t", "t_ns", "quality", "units")
    named = _fields(((name, units[name]) for name in group.values), taken)
    fixed = (group.time_s, group.t_ns, group.quality, {"t": "s", **named})
    return dict(zip(taken, fixed, strict=True)) | _fields(group.values.items(), taken)


def _fields(items: Iterable[tuple[str, Any]], taken: Collection[str] = ()) -> dict[str, Any]:
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
