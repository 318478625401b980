"""From the wire to a session file.

What is public here is loaded when it is first asked for: a terminal that is to show its first
screen within a second reads no session file before.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .arrays import session_from_arrays
    from .bench.config import Bench, bench_codec, load_bench
    from .bus.interfaces import open_source
    from .channels import Channel, Quantity, paper_channels
    from .control.messages import Status
    from .derive.from_logs import session_from_log
    from .errors import BumpbenchError, BusError, InputError
    from .formats.log import read_log
    from .recorder.recorder import Recorder
    from .runs import ADDED, BASELINE, Event, Excitation, Losses, Run, RunStatus, SampleGroup
    from .samples.mapping import map_channels
    from .session import read_foreign_session, read_session, validate_session, write_session
    from .sessions import Session
    from .vehicle import (
        FORD_GRANADA,
        AddedMass,
        BodyWeight,
        Corner,
        HubWeight,
        MassState,
        Vehicle,
        VehicleGeometry,
        VehicleParameters,
    )

_HOMES = {
    "arrays": ("session_from_arrays",),
    "bench.config": ("Bench", "bench_codec", "load_bench"),
    "bus.interfaces": ("open_source",),
    "channels": ("Channel", "Quantity", "paper_channels"),
    "control.messages": ("Status",),
    "derive.from_logs": ("session_from_log",),
    "errors": ("BumpbenchError", "BusError", "InputError"),
    "formats.log": ("read_log",),
    "recorder.recorder": ("Recorder",),
    "samples.mapping": ("map_channels",),
    "sessions": ("Session",),
    "runs": (
        "ADDED", "BASELINE", "Event", "Excitation", "Losses", "Run", "RunStatus", "SampleGroup",

    ),
    "session": ("read_foreign_session", "read_session", "validate_session", "write_session"),
    "vehicle": (
        "FORD_GRANADA", "AddedMass", "BodyWeight", "Corner", "HubWeight", "MassState", "Vehicle",
        "VehicleGeometry", "VehicleParameters",
    ),
}  # fmt: skip
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "ADDED",
    "BASELINE",
    "FORD_GRANADA",
    "AddedMass",
    "Bench",
    "BodyWeight",
    "BumpbenchError",
    "BusError",
    "Channel",
    "Corner",
    "Event",
    "Excitation",
    "HubWeight",
    "InputError",
    "Losses",
    "MassState",
    "Quantity",
    "Recorder",
    "Run",
    "RunStatus",
    "SampleGroup",
    "Session",
    "Status",
    "Vehicle",
    "VehicleGeometry",
    "VehicleParameters",
    "bench_codec",
    "load_bench",
    "map_channels",
    "open_source",
    "paper_channels",
    "read_foreign_session",
    "read_log",
    "read_session",
    "session_from_arrays",
    "session_from_log",
    "validate_session",
    "write_session",
]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'daq' has no attribute {name!r}")
    value: object = getattr(import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
