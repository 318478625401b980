"""Records, reads and simulates measurements: from the wire to a session file.

The rooms have the rest: `daq.bench.config` reads a bench, `daq.formats.log` a log,
`daq.recorder.recorder` records.
"""

from dbc.words import BumpbenchError, InputError

from .bus.source import BusError
from .channels import Channel, Quantity, paper_channels
from .runs import ADDED, BASELINE, Event, Excitation, Losses, Run, RunStatus, SampleGroup
from .session import read_session, validate_session, write_session
from .sessions import Session, session_from_arrays
from .vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    HubWeight,
    MassState,
    Vehicle,
    VehicleGeometry,
    VehicleParameters,
)

__all__ = [
    "ADDED",
    "BASELINE",
    "FORD_GRANADA",
    "AddedMass",
    "BodyWeight",
    "BumpbenchError",
    "BusError",
    "Channel",
    "Corner",
    "Event",
    "Excitation",
    "Fact",
    "HubWeight",
    "InputError",
    "Losses",
    "MassState",
    "Quantity",
    "Run",
    "RunStatus",
    "SampleGroup",
    "Session",
    "Vehicle",
    "VehicleGeometry",
    "VehicleParameters",
    "paper_channels",
    "read_session",
    "session_from_arrays",
    "validate_session",
    "write_session",
]
