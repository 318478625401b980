"""Defines a bench session, the complete input of the identification, and makes one of arrays."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dbc.codec import Quality
from dbc.frames import FrameBatch
from dbc.words import InputError

from .channels import Channel, Quantity, paper_channels
from .runs import ADDED, BASELINE, Excitation, Run, RunStatus, SampleGroup
from .vehicle import AddedMass, BodyWeight, HubWeight, MassState, Vehicle, Weight


@dataclass(frozen=True, slots=True)
class Session:
    """A bench session: the complete input of the identification."""

    vehicle: Vehicle
    channels: tuple[Channel, ...]
    """All channels of the runs."""
    mass_states: tuple[MassState, ...]
    runs: tuple[Run, ...]
    """The runs, in order of recording."""
    provenance: Mapping[str, str]
    """Origin of the data: uuid, created, software, dbc (text), bench_toml (text), hashes."""

    @property
    def accepted(self) -> tuple[Run, ...]:
        """The accepted runs, in order of recording."""
        return tuple(run for run in self.runs if run.is_accepted)

    @property
    def used_channels(self) -> tuple[Channel, ...]:
        """The channels that measure a quantity of the vehicle."""
        return tuple(c for c in self.channels if c.quantity is not Quantity.UNUSED)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each channel, by its name."""
        return {channel.name: channel.unit for channel in self.channels}

    @property
    def frames(self) -> FrameBatch:
        """All raw frames in order of time; frames in two runs only once."""
        parts, last_ns = list[FrameBatch](), -(1 << 63)
        for run in sorted(self.runs, key=lambda run: run.t0_ns):
            if len(run.frames):  # a window holds all frames of its time
                parts.append(run.frames.select(run.frames.t_ns > last_ns))
                last_ns = max(last_ns, int(run.frames.t_ns.max()))
        return FrameBatch.concatenate(parts).by_time()


def notes_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the notes that persons wrote, each with its run and its writer.

    `provenance`: provenance of a session from any source; other text than our JSON stays as it is.
    """

    def note_words(note: Mapping[str, Any]) -> str:
        run_words = f"{note['label']}: " if note["label"] else ""
        # A note without a name is a mark set by the terminal, not written by a person.
        return f"{run_words}{note['text']} ({note['by']})" if note["by"] else ""

    return _parsed(provenance.get("notes", ""), note_words)


def overrides_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the warnings that were overridden: subject, reason and name; as `notes_of`."""
    return _parsed(provenance.get("overrides", ""), "{0[subject]}: {0[reason]} ({0[by]})".format)


def _parsed(text: str, words_of: Callable[[Mapping[str, Any]], str]) -> tuple[str, ...]:
    """Return the items of a list in JSON as words, each once; the text itself if it is no list."""
    try:
        return tuple(dict.fromkeys(line for item in json.loads(text) if (line := words_of(item))))
    except (ValueError, KeyError, TypeError, RecursionError):
        return (text,) if text else ()


ArrayRun = tuple[str, str, Mapping[str, tuple[ArrayLike, ArrayLike]]]
AddedMassLike = AddedMass | Sequence[Weight] | ArrayLike


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
    channels_given = tuple(paper_channels() if channels is None else channels)
    known = {channel.name: channel for channel in channels_given}
    if len(known) < len(channels_given):
        raise InputError("channels", "two have the same name", "give each its own name")
    counts: dict[tuple[str, Excitation], int] = {}
    session_runs = []
    for number, (mass_state, excitation, records) in enumerate(runs, start=1):
        where = f"run {number}"
        if mass_state not in (BASELINE, ADDED):
            raise InputError(where, f"mass state {mass_state!r}", f"use {BASELINE} or {ADDED}")
        if excitation not in list(Excitation):
            raise InputError(where, f"excitation {excitation!r}", f"use {', '.join(Excitation)}")
        kind = (mass_state, Excitation(excitation))
        counts[kind] = counts.get(kind, 0) + 1
        session_runs.append(
            Run(
                mass_state=mass_state,
                excitation=kind[1],
                repeat=counts[kind],
                t0_ns=0,
                bump_s=bump_s,
                groups=_groups(where, records, known),
                status=RunStatus.ACCEPTED,
            )
        )
    used = {name for run in session_runs for group in run.groups for name in group.values}
    return Session(
        vehicle=vehicle if isinstance(vehicle, Vehicle) else Vehicle(vehicle or "vehicle"),
        channels=tuple(channel for name, channel in known.items() if name in used),
        mass_states=(MassState(BASELINE), MassState(ADDED, _added_mass(delta_mass))),
        runs=tuple(session_runs),
        provenance={"source": "arrays"},
    )


def _groups(
    where: str, records: Mapping[str, tuple[ArrayLike, ArrayLike]], known: Mapping[str, Channel]
) -> tuple[SampleGroup, ...]:
    """Return the samples of a run: channels with the same times are in one group.

    `records`: times, s, and values by channel.  `known`: the channels by name.  `where`: the run,
    for errors.  Raises InputError if a record cannot be used, or there is none.
    """
    by_times: dict[bytes, tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]] = {}
    for name, (times, samples) in records.items():
        if name not in known:
            what = f"channel {name!r} is not described"
            raise InputError(where, what, f"channels are {', '.join(known)}")
        t_s, values = (_numbers(where, f"channel {name}: ", data) for data in (times, samples))
        if t_s.shape != values.shape or t_s.ndim != 1 or len(t_s) < 2:
            what = f"channel {name}: {t_s.shape} times for {values.shape} values"
            raise InputError(where, what, "give equally many, at least two, in one dimension")
        if not (np.isfinite(t_s).all() and (np.diff(t_s) > 0).all()):
            what = f"channel {name}: times are not increasing numbers"
            raise InputError(where, what, "sort them and remove doubles")
        by_times.setdefault(t_s.tobytes(), (t_s, {}))[1][name] = values
    if not by_times:
        raise InputError(where, "has no channel", "give at least one")
    return tuple(
        SampleGroup(
            name=next(iter(channel_values)),
            time_s=t_s,
            t_ns=np.rint(t_s * 1e9).astype(np.int64),
            values=channel_values,
            quality=np.asarray(
                np.isnan([*channel_values.values()]).any(axis=0) * np.uint8(Quality.MISSING)
            ),
        )
        for t_s, channel_values in by_times.values()
    )


def _numbers(where: str, subject: str, data: Any) -> NDArray[np.float64]:
    """Return data as an array; raises InputError if they are no real numbers."""
    try:
        return np.array(data, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(where, f"{subject}{error}", "give real numbers") from error


def _added_mass(given: AddedMassLike | None) -> AddedMass:
    """Return added mass given as weights, as a matrix or as its diagonal; None adds none.

    Raises InputError for another shape, or numbers that are not finite.
    """
    if given is None or isinstance(given, AddedMass):
        return given or AddedMass()
    if isinstance(given, Sequence) and all(isinstance(w, BodyWeight | HubWeight) for w in given):
        return AddedMass(tuple(w for w in given if isinstance(w, BodyWeight | HubWeight)))
    matrix = _numbers("delta_mass", "", given)
    matrix = np.diag(matrix) if matrix.ndim == 1 else matrix
    if matrix.shape != (7, 7) or not np.isfinite(matrix).all():
        what = f"an array of shape {matrix.shape}"
        raise InputError("delta_mass", what, "give 7 x 7 numbers, its diagonal, or weights")
    return AddedMass(matrix=matrix)
