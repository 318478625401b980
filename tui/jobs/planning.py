"""Makes a plan from a bench: the campaign in bench.toml."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from daq import Bench
    from identify.plan import ExpectedElements, Plan, Sensor

_USUAL_RATE_HZ = 200.0  # where neither the DBC nor the command line has one


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
    from identify.model import Bump
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
        bump=Bump(bump_height_m, 0.0, bench.bump_s),
        decay_s=max(bench.trigger.post_s - bench.bump_s, 0.2),
        geometry=bench.vehicle.geometry,
        structure=bench.vehicle.structure,
        facts=bench.vehicle.facts,
        elements=elements,
    )


def sensors(bench: Bench, rate_hz: float | None) -> tuple[Sensor, ...]:
    """Return the sensors of a bench, with the usual noise of their kind."""
    from daq import Quantity, bench_codec, mapped_channels
    from identify.plan import sensor

    codec = bench_codec(bench)
    found = []
    for mapped in mapped_channels(bench, codec):
        if mapped.channel.quantity is not Quantity.UNUSED:
            cycle_s = mapped.message.cycle_s or 1.0 / _USUAL_RATE_HZ
            found.append(sensor(mapped.channel.placed(), rate_hz or 1.0 / cycle_s))
    return tuple(found)
