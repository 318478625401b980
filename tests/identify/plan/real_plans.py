"""The standard car and campaign of docs/method.md, "The plan of a real car", as plans."""

from __future__ import annotations

import numpy as np

from daq.channels import Channel
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import Fact, FactQuantity, MassState
from identify.model.response import Bump
from identify.plan import ExpectedElements, KnownRuns, Outlook, Plan, Runs, sensors_of
from identify.plan.outlook import expected

from ..nonlinear.truth import ADDED as LOADED
from ..nonlinear.truth import SPEEDS, Truth, channels, granada

THREE = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL)
BOTH = (BASELINE, ADDED)
SCALES = (
    Fact(FactQuantity.TOTAL_MASS, 0.0, 1.0),
    Fact(FactQuantity.FRONT_AXLE, 0.0, 1.0),
    Fact(FactQuantity.REAR_AXLE, 0.0, 1.0),
)
TAPE = (
    Fact(FactQuantity.WHEELBASE, 0.0, 2e-3),
    Fact(FactQuantity.FRONT_TRACK, 0.0, 4.4e-3),
    Fact(FactQuantity.REAR_TRACK, 0.0, 4.4e-3),
)
THIRTEEN = ("m_s", "I_yy", "I_xx", "m_uf", "m_ur", "k_sf", "k_sr", "k_tf", "k_tr", "a", "b", "t_f",
            "t_r")  # fmt: skip


def _elements() -> ExpectedElements:
    """Return friction and damper curves of the standard car, by the curves of the truth."""
    car = Truth()
    values = {"F_cf": 50.0, "F_cr": 50.0, "d_cf": 0.5e-3, "d_cr": 0.5e-3}
    curves = (SPEEDS, car.damper(0)), (SPEEDS, car.damper(1))
    return ExpectedElements(values=values, curves=curves)


ELEMENTS = _elements()
KNOWN = KnownRuns()
"""The runs of all plans of this file with the same sensors are computed once."""


def standard_plan(
    kinds: tuple[Excitation, ...] = THREE,
    heights_m: tuple[float, ...] = (0.05,),
    states: tuple[str, ...] = BOTH,
    travels: bool = True,
    facts: tuple[Fact, ...] = (),
) -> Plan:
    """Return runs of some kinds and heights in some mass states, 200 Hz, 2 s."""
    vehicle = granada()
    vehicle[15:17], vehicle[17:19] = 2050.0, 1950.0  # secants of its damper curves
    clocks = channels(travels)
    sensed: list[Channel] = [channel for clock in clocks for channel in clock]
    return Plan(
        vehicle=vehicle,
        sensors=sensors_of(sensed, 200.0),
        mass_states=tuple(s for s in (MassState(BASELINE), LOADED) if s.name in states),
        runs=tuple(Runs(s, k, 1, h) for s in states for h in heights_m for k in kinds),
        bump=Bump(0.05, 0.0, 0.2),
        decay_s=2.0,
        facts=facts,
        elements=ELEMENTS,
    )


def found(plan: Plan) -> Outlook:
    """Return the expected intervals of a plan."""
    return expected(KNOWN.fisher(plan))


def deviations(plan: Plan) -> dict[str, float]:
    """Return the standard deviation of each parameter as a share of its value, %."""
    known = found(plan).parameters
    return {n: 100.0 * known[n].std / known[n].value for n in THIRTEEN}


def worst(plan: Plan) -> float:
    """Return the largest of the 13 masses, inertias, stiffnesses and lengths, %."""
    return float(np.max(list(deviations(plan).values())))
