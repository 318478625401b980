"""The fleet's rows and fractions, from results that were made up."""

from __future__ import annotations

from math import isnan, nan

import pytest

from dbc.finding import Finding, Severity
from identify import Estimate, Identification
from identify.study.fleet import FleetCase, fleet_case, fleet_study, fractions
from identify.trust.finding import Quality, Verdict

SEVERITY = {Verdict.DOUBTFUL: Severity.WARNING, Verdict.REFUSED: Severity.ERROR}
TRUTH = {"m_s": 1000.0, "k_sf": 20e3, "c_sf": 1500.0}


def identified(verdict: Verdict, **values: float) -> Identification:
    """Return a result with intervals of 2 % either way."""
    findings = (Finding("amplitude", SEVERITY[verdict], "x"),) if verdict is not Verdict.OK else ()
    parameters = {
        name: Estimate(value, 0.01 * value, 0.98 * value, 1.02 * value, "kg")
        for name, value in values.items()
    }
    return Identification(Quality(findings, 1.01), {}, parameters)


def case(verdict: Verdict, worst: float, covered: int = 13, cpu_s: float = 20.0) -> FleetCase:
    return FleetCase("1 city", verdict.value, 1.0, worst, "k_sf", covered, 13, cpu_s, (), ())


def test_a_case_compares_what_was_found_with_what_is() -> None:
    result = identified(Verdict.DOUBTFUL, m_s=1010.0, k_sf=19e3, c_sf=3000.0)
    found = fleet_case("3 van", result, TRUTH, ["mounts", "bars"], 12.5)
    assert found.worst == "k_sf"
    assert found.worst_percent == pytest.approx(5.0)
    # The damping is a curve and is not among what the fractions are of.
    assert (found.covered, found.judged) == (1, 2)
    assert found.there == ("bars", "mounts")
    assert found.named == ("amplitude",)
    assert (found.verdict, found.chi2_per_n, found.cpu_s) == ("doubtful", 1.01, 12.5)


def test_a_refusal_without_parameters_has_no_worst() -> None:
    found = fleet_case("3 van", identified(Verdict.REFUSED), TRUTH, [], 1.0)
    assert isnan(found.worst_percent)
    assert (found.worst, found.covered, found.judged) == ("", 0, 0)


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
    assert study.notes[0] == "0 % of 1 cars end ok or doubtful, 0 % ok"
    assert "median 3.0 CPU s for the refused ones" in study.notes
    assert not [note for note in study.notes if "nan" in note]
