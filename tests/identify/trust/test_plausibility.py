"""Whether the parameters are determined, plausible, and in keeping with what was stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.vehicle import FORD_GRANADA, Structure, Vehicle
from dbc.finding import Severity
from identify.fit.estimation import Estimation, estimate, generic_vehicles
from identify.pipeline import grey_box, usable_records
from identify.trust.plausibility import parameter_findings, undetermined

from ..stress import HUBS, stress_session
from .campaigns import by_gate, estimated


def _with_std(result: Estimation, name: str, std: float) -> Estimation:
    covariance = result.fit.covariance.copy()
    i = result.box.parameters.index(name)
    covariance[i, i] = std**2
    return replace(result, fit=replace(result.fit, covariance=covariance))


def _with_value(result: Estimation, name: str, value: float) -> Estimation:
    eta = result.fit.eta.copy()
    eta[result.box.parameters.index(name)] = np.log(value)
    return replace(result, fit=replace(result.fit, eta=eta))


@pytest.fixture(scope="module")
def linear() -> Estimation:
    return estimated("linear", 1)


def test_a_good_fit_passes(linear: Estimation) -> None:
    assert parameter_findings(linear) == ()
    assert undetermined(linear) == ()


@pytest.mark.parametrize("std", [np.inf, 0.3])
def test_a_parameter_that_is_not_determined_refuses_all(linear: Estimation, std: float) -> None:
    vague = _with_std(linear, "I_xx", std)
    assert undetermined(vague) == ("I_xx",)
    (finding,) = parameter_findings(vague)
    assert finding.code == "undetermined"
    assert finding.severity is Severity.ERROR
    assert "determine I_xx:" in finding.text
    assert "warp" in finding.text


def test_no_roll_run_leaves_roll_undetermined() -> None:
    assert {"I_xx", "t_f", "t_r"} <= set(undetermined(estimated("no_roll", 1)))


def test_an_interval_wider_than_5_per_cent_is_doubtful(linear: Estimation) -> None:
    assert parameter_findings(_with_std(linear, "k_sf", 0.024)) == ()
    (finding,) = parameter_findings(_with_std(linear, "k_sf", 0.03))
    assert finding.code == "wide"
    assert finding.severity is Severity.WARNING
    assert "k_sf ± 6 %" in finding.text


@pytest.mark.parametrize(
    ("name", "factor", "quantity"),
    [
        ("c_sf", 10.0, "front_ride_damping_ratio"),
        ("k_tr", 20.0, "rear_wheel_hop_frequency"),
        ("k_sr", 0.1, "rear_ride_frequency"),
        ("I_yy", 0.4, "dynamic_index"),
    ],
)
def test_what_no_road_vehicle_is_like_is_doubtful(
    linear: Estimation, name: str, factor: float, quantity: str
) -> None:
    odd = _with_value(linear, name, factor * float(getattr(FORD_GRANADA, name)))
    finding = by_gate(parameter_findings(odd))["implausible"]
    assert finding.severity is Severity.WARNING
    assert quantity in finding.text


def test_a_bar_that_pushes_is_implausible_unless_it_may_be_none() -> None:
    session = stress_session("bars", 1, vehicle=Vehicle("x", structure=Structure(True, True)))
    records = usable_records(session)
    result = estimate(grey_box(session, records), records, generic_vehicles())
    assert parameter_findings(result) == ()
    i = result.box.parameters.index("k_af")
    std = float(np.sqrt(result.fit.covariance[i, i]))
    for sigmas, gates in ((-2.0, []), (-4.0, ["implausible"])):
        eta = result.fit.eta.copy()
        eta[i] = sigmas * std
        moved = replace(result, fit=replace(result.fit, eta=eta))
        assert [f.code for f in parameter_findings(moved)] == gates


def test_a_stated_delay_that_the_runs_contradict_is_named() -> None:
    session = stress_session("hubs_late_1ms", 1)
    sure = replace(
        session,
        channels=tuple(
            replace(c, delay_sigma_s=1e-5) if c.name in HUBS else c for c in session.channels
        ),
    )
    records = usable_records(sure)
    result = estimate(grey_box(sure, records), records, generic_vehicles())
    # They drag the fit along and stay a few of their sigmas from where they are.
    finding = by_gate(parameter_findings(result))["contradiction"]
    assert finding.severity is not Severity.NOTE
    assert finding.text.count("delay of ") == 2
