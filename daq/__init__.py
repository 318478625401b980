"""From the wire to a session file."""

from .arrays import session_from_arrays
from .channels import Channel, Quantity, paper_channels
from .errors import BumpbenchError, BusError, InputError
from .runs import (
    ADDED,
    BASELINE,
    Event,
    Excitation,
    Losses,
    Run,
    RunStatus,
    SampleGroup,
    Session,
)
from .session import read_foreign_session, read_session, validate_session, write_session
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
    "read_foreign_session",
    "read_session",
    "session_from_arrays",
    "validate_session",
    "write_session",
]
