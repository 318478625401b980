"""Sessions compared: differences and trends, one structure, what they state alike or not."""

from __future__ import annotations

from dataclasses import replace
from math import erfc, sqrt
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.stats import norm

from daq.channels import Channel, Quantity
from daq.vehicle import (
    AddedMass,
    BodyWeight,
    Corner,
    Fact,
    FactQuantity,
    HubWeight,
    MassState,
    Structure,
    VehicleGeometry,
)
from dbc.words import Finding, InputError, Severity
from identify import Estimate, Identification, Judgement
from identify.change import with_common_structure
from identify.compare import compare, stated_unlike
from identify.fit.estimation import Estimation
from identify.nonlinear.forces import ElementChoice, Forces

from .changes import session

NAMES = ("m_s", "k_sf", "c_sf", "c_sr")


def _result(values: list[float], std: list[float]) -> Identification:
    rows = zip(NAMES, values, std, strict=True)
    parameters = {n: Estimate(v, s, v - 1.96 * s, v + 1.96 * s, "kg", 10.0) for n, v, s in rows}
    return Identification(Judgement((), 1.0), {}, parameters=parameters)


def test_a_difference_has_the_spread_of_both() -> None:
    two = compare(
        ["a", "b"], [_result([100, 10, 5, 1], [3, 1, 1, 1]), _result([105, 10, 5, 1], [4, 1, 1, 1])]
    )
    (d,) = two.parameters[0].differences
    assert (d.value, d.std, d.z) == (5.0, 5.0, 1.0)
    assert d.p == pytest.approx(0.317310507863)  # of the normal distribution
    assert two.parameters[0].trend is None


@pytest.mark.parametrize(
    ("p", "significant"),
    [
        # Against 0.0125, 0.0167, 0.025, 0.05.
        ([0.010, 0.020, 0.030, 0.9], [True, False, False, False]),
        ([0.010, 0.015, 0.024, 0.060], [True, True, True, False]),
    ],
)
def test_holm_stops_at_the_first_that_does_not_stand(
    p: list[float], significant: list[bool]
) -> None:
    z = norm.isf(np.array(p) / 2.0).tolist()
    two = compare(["a", "b"], [_result([0.0] * 4, [0.5**0.5] * 4), _result(z, [0.5**0.5] * 4)])
    assert [q.differences[0].p for q in two.parameters] == pytest.approx(p)
    assert [q.differences[0].significant for q in two.parameters] == significant


def test_a_trend_is_the_weighted_line() -> None:
    rng = np.random.default_rng(1)
    values, std = rng.normal(5.0, 1.0, (6, 4)), rng.uniform(0.5, 2.0, (6, 4))
    result = compare(
        list("abcdef"), [_result(list(v), list(s)) for v, s in zip(values, std, strict=True)]
    )
    for j, quantity in enumerate(result.parameters):
        fit, covariance = np.polyfit(np.arange(6), values[:, j], 1, w=1 / std[:, j], cov="unscaled")
        trend = quantity.trend
        assert trend is not None
        assert trend.slope == pytest.approx(fit[0])
        assert trend.slope_std == pytest.approx(sqrt(covariance[0, 0]))
        assert trend.slope_p == pytest.approx(erfc(abs(fit[0]) / sqrt(2 * covariance[0, 0])))
        mean = np.average(values[:, j], weights=std[:, j] ** -2)
        assert trend.chi2 == pytest.approx(np.sum(((values[:, j] - mean) / std[:, j]) ** 2))
        assert trend.freedom == 5


def test_a_drift_and_a_jump_are_distinguished_from_rest() -> None:
    rows = [[100.0 + i, 10.0, 5.0 + 20.0 * (i == 2), 1.0] for i in range(5)]
    result = compare(list("abcde"), [_result(row, [0.1] * 4) for row in rows])
    drifts = [q.trend.drifts for q in result.parameters if q.trend]
    varies = [q.trend.varies for q in result.parameters if q.trend]
    assert drifts == [True, False, False, False]  # a jump in the middle is no slope
    assert varies == [True, False, True, False]


def test_given_and_undetermined_parameters_are_left_out() -> None:
    a, b = _result([1, 2, 3, 4], [0, 1, 1, 1]), _result([1, 2, 3, 4], [1, 1, float("inf"), 1])
    two = compare(["a", "b"], [a, b])
    assert [q.name for q in two.parameters] == ["k_sf", "c_sr"]
    assert two.open == ("c_sf",)


def test_a_session_without_parameters_is_named() -> None:
    nothing = Identification(Judgement((), float("nan")), {})
    with pytest.raises(InputError, match=r"broken\.h5"):
        compare(["a", "broken.h5"], [_result([1.0] * 4, [1.0] * 4), nothing])
    reasons = tuple(Finding(f"code{i}", Severity.ERROR, f"reason {i}") for i in (1, 2))
    refused = Identification(Judgement(reasons, float("nan")), {})
    with pytest.raises(InputError, match="reason 1"):
        compare(["a", "b"], [_result([1.0] * 4, [1.0] * 4), refused])
    with pytest.raises(InputError, match="one session"):
        compare(["a"], [_result([1.0] * 4, [1.0] * 4)])


