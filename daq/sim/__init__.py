"""Simulates a car on a bench, from forces, as a truth that is independent of the identification."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .bench import PUSHES_S as PUSHES_S
    from .bench import Fault as Fault
    from .bench import SimulatedBench as SimulatedBench
    from .bench import push_frames as push_frames
    from .car import SimulatedCar as SimulatedCar
    from .car import present_parameters as present_parameters
    from .car import true_parameters as true_parameters
    from .ecu import campaign_frames as campaign_frames
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
