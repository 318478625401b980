"""Selects a part of a session: the channels of some sensors, the frames of some buses."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from .errors import InputError
from .runs import Run
from .sessions import Session
from .signal_names import sensor_of_signal


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
