"""Runs are computed once for several plans, and anew for whatever they depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Channel, Quantity
from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import (
    FORD_GRANADA,
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
)
from identify.model.response import Bump
from identify.plan import (
    ExpectedElements,
    KnownRuns,
    Plan,
    Runs,
    sensors_of,
    typical_elements,
)
from identify.plan.information import RealCar

SENSORS = (
    Channel("z", Quantity.BODY_ACCELERATION, at_cg=True),
    Channel("p", Quantity.PITCH_RATE),
    Channel("r", Quantity.ROLL_RATE),
    *(Channel(f"h{c}", Quantity.HUB_ACCELERATION, corner=c) for c in Corner),
)


def states(*, mass_kg: float = 5.0, sigma_kg: float = 0.0) -> tuple[MassState, ...]:
    weights = (BodyWeight(60.0, -1.0, 0.4), HubWeight(mass_kg, Corner.REAR_LEFT, sigma_kg))
    return MassState(BASELINE), MassState(ADDED, AddedMass(weights))


BASE = Plan(
    FORD_GRANADA.to_array(),
    sensors_of(SENSORS, 100.0),
    states(),
    tuple(Runs(state, kind) for state in (BASELINE, ADDED) for kind in Excitation),
    Bump(0.05, 0.1, 0.2),
)

CHANGES: dict[str, Callable[[Plan], Plan]] = {
    "vehicle": lambda p: replace(p, vehicle=1.1 * FORD_GRANADA.to_array()),
    "rate": lambda p: replace(p, sensors=sensors_of(SENSORS, 150.0)),
    "noise": lambda p: replace(
        p, sensors=tuple(replace(s, noise=0.7 * s.noise) for s in p.sensors)
    ),
    "geometry": lambda p: replace(p, geometry=FORD_GRANADA.geometry),
    "structure": lambda p: replace(p, structure=Structure(anti_roll_bars=True)),
    "corner loads": lambda p: replace(p, facts=(Fact(FactQuantity.CORNER_FL, 400.0, 1.0),)),
    "a weight": lambda p: replace(p, mass_states=states(mass_kg=8.0)),
    "its uncertainty": lambda p: replace(p, mass_states=states(sigma_kg=0.1)),
    "duration of the bump": lambda p: replace(p, bump=Bump(0.05, 0.1, 0.25)),
    "height of the bump": lambda p: replace(p, bump=Bump(0.03, 0.1, 0.2)),
    "length of the decay": lambda p: replace(p, decay_s=1.5),
    "repeats": lambda p: replace(p, runs=(*p.runs, Runs(ADDED, Excitation.ROLL, 3))),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_is_known_of_other_runs_changes_no_answer(what: str) -> None:
    known = KnownRuns()
    first = known.fisher(BASE).information
    changed = CHANGES[what](BASE)
    found, fresh = known.fisher(changed), KnownRuns().fisher(changed)
    assert found.information == pytest.approx(fresh.information, rel=1e-9, abs=1e-9)
    again = known.fisher(BASE).information
    assert again == pytest.approx(first, rel=1e-12)
    if found.information.shape == first.shape:
        assert not np.allclose(found.information, first, rtol=1e-3)


def test_information_grows_with_the_square_of_height_and_with_the_number_of_runs() -> None:
    once = KnownRuns().fisher(BASE).information
    lower = KnownRuns().fisher(replace(BASE, bump=Bump(0.025, 0.1, 0.2))).information
    assert once == pytest.approx(4.0 * lower, rel=1e-9, abs=1e-9)
    thrice = tuple(replace(runs, repeats=3) for runs in BASE.runs)
    assert KnownRuns().fisher(replace(BASE, runs=thrice)).information == pytest.approx(
        3.0 * once, rel=1e-9, abs=1e-9
    )


def test_a_real_car_has_the_elements_that_are_unknown_and_those_of_its_structure() -> None:
    unknown = ("anti_roll_bars", "friction", "one_sided_dampers")
    elements = typical_elements(unknown, BASE.vehicle)
    one = RealCar.of(BASE, elements, ())
    values = dict(zip((e.name for e in one.unknowns.members), one.unknowns.values, strict=True))
    assert set(values) == {"F_cf", "F_cr", "d_cf", "d_cr", "h_f2", "h_r2"}
    assert [values["F_cf"], values["F_cr"], values["d_cr"]] == pytest.approx([50.0, 50.0, 0.5e-3])
    assert values["h_f2"] < -300.0  # softer in compression than in rebound
    assert one.unknowns.knots == (-0.15, 0.0, 0.15)
    assert {"k_af", "k_ar"} <= set(one.model.box.parameters)
    assert not {"c_tf", "y_s"} & set(one.model.box.parameters)
    assert len(one.eta) == len(one.model.box.parameters)
    # Weak priors are all that the planner knows beside the runs: none of friction.
    shared = np.diag(one.shared())
    names = [one.model.names[i] for i in one.free]
    assert shared[names.index("F_cf")] == 0.0
    assert shared[names.index("d_cf")] == pytest.approx(1.0)
    others = RealCar.of(BASE, ExpectedElements(("tyre_damping", "cg_offset")), ())
    assert {"c_tf", "c_tr", "y_s"} <= set(others.model.box.parameters)
    assert "k_af" not in others.model.box.parameters
