"""Makes a plan from a bench, for the car of a session or for a typical one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from daq import Session
    from daq.bench.config import Bench
    from identify.plan import ExpectedElements, Plan, Sensor

_USUAL_CYCLE_S = 0.005  # where neither the DBC nor the command line has a rate
_LEAST_DECAY_S = 0.2  # where the trigger records hardly longer than the bump takes
_LINEAR = {"anti_roll_bars", "tyre_damping", "cg_offset"}
"""Elements that the linear plan also knows."""


def planned(
    bench: Bench,
    vehicle: NDArray[np.float64],
    rate_hz: float | None,
    bump_height_m: float,
    elements: ExpectedElements | None = None,
) -> Plan:
    """Return the campaign of a bench as a plan.

    `bench`: sensors, weights, campaign, and the known facts of the vehicle.  `vehicle`, (15,) or
    (28,) float64: parameters that are expected.  `rate_hz`: samples a second; None: the rates of
    the DBC.  `elements`: friction, damper curves and further expected elements; None for a linear
    car.
    """
    from identify.model.response import Bump
    from identify.plan import Plan, Runs

    return Plan(
        vehicle=vehicle,
        sensors=sensors(bench, rate_hz),
        mass_states=tuple(state.weighed() for state in bench.mass_states),
        runs=tuple(
            Runs(state, excitation, bench.campaign.repeats)
            for state in bench.campaign.mass_states
            for excitation in dict.fromkeys(bench.campaign.excitations)
        ),
        bump=Bump(bump_height_m, start_s=0.0, duration_s=bench.campaign.bump_s),
        decay_s=max(bench.trigger.post_s - bench.campaign.bump_s, _LEAST_DECAY_S),
        geometry=bench.vehicle.geometry,
        structure=bench.vehicle.structure,
        facts=bench.vehicle.facts,
        elements=elements,
    )


def sensors(bench: Bench, rate_hz: float | None) -> tuple[Sensor, ...]:
    """Return the sensors of a bench, with the usual noise of their kind."""
    from daq import Quantity
    from daq.bench.config import bench_codec
    from daq.samples.mapping import mapped_channels
    from identify.plan import sensor

    return tuple(
        sensor(mapped.channel.placed(), rate_hz or 1.0 / (mapped.message.cycle_s or _USUAL_CYCLE_S))
        for mapped in mapped_channels(bench, bench_codec(bench))
        if mapped.channel.quantity is not Quantity.UNUSED
    )


@dataclass(frozen=True, slots=True)
class ExpectedCar:
    """The car that a campaign is planned for."""

    vehicle: NDArray[np.float64]
    """Parameters, (28,)."""
    elements: ExpectedElements | None
    """Friction, damper curves and further elements; None for a linear car."""
    whose: str
    """Source of the parameters, in words."""


def of_session(path: Path, session: Session) -> ExpectedCar:
    """Return the car identified from a session; the typical one where that fails."""
    from identify import Verdict, identify
    from identify.plan import full_vector, identified_elements, vague

    result = identify(session)
    if not result.parameters or result.quality.verdict is Verdict.REFUSED:
        return typical(f"the identification of {path} is refused")
    if undetermined := vague(result.parameters):
        return typical(f"{path} does not determine {', '.join(undetermined)}")
    elements = identified_elements(result.forces) if result.forces else None
    values = {name: estimate.value for name, estimate in result.parameters.items()}
    return ExpectedCar(full_vector(values), elements, f"the vehicle identified from {path}")


def typical(why: str = "") -> ExpectedCar:
    """Return the paper's car, and why it replaces another."""
    from daq import FORD_GRANADA
    from identify.plan import full_vector

    whose = "the Ford Granada of the paper, as a typical car"
    values = dict(zip(FORD_GRANADA.__dataclass_fields__, FORD_GRANADA.to_array(), strict=True))
    return ExpectedCar(full_vector(values), None, f"{whose}: {why}" if why else whose)


def with_structure(car: ExpectedCar, bench: Bench) -> ExpectedCar:
    """Return a linear car with elements of usual size that `[vehicle.structure]` forces."""
    from identify.plan import USUAL_ELEMENTS, typical_elements

    stated = bench.vehicle.elements  # True: the car has it; False: it has not; absent: unknown
    forced = tuple(name for name, has_it in stated.items() if has_it)
    if car.elements is not None or not set(forced) - _LINEAR:
        return car
    possible = dict.fromkeys((*USUAL_ELEMENTS, *forced))
    names = tuple(name for name in possible if stated.get(name, True))
    elements = typical_elements(names, car.vehicle)
    return ExpectedCar(car.vehicle, elements, f"{car.whose}, with usual friction and dampers")
