"""Makes sessions from plain arrays: other people's data, simulations, tests."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dbc.samples import Quality

from .channels import Channel, paper_channels
from .errors import InputError
from .runs import ADDED, BASELINE, Excitation, Run, RunStatus, SampleGroup
from .sessions import Session
from .vehicle import AddedMass, BodyWeight, HubWeight, MassState, Vehicle

ArrayRun = tuple[str, str, Mapping[str, tuple[ArrayLike, ArrayLike]]]
AddedMassLike = AddedMass | Sequence[BodyWeight | HubWeight] | ArrayLike


def session_from_arrays(
    runs: Iterable[ArrayRun],
    channels: Iterable[Channel] | None = None,
    delta_mass: AddedMassLike | None = None,
    vehicle: Vehicle | str | None = None,
    bump_s: float = float("nan"),
) -> Session:
    """Return a session of arrays in memory: all runs accepted, repeats counted in the order given.

    `runs`: (mass_state, excitation, {channel: (t_s, values)}) each; "baseline" or "added", a
    value of `Excitation`, times in s, increasing, (n,), and values SI, (n,), NaN where a sample
    is missing.  A record may begin at rest before the bump (then the noise is measured there) or
    in the free decay. `channels`: the channels named in `runs`; default: the seven accelerations
    of the paper, z_s theta phi z_uA z_uB z_uC z_uD, z_s within 0.2 m of the CG.  `delta_mass`:
    what the state "added" adds: a mass matrix about the baseline CG, (7, 7), its diagonal, (7,),
    or weights with their positions. `vehicle`: as far as it is known, or its name.  `bump_s`:
    duration of the bump, s; NaN: the start of the decay is found from the misfit.  Raises
    InputError, with run and channel, if the data are inconsistent.
    """
    described = tuple(paper_channels() if channels is None else channels)
    known = {channel.name: channel for channel in described}
    if len(known) < len(described):
        raise InputError("channels", "two have the same name", "give each its own name")
    counts: dict[tuple[str, Excitation], int] = {}
    result = []
    for number, entry in enumerate(runs, start=1):
        where = f"run {number}"
        items: tuple[object, ...] = entry  # the caller's, of any length
        if len(items) != 3:
            what = f"has {len(items)} items"
            raise InputError(where, what, "give mass state, excitation and a dict of channels")
        mass_state, excitation, records = entry
        if mass_state not in (BASELINE, ADDED):
            raise InputError(where, f"mass state {mass_state!r}", f"use {BASELINE} or {ADDED}")
        if excitation not in list(Excitation):
            raise InputError(where, f"excitation {excitation!r}", f"use {', '.join(Excitation)}")
        key = (mass_state, Excitation(excitation))
        counts[key] = counts.get(key, 0) + 1
        result.append(
            Run(
                mass_state=mass_state,
                excitation=key[1],
                repeat=counts[key],
                t0_ns=0,
                bump_s=bump_s,
                groups=_groups(where, records, known),
                status=RunStatus.ACCEPTED,
            )
        )
    used = {name for run in result for group in run.groups for name in group.values}
    return Session(
        vehicle=vehicle if isinstance(vehicle, Vehicle) else Vehicle(vehicle or "vehicle"),
        channels=tuple(channel for name, channel in known.items() if name in used),
        mass_states=(MassState(BASELINE), MassState(ADDED, _added_mass(delta_mass))),
        runs=tuple(result),
        provenance={"source": "arrays"},
    )


def _groups(
    where: str, records: Mapping[str, tuple[ArrayLike, ArrayLike]], known: Mapping[str, Channel]
) -> tuple[SampleGroup, ...]:
    """Group the channels that share their times."""
    clocks: list[tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]] = []
    for name, (times, samples) in records.items():
        if name not in known:
            what = f"channel {name!r} is not described"
            raise InputError(where, what, f"channels are {', '.join(known)}")
        t_s, values = _column(where, name, times), _column(where, name, samples)
        if t_s.shape != values.shape or len(t_s) < 2:
            what = f"channel {name}: {t_s.shape} times for {values.shape} values"
            raise InputError(where, what, "give as many times as values, at least two")
        if not (np.isfinite(t_s).all() and (np.diff(t_s) > 0).all()):
            what = f"channel {name}: times are not increasing numbers"
            raise InputError(where, what, "sort them and remove doubles")
        for clock_s, members in clocks:
            if np.array_equal(clock_s, t_s):
                members[name] = values
                break
        else:
            clocks.append((t_s, {name: values}))
    if not clocks:
        raise InputError(where, "has no channel", "give at least one")
    return tuple(
        SampleGroup(
            name=next(iter(members)),
            time_s=t_s,
            t_ns=np.rint(t_s * 1e9).astype(np.int64),
            values=members,
            quality=np.where(
                np.isnan(list(members.values())).any(axis=0),
                np.uint8(Quality.MISSING),
                np.uint8(0),
            ),
        )
        for t_s, members in clocks
    )


def _column(where: str, name: str, data: ArrayLike) -> NDArray[np.float64]:
    try:
        return np.array(data, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(where, f"channel {name}: {error}", "give real numbers") from error


def _added_mass(given: AddedMassLike | None) -> AddedMass:
    if given is None:
        return AddedMass()
    if isinstance(given, AddedMass):
        return given
    if isinstance(given, Sequence) and all(isinstance(w, BodyWeight | HubWeight) for w in given):
        return AddedMass(tuple(w for w in given if isinstance(w, BodyWeight | HubWeight)))
    try:
        matrix = np.array(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("delta_mass", str(error), "give numbers or weights") from error
    matrix = np.diag(matrix) if matrix.ndim == 1 else matrix
    if matrix.shape != (7, 7) or not np.isfinite(matrix).all():
        what = f"an array of shape {matrix.shape}"
        raise InputError("delta_mass", what, "give 7 x 7 numbers, its diagonal, or weights")
    return AddedMass(matrix=matrix)