# One structure for all, and what all of them state alike ------------------------------------------


@pytest.mark.parametrize(
    "wider",
    [
        Structure(cg_offset=True, anti_roll_bars=True, tyre_damping=True),
        Structure(symmetric=False),
    ],
)
def test_a_fit_gets_every_parameter_that_another_one_has(wider: Structure) -> None:
    one = session({}, 1)
    stored = replace(one, box=one.box.with_structure(wider), decays=())
    assert with_common_structure([one, one]) == (one, one)
    again, same = with_common_structure([one, stored])
    assert same is stored  # it has nothing to be fitted again
    assert again.box.structure == wider
    assert len(again.fit.eta) == len(again.box.parameters) > 15
    # More unknowns leave less, by about one unit of chi2 for each.
    assert 0.0 < one.fit.cost - again.fit.cost < 30.0


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
    bare = replace(first, estimation=None)  # a session without a fit states nothing
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


# Facts that sessions of one car should state alike, and do not ------------------------------------


ON_BODY = Channel("acc", Quantity.BODY_ACCELERATION, x_m=1.2, y_m=0.4)
ON_HUB = Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner.FRONT_LEFT)
RATE = Channel("gyro", Quantity.PITCH_RATE, x_m=1.0)


def telling(
    vehicle: str = "Golf",
    channels: tuple[Channel, ...] = (),
    facts: tuple[Fact, ...] = (),
    geometry: VehicleGeometry | None = None,
) -> Identification:
    box = SimpleNamespace(
        geometry=geometry, facts=facts, groups=(SimpleNamespace(channels=channels),)
    )
    fit = cast(Any, SimpleNamespace(box=box))
    return Identification(Judgement((), 1.0), {}, vehicle=vehicle, estimation=fit)


def unlike(*results: Identification) -> tuple[str, ...]:
    return stated_unlike([chr(ord("a") + i) for i in range(len(results))], results)


def test_two_vehicles_are_named_with_the_sessions_of_each() -> None:
    assert unlike(telling(), telling("Polo"), telling()) == ("vehicle Golf in a, c; Polo in b",)
    assert unlike(telling(), telling(""), telling()) == (), "a name that is not stated is no other"
    refused = Identification(Judgement((), 1.0), {}, vehicle="Polo")  # has its name alone
    assert unlike(telling(channels=(ON_BODY,)), refused) == ("vehicle Golf in a; Polo in b",)


@pytest.mark.parametrize(("second_m", "differs"), [(2.6004, False), (2.601, True)])
def test_a_wheelbase_differs_by_a_millimetre(second_m: float, differs: bool) -> None:
    first, second = (
        telling(facts=(Fact("wheelbase_m", value, 0.01), Fact("total_mass_kg", value, 1e-9)))
        for value in (2.6, second_m)
    )
    text = f"wheelbase 2.600 m in a; {second_m:.3f} m in b"
    assert unlike(first, second) == ((text,) if differs else ()), "a mass may change"


def test_measured_lengths_are_those_of_the_facts() -> None:
    geometry = VehicleGeometry(1.2, 1.4, 0.7, 0.75)
    facts = (Fact("wheelbase_m", 2.6, 0.001), Fact("rear_track_m", 1.45, 0.001))
    assert unlike(telling(geometry=geometry), telling(facts=facts)) == (
        "rear track 1.500 m in a; 1.450 m in b",
    )
    moved = VehicleGeometry(1.3, 1.3, 0.7, 0.75)  # the CG of a car with other things on board
    assert unlike(telling(geometry=geometry), telling(geometry=moved)) == ()


def test_sensors_have_their_places_where_places_count() -> None:
    one = telling(channels=(ON_BODY, ON_HUB, RATE))
    moved = Channel("acc", Quantity.BODY_ACCELERATION, x_m=1.2, y_m=-0.4)
    other = Channel("hub", Quantity.HUB_ACCELERATION, corner=Corner.REAR_RIGHT)
    turned = Channel("gyro", Quantity.PITCH_RATE, x_m=0.0)
    assert unlike(one, telling(channels=(moved, other, turned))) == (
        "place of acc (1.2, 0.4) m in a; (1.2, -0.4) m in b",
        "place of hub FL in a; RR in b",
    )
    middle = Channel("acc", Quantity.BODY_ACCELERATION, at_cg=True)
    assert unlike(one, telling(channels=(middle,))) == (
        "place of acc (1.2, 0.4) m in a; at the CG in b",
    )
