"""Simulates a car on a bench, from forces, as a truth that is independent of the identification."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .bench_source import SimulatedBench as SimulatedBench
    from .car import SimulatedCar as SimulatedCar
    from .ecu import campaign_frames as campaign_frames
    from .pushes import PUSHES_S as PUSHES_S
    from .pushes import push_frames as push_frames
    from .reported import present_parameters as present_parameters
    from .reported import true_parameters as true_parameters
    from .spoils import Fault as Fault
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
