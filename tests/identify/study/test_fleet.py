"""The fleet's rows and fractions, from results that were made up."""

from __future__ import annotations

from dataclasses import replace
from math import isnan, nan

import numpy as np
import pytest

from dbc.finding import Finding, Severity
from identify import Estimate, Identification
from identify.nonlinear.forces import AxleForces, DamperCurve, ElementChoice, Forces
from identify.study.fleet import FleetCase, fleet_case, fleet_study, fractions
from identify.trust.finding import Judgement, Verdict

SEVERITY = {Verdict.DOUBTFUL: Severity.WARNING, Verdict.REFUSED: Severity.ERROR}
TRUTH = {"m_s": 1000.0, "k_sf": 20e3, "c_sf": 1500.0}


def identified(verdict: Verdict, **values: float) -> Identification:
    """Return a result with intervals of 2 % either way."""
    findings = (Finding("amplitude", SEVERITY[verdict], "x"),) if verdict is not Verdict.OK else ()
    parameters = {
        name: Estimate(value, 0.01 * value, 0.98 * value, 1.02 * value, "kg")
        for name, value in values.items()
    }
    return Identification(Judgement(findings, 1.01), {}, parameters)


def case(verdict: Verdict, worst: float, covered: int = 13, cpu_s: float = 20.0) -> FleetCase:
    return FleetCase("1 city", verdict.value, 1.0, worst, "k_sf", covered, 13, cpu_s, (), ())


def test_a_case_compares_what_was_found_with_what_is() -> None:
    result = identified(Verdict.DOUBTFUL, m_s=1010.0, k_sf=19e3, c_sf=3000.0)
    there = {"damper_mounts": {"s_mf": 1e-6}, "anti_roll_bars": {"k_af": 5e3}}
    found = fleet_case("3 van", result, TRUTH, there, 12.5)
    assert found.worst == "k_sf"
    assert found.worst_percent == pytest.approx(5.0)
    # The damping is a curve and is not among what the fractions are of.
    assert (found.covered, found.judged) == (1, 2)
    assert found.there == ("anti_roll_bars", "damper_mounts")
    assert (found.named, found.expected) == ((), ())  # a linear fit names no element
    assert (found.verdict, found.chi2_per_n, found.cpu_s) == ("doubtful", 1.01, 12.5)


def test_a_refusal_without_parameters_has_no_worst() -> None:
    found = fleet_case("3 van", identified(Verdict.REFUSED), TRUTH, {}, 1.0)
    assert isnan(found.worst_percent)
    assert (found.worst, found.covered, found.judged) == ("", 0, 0)


def _tried(name: str, kept: bool, **values: float) -> ElementChoice:
    """Return an element whose unknowns have intervals of 10 either way."""
    known = {n: Estimate(v, 5.1, v - 10.0, v + 10.0, "N") for n, v in values.items()}
    return ElementChoice(name, 99.0, 30.0, kept, False, known)


def _forces(*choices: ElementChoice) -> Forces:
    v = np.array([-0.1, 0.1])
    curve = DamperCurve(v, 1500.0 * v, np.ones(2), 1500.0 * v, np.ones(2))
    return Forces((AxleForces("front", curve, {}, ()), AxleForces("rear", curve, {}, ())), choices)


def test_elements_are_counted_against_the_car_and_not_its_findings() -> None:
    forces = _forces(
        _tried("friction", True, F_cf=50.0, F_cr=40.0),
        _tried("anti_roll_bars", False, k_af=3.0, k_ar=1.0),
        _tried("damper_knees", True, h_f1=100.0),
        _tried("one_sided_dampers", False, h_f2=5.0),
        _tried("damper_mounts", True, s_mf=20.0, s_mr=0.0),
        _tried("tyre_damping", False, c_tf=70.0, c_tr=60.0),
    )
    there = {
        "friction": {"F_cf": 45.0, "F_cr": 38.0},
        "anti_roll_bars": {"k_af": 9.9, "k_ar": 0.0},  # hidden by its interval of 10
        "damper_curve": {},
        "tyre_damping": {"c_tf": 10.1, "c_tr": 0.0},
        "bump_stops": {"k_bf": 1e5, "k_br": 0.0},  # not tried: it has no interval
    }
    result = replace(identified(Verdict.OK, m_s=1000.0), forces=forces)
    found = fleet_case("3 van", result, TRUTH, there, 1.0)
    assert found.named == ("friction", "damper_curve", "damper_mounts")
    assert found.expected == ("friction", "damper_curve", "tyre_damping")
    assert found.missed == ("tyre_damping",)
    assert found.false == ("damper_mounts",)
    of = fractions([found])
    assert of["elements_named"] == pytest.approx(2 / 3)
    assert of["elements_false"] == pytest.approx(1 / 3)
    row = fleet_study("one car", [found]).rows[0]
    assert row[-3:] == ("friction, damper_curve, damper_mounts", "tyre_damping", "damper_mounts")


def test_the_fractions_are_of_those_that_may_be_used() -> None:
    cases = [
        case(Verdict.OK, 1.0, 13, 10.0),
        case(Verdict.OK, 6.0, 12, 20.0),
        case(Verdict.DOUBTFUL, 2.9, 11, 30.0),
        case(Verdict.DOUBTFUL, 4.0, 13, 40.0),
        case(Verdict.REFUSED, 50.0, 1, 90.0),
    ]
    of = fractions(cases)
    assert of["cars"] == 5
    assert of["usable"] == pytest.approx(0.8)
    assert of["ok"] == pytest.approx(0.4)
    assert of["good"] == pytest.approx(0.5)
    assert of["fair"] == pytest.approx(0.75)
    assert of["false_ok"] == 1
    assert of["coverage_ok"] == pytest.approx(25 / 26)
    assert of["coverage_doubtful"] == pytest.approx(24 / 26)
    assert of["median_cpu_s"] == pytest.approx(25.0)
    assert of["median_refused_cpu_s"] == pytest.approx(90.0)


def test_limits_count_as_within() -> None:
    assert fractions([case(Verdict.OK, 3.0)])["good"] == 1.0
    assert fractions([case(Verdict.OK, 3.01)])["good"] == 0.0
    assert fractions([case(Verdict.OK, 5.0)])["false_ok"] == 0.0
    assert fractions([case(Verdict.OK, 5.01)])["false_ok"] == 1.0


def test_a_fleet_that_is_refused_says_so() -> None:
    refused = FleetCase("1 city", "refused", nan, nan, "", 0, 0, 3.0, ("friction",), ("chi2",))
    study = fleet_study("one car", [refused])
    assert study.rows[0][:2] == ("1 city", "refused")
    assert study.notes[0] == "0 % of 1 car ends ok or doubtful, 0 % ok"
    assert "median 3.0 CPU s for the refused ones" in study.notes
    assert not [note for note in study.notes if "nan" in note]
