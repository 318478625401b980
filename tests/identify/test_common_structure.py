"""Sessions brought together: one structure for all, and what all of them state alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
)
from identify import Estimate, Identification, Judgement
from identify.change import with_common_structure
from identify.compare import compare
from identify.fit.estimation import Estimation
from identify.nonlinear.forces import ElementChoice, Forces

from .changes import session


@pytest.mark.parametrize(
    "wider",
    [
        Structure(cg_offset=True),
        Structure(anti_roll_bars=True),
        Structure(tyre_damping=True),
        Structure(symmetric=False),
    ],
)
def test_a_fit_gets_every_parameter_that_another_one_has(wider: Structure) -> None:
    one = session({}, 1)
    stored = replace(one, box=one.box.with_structure(wider), decays=())
    again, same = with_common_structure([one, stored])
    assert same is stored  # it has nothing to be fitted again
    assert again.box.structure == wider
    assert len(again.fit.eta) == len(again.box.parameters) > 15
    # More unknowns leave less, by about one unit of chi2 for each.
    fall = (one.chi2_per_n - again.chi2_per_n) * one.freedom
    assert fall == pytest.approx(one.fit.cost - again.fit.cost, abs=1e-6)
    assert 0.0 < fall < 30.0


def test_fits_of_one_structure_stay_as_they_are() -> None:
    one, two = session({}, 1), session({}, 4)
    same = with_common_structure([one, two])
    assert [a is b for a, b in zip(same, (one, two), strict=True)] == [True, True]
    stored, wide = replace(one, decays=()), one.box.with_structure(Structure(cg_offset=True))
    again, other = with_common_structure([stored, replace(stored, box=wide)])
    assert again is stored  # without decays it cannot be fitted again
    assert other.box is wide


def stated(*facts: Fact, weights: tuple[BodyWeight | HubWeight, ...] = ()) -> Identification:
    """Return a session that states facts and weights; its fit has no decays."""
    one = session({}, 1)
    states = (MassState("baseline"), MassState("added", AddedMass(weights)))
    box = replace(one.box, facts=facts, mass_states=states)
    known = {"m_s": Estimate(1000.0, 1.0, 998.0, 1002.0, "kg")}
    fit: Estimation = replace(one, box=box, decays=())
    return Identification(Judgement((), 1.0), {}, parameters=known, estimation=fit)


TOTAL = Fact(FactQuantity.TOTAL_MASS, 1700.0, 1.0)
HUB, BODY = HubWeight(5.0, Corner.REAR_LEFT, 0.01), BodyWeight(50.0, -1.0, 0.5, 0.2, 0.1, 0.003)


def common(*every: Identification) -> tuple[str, ...]:
    return compare([f"s{i}" for i in range(len(every))], every).common


def test_facts_and_weights_that_all_state_alike_are_named() -> None:
    first = stated(TOTAL, weights=(HUB, BODY, HubWeight(3.0, Corner.FRONT_LEFT)))
    assert common(first, first) == (
        "total_mass_kg = 1700 ± 1",
        "weight 1 of state added = 5 ± 0.01 kg",
        "weight 2 of state added = 50 ± 0.1 kg at (-1, 0.5) ± 0.003 m",
    )
    heavier = stated(replace(TOTAL, value=1701.0), weights=(HUB, replace(BODY, y_m=-0.5)))
    assert common(first, heavier) == ("weight 1 of state added = 5 ± 0.01 kg",)
    assert common(first, heavier, stated()) == ()


def test_a_session_without_a_fit_states_nothing() -> None:
    first = stated(TOTAL)
    bare = replace(first, estimation=None)
    assert common(first, bare) == ()
    assert compare(["a", "b"], [first, bare]).change is None


def choices(*kept: str, tried: tuple[str, ...] = ()) -> Forces:
    every = (*((name, True) for name in kept), *((name, False) for name in tried))
    axles: Any = ()
    return Forces(axles, tuple(ElementChoice(n, 9.0, 3.0, k, False, {}) for n, k in every))


def apart(*forces: Forces | None) -> tuple[str, ...]:
    """Return the elements that a comparison says to have changed."""
    results = [replace(stated(), forces=one) for one in forces]
    change = compare([str(i) for i in range(len(results))], results).change
    assert change is not None
    return change.apart


def test_an_element_that_one_session_needs_and_another_never_tried_sets_them_apart() -> None:
    assert apart(choices("friction", "bump_stops"), None) == ("friction", "bump stops")
    assert apart(None, choices("friction", tried=("bump_stops",))) == ("friction",)
    assert apart(choices("friction"), choices("friction")) == ()
    # Tried and not needed: the other session's fit says so itself.
    assert apart(choices("friction"), choices(tried=("friction",))) == ()
    # Of these the linear model has parameters, which are compared.
    assert apart(choices("anti_roll_bars", "cg_offset", "tyre_damping"), None) == ()
