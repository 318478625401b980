"""Defines a bench session: the complete input of the identification."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from dbc.frames import FrameBatch

from .channels import Channel, Quantity, sensor_of_signal
from .errors import InputError
from .runs import Run
from .vehicle import MassState, Vehicle


@dataclass(frozen=True, slots=True)
class Session:
    """A bench session: the complete input of the identification."""

    vehicle: Vehicle
    """The vehicle as far as it is known beforehand."""
    channels: tuple[Channel, ...]
    """All channels of the runs."""
    mass_states: tuple[MassState, ...]
    """States of loading of the vehicle."""
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


def session_part(session: Session, sensors: Collection[str], buses: Collection[int]) -> Session:
    """Return a session with the channels of some sensors and the frames of some buses.

    Empty collections keep all.  Raises InputError if it has no channel of one of the sensors.
    """
    known = {sensor_of_signal(channel.signal) for channel in session.channels}
    for name in sensors:
        if not name or name not in known:
            others = ", ".join(sorted(known - {""})) or "none: its bench has no [[sensor]]"
            raise InputError(f"--sensor {name}", "is not in the session", f"its sensors: {others}")
    channels = tuple(
        c for c in session.channels if not sensors or sensor_of_signal(c.signal) in sensors
    )
    names = {channel.name for channel in channels}
    runs = []
    for run in session.runs:
        groups = (
            replace(group, values={n: v for n, v in group.values.items() if n in names})
            for group in run.groups
        )
        kept = tuple(group for group in groups if group.values)
        runs.append(replace(run, groups=kept, frames=run.frames.on_buses(buses)))
    return replace(session, channels=channels, runs=tuple(runs))


def notes_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the notes that persons wrote, each with its run and its writer.

    `provenance`: provenance of a session from any source; text that is not our JSON is returned
    unchanged.
    """

    def words(note: Mapping[str, Any]) -> str:
        if not note["by"]:  # a mark set by the terminal, not written by a person
            return ""
        about = f"{note['label']}: " if note["label"] else ""
        return f"{about}{note['text']} ({note['by']})"

    return _parsed(provenance.get("notes", ""), words)


def overrides_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the warnings that were overridden: subject, reason and name."""

    def words(override: Mapping[str, Any]) -> str:
        return f"{override['subject']}: {override['reason']} ({override['by']})"

    return _parsed(provenance.get("overrides", ""), words)


def _parsed(text: str, words: Callable[[Mapping[str, Any]], str]) -> tuple[str, ...]:
    """Return the items of a list in JSON as words, each once; the text itself if it is no list."""
    try:
        return tuple(dict.fromkeys(line for item in json.loads(text) if (line := words(item))))
    except (ValueError, KeyError, TypeError, RecursionError):
        return (text,) if text else ()
