"""Simulates a car on a bench, from forces, as a truth that is independent of the identification."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from .bench_source import SimulatedBench as SimulatedBench
    from .car import SimulatedCar as SimulatedCar
    from .cars import GRANADA as GRANADA
    from .cars import named_car as named_car
    from .ecu import campaign_frames as campaign_frames
    from .fleet import elements as elements
    from .fleet import fleet_car as fleet_car
    from .nonlinear_truth import TrueElements as TrueElements
    from .nonlinear_truth import true_elements as true_elements
    from .pushes import PUSHES_S as PUSHES_S
    from .pushes import push_frames as push_frames
    from .reported import present_parameters as present_parameters
    from .reported import true_parameters as true_parameters
    from .spoils import Fault as Fault
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
