"""What the motion shows: vague and impossible parameters, and weak modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.runs import ADDED, BASELINE
from daq.vehicle import FORD_GRANADA, AddedMass, Structure, Vehicle
from dbc.words import Finding, Severity
from identify.decays.decay import FreeDecay
from identify.fit.estimation import Estimation
from identify.model.matrices import PhysicalModel, loaded_model
from identify.modes.modal_model import modes_of
from identify.trust.plausibility import (
    excitation_findings,
    mode_snr_db,
    parameter_findings,
    undetermined,
)

from ..stress import HUBS, by_gate, estimated, fitted, stress_session


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


@pytest.mark.parametrize("std", [np.inf, 0.3])
def test_a_parameter_that_is_not_determined_refuses_all(linear: Estimation, std: float) -> None:
    assert undetermined(linear) == ()
    vague = _with_std(linear, "I_xx", std)
    assert undetermined(vague) == ("I_xx",)
    (finding,) = parameter_findings(vague)
    assert (finding.code, finding.severity) == ("undetermined", Severity.ERROR)
    assert "determine I_xx:" in finding.text
    assert "warp" in finding.text


def test_an_interval_wider_than_5_per_cent_is_doubtful(linear: Estimation) -> None:
    assert not list(parameter_findings(_with_std(linear, "k_sf", 0.024)))
    (finding,) = parameter_findings(_with_std(linear, "k_sf", 0.03))
    assert (finding.code, finding.severity) == ("wide", Severity.WARNING)
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


# How far each mode stands out of the noise -------------------------------------------------------


Array = NDArray[np.float64]


def antisymmetric(model: PhysicalModel) -> list[bool]:
    """Return for each mode whether left and right move against each other."""
    shapes = modes_of(model.A).shapes
    left, right = shapes[[3, 5]], shapes[[4, 6]]
    return [
        bool(np.abs(a + b).sum() < np.abs(a - b).sum())
        for a, b in zip(left.T, right.T, strict=True)
    ]


def baseline(estimation: Estimation) -> PhysicalModel:
    full = estimation.box.full(estimation.fit.eta.astype(complex)).real
    return loaded_model(full, AddedMass())


def findings(estimation: Estimation) -> list[Finding]:
    return list(excitation_findings(estimation, mode_snr_db(estimation)))


def brute_force_db(estimation: Estimation, decay: FreeDecay) -> Array:
    """Energy of each mode by one large least-squares problem, sample by sample.

    Columns are the motion of each mode (its two quadratures) and a constant for each channel, by
    the matrix exponential; the energy of a mode is that of its share which no other column can
    imitate.
    """
    system = estimation.box.systems(estimation.fit.eta, {decay.mass_state})[decay.mass_state]
    poles, V = np.linalg.eig(system.A)
    upper = np.flatnonzero(poles.imag > 0)
    upper = upper[np.argsort(np.abs(poles[upper]))]
    shapes = np.column_stack([part for k in upper for part in (V[:, k].real, V[:, k].imag)])
    n_channels = sum(len(q.group.channels) for q in decay.recordings)
    rows, data, column = [], [], 0
    for q in decay.recordings:
        for c, channel in enumerate(q.group.channels):
            step = expm(system.A * (q.time_s[1] - q.time_s[0]))
            motion = expm(system.A * q.time_s[0]) @ shapes
            constant = np.eye(n_channels)[column]
            for value in q.values[:, c]:
                seen = np.concatenate([system.rows[channel.name] @ motion, constant])
                rows.append(seen / estimation.noise[channel.name])
                data.append(value / estimation.noise[channel.name])
                motion = step @ motion
            column += 1
    design = np.array(rows)
    fitted = np.linalg.lstsq(design, np.array(data), rcond=None)[0]
    result = []
    for k in range(len(upper)):
        own = design[:, 2 * k : 2 * k + 2]
        others = np.delete(design, [2 * k, 2 * k + 1], axis=1)
        wave = own @ fitted[2 * k : 2 * k + 2]
        alone = wave - others @ np.linalg.lstsq(others, wave, rcond=None)[0]
        result.append(10.0 * np.log10(alone @ alone))
    return np.array(result)


def test_the_energy_is_that_of_a_large_least_squares_problem() -> None:
    estimation = estimated("linear", 1)
    (decay,) = (d for d in estimation.decays if d.label == "baseline_roll_1")
    decay = decay.thinned(50.0)
    thin = replace(estimation, decays=(decay,))
    expected = brute_force_db(thin, decay)
    assert mode_snr_db(thin)[decay.label] == pytest.approx(expected, abs=0.01)


def test_bounce_and_pitch_do_not_excite_roll_and_that_is_no_finding() -> None:
    estimation = estimated("linear", 1)
    snr = mode_snr_db(estimation)
    against = np.array(antisymmetric(baseline(estimation)))
    assert against.sum() == 3
    for label in ("baseline_bounce_1", "baseline_pitch_2"):
        levels = np.array(snr[label])
        assert levels[against].max() < 14.0
        assert levels[~against].min() > 18.0
    assert min(snr["baseline_roll_1"]) > 40.0
    assert not list(excitation_findings(estimation, snr))


def test_without_a_roll_run_roll_is_undetermined_and_its_modes_are_named_in_each_state() -> None:
    estimation = estimated("no_roll", 1)
    assert {"I_xx", "t_f", "t_r"} <= set(undetermined(estimation))
    for finding, state in zip(findings(estimation), (BASELINE, ADDED), strict=True):
        assert (finding.code, finding.severity) == ("excitation", Severity.WARNING)
        assert f"record a roll run in state {state}" in finding.text
        for name in ("body roll", "front wheels antisym", "rear wheels antisym"):
            assert name in finding.text
        assert "bounce" not in finding.text


def test_a_motion_drowned_in_noise_asks_for_each_run() -> None:
    estimation = estimated("linear", 1)
    drowned = replace(estimation, rest={n: 1e3 * level for n, level in estimation.rest.items()})
    texts = [f.text for f in findings(drowned) if BASELINE in f.text]
    assert sum("mode" in text for text in texts) == len(texts) > 1
    assert any("record a bounce run" in text for text in texts)
    assert any("record a roll run" in text for text in texts)
