"""Parameters must be determined, plausible, and in keeping with what was stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.vehicle import FORD_GRANADA, Structure, Vehicle
from dbc.finding import Severity
from identify.fit.estimation import Estimation
from identify.trust.plausibility import parameter_findings, undetermined

from ..stress import HUBS, stress_session
from .campaigns import by_gate, estimated, fitted


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
    assert not list(parameter_findings(linear))
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
    assert not list(parameter_findings(_with_std(linear, "k_sf", 0.024)))
    (finding,) = parameter_findings(_with_std(linear, "k_sf", 0.03))
    assert finding.code == "wide"
    assert finding.severity is Severity.WARNING
    assert "worst k_sf ± 5.9 %)" in finding.text


@pytest.mark.parametrize(
    ("name", "factor", "quantity"),
    [
        ("c_sf", 10.0, "front_ride_damping_ratio"),
        ("m_s", 0.01, " kg (usual 200 .. 20,000)"),
        ("k_tr", 20.0, "rear_wheel_hop_frequency"),
        ("k_sr", 0.1, " Hz (usual 0.5 .. 5)"),
        ("I_yy", 0.4, "pitch_index"),
        ("I_xx", 0.4, "roll_gyration_over_track"),
    ],
)
def test_what_no_road_vehicle_is_like_is_doubtful(
    linear: Estimation, name: str, factor: float, quantity: str
) -> None:
    odd = _with_value(linear, name, factor * float(getattr(FORD_GRANADA, name)))
    finding = by_gate(parameter_findings(odd))["implausible"]
    assert finding.severity is Severity.WARNING
    assert quantity in finding.text


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        # k_x / track of the whole car: 0.9 times 0.367 and 1.1 times 0.512.  By hand: (I_xx + 171.8
        # t^2) / 1551.8 over (2 t)^2, t = 0.74 m.
        ("I_xx", 1551.8 * (0.3303 * 1.48) ** 2 - 94.08, 1551.8 * (0.5632 * 1.48) ** 2 - 94.08),
        # k_y^2 / (a b): 0.9 times 0.816 and 1.1 times 1.298, the wheels' share included.
        ("I_yy", 1824.5, 3861.4),
    ],
)
def test_the_inertias_lie_by_those_of_measured_vehicles(
    linear: Estimation, name: str, low: float, high: float
) -> None:
    exact = linear
    for parameter in linear.box.names:
        exact = _with_value(exact, parameter, float(getattr(FORD_GRANADA, parameter)))
    for value, odd in (
        (0.98 * low, True), (1.02 * low, False), (0.98 * high, False), (1.02 * high, True),
    ):  # fmt: skip
        gates = [f.code for f in parameter_findings(_with_value(exact, name, value))]
        assert ("implausible" in gates) is odd


def test_a_solid_axle_is_no_fault_and_an_axle_without_roll_stiffness_is() -> None:
    session = stress_session("bars", 1, vehicle=Vehicle("x", structure=Structure(True, True)))
    result = fitted(session)
    assert not list(parameter_findings(result))
    names = result.box.parameters
    i = names.index("k_af")
    std = float(np.sqrt(result.fit.covariance[i, i]))
    k_sf = float(result.box.values(result.fit.eta)[result.box.names.index("k_sf")])
    # The unknown is in units of 10 kN/m; in roll the front has k_s + 2 k_a.
    for unknown, gates in (
        (-2.0 * std, []),
        (-4.0 * std, ["solid_axle"]),
        (-0.49 * k_sf / 1e4, ["solid_axle"]),
        (-0.51 * k_sf / 1e4, ["implausible"]),
    ):
        eta = result.fit.eta.copy()
        eta[i] = unknown
        moved = replace(result, fit=replace(result.fit, eta=eta))
        found = parameter_findings(moved)
        assert [f.code for f in found] == gates
        assert all(f.severity is Severity.NOTE for f in found if f.code == "solid_axle")


def test_a_stated_delay_that_the_runs_contradict_is_named() -> None:
    session = stress_session("hubs_late_1ms", 1)
    sure = replace(
        session,
        channels=tuple(
            replace(c, delay_sigma_s=1e-5) if c.name in HUBS else c for c in session.channels
        ),
    )
    result = fitted(sure)
    # They drag the fit along and stay a few of their sigmas from where they are.
    finding = by_gate(parameter_findings(result))["contradiction"]
    assert finding.severity is not Severity.NOTE
    assert finding.text.count("delay of ") == 2
