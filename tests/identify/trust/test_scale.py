"""What the scale rests on, and weights that are off by one common factor."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from daq.bench.config import load_bench
from daq.runs import ADDED
from daq.sessions import Session
from daq.vehicle import FORD_GRANADA, AddedMass, Fact, Vehicle
from identify.decays.usable import usable
from identify.fit.estimation import Estimation, estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.fit.uncertainty import estimates
from identify.pipeline import grey_box, identify_parameters
from identify.trust.finding import Verdict
from identify.trust.judge import judge
from identify.trust.statements import contradictions, suspects, unseen_findings

from ...flow.coverage import simulated_session
from ..stress import stress_session
from .campaigns import by_gate, estimated

CAR = FORD_GRANADA
AXLES_KG = (
    CAR.m_s * CAR.b / (CAR.a + CAR.b) + 2 * CAR.m_uf,
    CAR.m_s * CAR.a / (CAR.a + CAR.b) + 2 * CAR.m_ur,
)


def _session(facts: tuple[Fact, ...], factor: float, sigma_kg: float) -> Session:
    """Return runs of the linear car whose stated weights are `factor` times the true ones."""
    session = stress_session("linear", 1, 100.0, vehicle=Vehicle("x", facts=facts))
    states = []
    for state in session.mass_states:
        weights = tuple(
            replace(w, mass_kg=factor * w.mass_kg, sigma_kg=sigma_kg) for w in state.added.weights
        )
        states.append(replace(state, added=replace(state.added, weights=weights)))
    return replace(session, mass_states=tuple(states))


def _estimated(session: Session) -> Estimation:
    records = usable(session).records
    return estimate(grey_box(session, records), records, generic_vehicles())


def _with_facts(estimation: Estimation, *facts: Fact) -> Estimation:
    box = estimation.box
    made = type(box)(box.groups, box.mass_states, box.geometry, box.structure, facts)
    return replace(estimation, box=made)


def test_the_scale_rests_on_weights_unless_a_load_or_spring_is_stated() -> None:
    linear = estimated("linear", 1)

    def codes(box: GreyBox) -> list[str]:
        return [note.code for note in unseen_findings(box, ())]

    assert codes(linear.box) == ["scale", "gains"]
    for quantity in ("total_mass_kg", "front_axle_kg", "corner_rr_kg", "k_sf"):
        assert codes(_with_facts(linear, Fact(quantity, 500.0, 1.0)).box) == ["gains"]
    for quantity in ("wheelbase_m", "rear_track_m", "a"):
        assert "scale" in codes(_with_facts(linear, Fact(quantity, 1.0, 0.1)).box)


@pytest.mark.parametrize("sigma_kg", [0.0, 0.1])
def test_weights_that_are_all_ten_per_cent_off_are_named_where_scales_are_there(
    sigma_kg: float,
) -> None:
    front, rear = AXLES_KG
    facts = (Fact("front_axle_kg", front, 2.0), Fact("rear_axle_kg", rear, 2.0))
    session = _session(facts, 1.1, sigma_kg)
    result = _estimated(session)
    if sigma_kg:
        (wrong,) = contradictions(result)
        assert "all weights by a common factor" in wrong.name
    quality = judge(session, result)
    named = by_gate(quality.findings)
    assert "scale" not in named
    assert "contradiction" not in named  # the cause is named once, not each load beside it
    finding = named["added_weights_off_by_a_common_factor"]
    assert "front_axle_kg and rear_axle_kg" in finding.text
    size = float(finding.text.split("all weights ")[1].split(" ")[0])
    assert abs(size - -9.1) < 1.5  # per cent of what is stated: 1 / 1.1 - 1
    assert quality.verdict is not Verdict.OK


@pytest.mark.parametrize(("factor", "named"), [(0.8, True), (1.0, False)])
def test_one_weight_that_is_a_fifth_lighter_is_named_with_its_size(
    factor: float, named: bool
) -> None:
    """Through the simulated car, which is written from forces, without scales."""
    bench = load_bench(None)
    first, *others = bench.mass_states[1].added.weights
    lighter = replace(first, mass_kg=factor * first.mass_kg)
    true = replace(bench.mass_states[1], added=AddedMass((lighter, *others)))
    session = simulated_session(replace(bench, mass_states=(bench.mass_states[0], true)), 500)
    quality = identify_parameters(replace(session, mass_states=bench.mass_states)).quality
    assert (quality.verdict is Verdict.OK) is not named
    found = by_gate(quality.findings).get("contradiction")
    assert (found is not None) is named
    if found is not None:
        said = r"weight 1 of state added by \S+ sigma, (\S+) kg (\w+)"
        size, way = re.findall(said, found.text)[0]
        assert way == "lighter"
        assert 0.7 < float(size) / (0.2 * first.mass_kg) < 1.3


def test_scales_that_show_eight_per_cent_too_much_are_not_ok() -> None:
    """The fit follows the scales, which are stated more exactly: all masses are 8 % too large."""
    front, rear = AXLES_KG
    session = _session((Fact("total_mass_kg", 1.08 * (front + rear), 1.0),), 1.0, 0.1)
    result = _estimated(session)
    assert estimates(result.box, result.fit)["m_s"].value > 1.07 * CAR.m_s
    quality = judge(session, result)
    assert quality.verdict is Verdict.DOUBTFUL
    assert "total_mass_kg: one of the two" in quality.reasons[0]
    lost = quality.survival.lost["m_s"]
    assert lost.cause == "scales off by a common factor"
    assert abs(lost.shift - (1.0 / 1.08 - 1.0)) < 0.015


def test_right_weights_beside_scales_are_no_finding() -> None:
    front, rear = AXLES_KG
    facts = (Fact("front_axle_kg", front, 2.0), Fact("rear_axle_kg", rear, 2.0))
    session = _session(facts, 1.0, 0.1)
    quality = judge(session, _estimated(session))
    assert quality.verdict is Verdict.OK
    assert quality.survival.surviving == tuple(estimates_names(session))
    assert ADDED in {state.name for state in session.mass_states}


def estimates_names(session: Session) -> tuple[str, ...]:
    """Return the names of the parameters that a session has."""
    return grey_box(session, usable(session).records).names


def test_one_wrong_load_is_named_alone() -> None:
    front, rear = AXLES_KG
    facts = (
        Fact("front_axle_kg", front, 0.5),
        Fact("rear_axle_kg", rear + 60.0, 0.5),
        Fact("total_mass_kg", front + rear, 0.5),
    )
    result = _estimated(_session(facts, 1.0, 0.1))
    assert estimates(result.box, result.fit)["m_s"].std < 3.0
    (wrong,) = contradictions(result)
    assert wrong.name.startswith("rear_axle_kg")


def test_without_scales_no_common_factor_is_suspected() -> None:
    bare = grey_box(session := _session((), 1.0, 0.1), usable(session).records)
    scales = (Fact("total_mass_kg", 1500.0, 1.0),)
    weighed = type(bare)(bare.groups, bare.mass_states, bare.geometry, bare.structure, scales)
    assert len(bare.corrections) > 6
    assert suspects(bare)[0] == bare.corrections
    assert suspects(weighed)[0][-1] == "all weights by a common factor"
