"""From the wire to a session file."""

from .arrays import session_from_arrays
from .channels import Channel, Quantity, paper_channels
from .runs import Excitation, Run, RunStatus, SampleGroup, Session
from .session import read_session, write_session
from .vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    HubWeight,
    Vehicle,
    VehicleGeometry,
    VehicleParameters,
)

__all__ = [
    "FORD_GRANADA",
    "AddedMass",
    "BodyWeight",
    "Channel",
    "Corner",
    "Excitation",
    "HubWeight",
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
    "write_session",
]
