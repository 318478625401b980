"""Simulates and identifies one car of a fleet: only here simulator and method meet."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identify.study import FleetCase


def identified_car(seed: int, facts: bool, travels: bool, number: int) -> FleetCase:
    """Simulate a car of a fleet, identify it, and compare.

    `seed`: of the fleet.  `facts`: scales and tape measure instead of added mass.  `travels`:
    suspension travels in addition to the inertial unit and the hubs.  `number`: number of the car.
    """
    from time import process_time

    import identify
    from daq.sim import elements, fleet_car, true_parameters
    from identify.study import fleet_case

    drawn = fleet_car(number, seed, facts, travels)
    simulated = drawn.simulate()
    began = process_time()
    result = identify.identify(simulated.session)
    cpu_s = process_time() - began
    truth, there = true_parameters(drawn.car), elements(drawn, simulated)
    return fleet_case(f"{number} {drawn.kind}", result, truth, there, cpu_s)
