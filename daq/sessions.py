"""Defines a bench session: the complete input of the identification."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

from .channels import Channel, Quantity, sensor_of_signal
from .documents import html_line, html_table
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

    def _repr_html_(self) -> str:
        """Return the HTML that a notebook shows: runs and channels."""
        return _html(self)


def _html(session: Session) -> str:
    """Return vehicle, runs and channels of a session as HTML."""
    runs = [
        [
            run.label,
            str(run.status),
            str(max((len(group.time_s) for group in run.groups), default=0)),
            str(run.losses.measured),
            "; ".join(run.reasons),
        ]
        for run in session.runs
    ]
    channels = [
        [c.name, str(c.quantity), c.unit, c.corner.value if c.corner else "body", f"{c.delay_s:g}"]
        for c in session.channels
    ]
    weights = {
        state.name: sum(weight.mass_kg for weight in state.added.weights)
        for state in session.mass_states
    }
    loads = ", ".join(f"{name} (+{kg:g} kg)" if kg else name for name, kg in weights.items())
    return (
        html_line(f"Session of {session.vehicle.name}; mass states: {loads}")
        + html_table("Runs", ["run", "status", "samples", "lost frames", "reasons"], runs)
        + html_table("Channels", ["channel", "quantity", "unit", "place", "delay, s"], channels)
    )


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
    runs = tuple(_part(run, names, buses) for run in session.runs)
    return replace(session, channels=channels, runs=runs)


def _part(run: Run, channels: Collection[str], buses: Collection[int]) -> Run:
    groups = (
        replace(group, values={n: v for n, v in group.values.items() if n in channels})
        for group in run.groups
    )
    frames = run.frames.on_buses(buses)
    return replace(run, groups=tuple(group for group in groups if group.values), frames=frames)


def notes_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the notes that persons wrote, each with its run and its writer.

    `provenance`: provenance of a session from any source; text that is not our JSON is returned
    unchanged.
    """
    return _parsed(provenance.get("notes", ""), _note)


def overrides_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the warnings that were overridden: subject, reason and name."""
    return _parsed(provenance.get("overrides", ""), _override)


def _parsed(text: str, words: Callable[[Mapping[str, Any]], str]) -> tuple[str, ...]:
    try:
        return tuple(dict.fromkeys(line for item in json.loads(text) if (line := words(item))))
    except (ValueError, KeyError, TypeError, RecursionError):
        return (text,) if text else ()


def _note(note: Mapping[str, Any]) -> str:
    if not note["by"]:  # a mark set by the terminal, not written by a person
        return ""
    about = f"{note['label']}: " if note["label"] else ""
    return f"{about}{note['text']} ({note['by']})"


def _override(override: Mapping[str, Any]) -> str:
    return f"{override['subject']}: {override['reason']} ({override['by']})"
