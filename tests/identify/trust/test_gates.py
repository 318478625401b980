"""The fit itself: vague and impossible parameters, weak modes, and residuals that are not white."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import nan

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.vehicle import FORD_GRANADA, AddedMass, Structure, Vehicle
from dbc.words import Severity
from identify.decays.decay import FreeDecay, Record, Recording
from identify.fit.estimation import Estimation
from identify.model.matrices import PhysicalModel, loaded_model
from identify.modes.modal_model import modes_of
from identify.trust.gates import (
    chi2_by_run,
    misfit_findings,
    mode_snr_db,
    parameter_findings,
    undetermined,
    whiteness_findings,
)

from ..stress import (
    BODY,
    HUBS,
    REST_S,
    by_gate,
    campaign,
    doubtful,
    estimated,
    fitted,
    stress_session,
)

Array = NDArray[np.float64]


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
    elements = replace(linear, nonlinear=linear.engine)
    assert not list(parameter_findings(_with_std(elements, "k_sf", 0.021)))
    (finding,) = parameter_findings(_with_std(elements, "k_sf", 0.023))
    assert finding.code == "wide"


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
        (-4.0 * std, []),
        (-0.49 * k_sf / 1e4, []),
        (-0.51 * k_sf / 1e4, ["implausible"]),
    ):
        eta = result.fit.eta.copy()
        eta[i] = unknown
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
    result = fitted(sure)
    # They drag the fit along and stay a few of their sigmas from where they are.
    finding = by_gate(parameter_findings(result))["contradiction"]
    assert finding.severity is not Severity.NOTE
    assert finding.text.count("delay of ") == 2


# How far each mode stands out of the noise -------------------------------------------------------


def antisymmetric(model: PhysicalModel) -> list[bool]:
    """Return for each mode whether left and right move against each other."""
    shapes = modes_of(model.A).shapes
    left, right = shapes[[3, 5]], shapes[[4, 6]]
    return [
        bool(np.abs(a + b).sum() < np.abs(a - b).sum())
        for a, b in zip(left.T, right.T, strict=True)
    ]


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


def test_bounce_and_pitch_do_not_excite_roll() -> None:
    estimation = estimated("linear", 1)
    snr = mode_snr_db(estimation)
    against = np.array(antisymmetric(loaded_model(estimation.full, AddedMass())))
    assert against.sum() == 3
    for label in ("baseline_bounce_1", "baseline_pitch_2"):
        levels = np.array(snr[label])
        assert levels[against].max() < 14.0
        assert levels[~against].min() > 18.0
    assert min(snr["baseline_roll_1"]) > 40.0


# Residuals: of the noise's size, and white ------------------------------------------------------


def test_noise_alone_is_no_misfit(linear: Estimation) -> None:
    assert not list(misfit_findings(linear))
    table = chi2_by_run(linear)
    assert list(table) == [run.label for run in campaign("linear", 1).runs]
    assert all(set(row) == {*BODY, *HUBS} for row in table.values())
    # 560 samples a cell: a spread of 6 %, and as much again by the noise level at rest.
    cells = np.array([list(row.values()) for row in table.values()])
    assert np.all(np.abs(cells - 1.0) < 0.35)
    assert cells.mean() == pytest.approx(1.0, abs=0.05)


def test_a_channel_that_is_twice_as_loud_in_one_run_is_pointed_at(linear: Estimation) -> None:
    label = "added_pitch_1"
    spoilt = tuple(
        replace(r, values={**r.values, "roll_rate": 2.0 * r.values["roll_rate"]})
        if r.label == label
        else r
        for r in linear.residuals
    )
    before, after = chi2_by_run(linear), chi2_by_run(replace(linear, residuals=spoilt))
    assert after[label]["roll_rate"] == pytest.approx(4.0 * before[label]["roll_rate"])
    (finding,) = misfit_findings(replace(linear, residuals=spoilt, chi2_per_n=1.2))
    assert "worst roll_rate in added_pitch_1" in finding.text


def test_a_fit_astray_is_refused_and_a_nonlinear_one_doubtful(linear: Estimation) -> None:
    lost = replace(linear, fit=replace(linear.fit, converged=False, iterations=30))
    for spoilt, severity, words in (
        (lost, Severity.ERROR, "30 iterations"),
        (replace(lost, nonlinear=linear.engine), Severity.WARNING, "forbid"),
        (
            replace(linear, unreached=("bump stops", "the last steps")),
            Severity.WARNING,
            "not finished: bump stops, the last steps;",
        ),
    ):
        (finding,) = misfit_findings(spoilt)
        assert (finding.code, finding.severity) == ("convergence", severity)
        assert words in finding.text


def test_noise_that_was_not_seen_at_rest_is_said(linear: Estimation) -> None:
    (finding,) = misfit_findings(replace(linear, rest={}))
    assert (finding.code, finding.severity) == ("noise", Severity.NOTE)


def test_a_bump_that_lasts_longer_than_stated_shows_in_the_start() -> None:
    late = estimated("early_20ms", 1)
    finding = by_gate(misfit_findings(late))["late_start"]
    assert finding.severity is Severity.WARNING
    # In truth the bump ends 0.2 s after the rest; no forced sample is in the windows but of wheels
    # that are not on the bump, which feel it later.
    assert all(REST_S + 0.2 - 2e-3 < decay.start_s < REST_S + 0.206 for decay in late.decays)
    assert not list(misfit_findings(estimated("early", 1)))


@pytest.mark.parametrize(
    ("chi2", "severity", "words"),
    [
        (1.4, Severity.WARNING, "are widened"),
        (1.6, Severity.ERROR, "do not hold"),
        (nan, Severity.ERROR, "do not hold"),
    ],
)
def test_the_further_from_one_the_worse_and_a_nonlinear_fit_has_wider_intervals(
    linear: Estimation, chi2: float, severity: Severity, words: str
) -> None:
    (of_linear,) = misfit_findings(replace(linear, chi2_per_n=chi2))
    assert (of_linear.code, of_linear.severity) == ("chi2", severity)
    assert "do not hold" in of_linear.text
    (finding,) = misfit_findings(replace(linear, chi2_per_n=chi2, nonlinear=linear.engine))
    assert (finding.code, finding.severity) == ("chi2", severity)
    assert words in finding.text
    assert "with friction" in finding.text


CHANNEL = "body_acc_z"


def autoregressive(shape: int, r: float, sigma: float, rng: np.random.Generator) -> Array:
    """Noise whose samples are correlated by `r` with the one before."""
    noise = rng.standard_normal(shape)
    for k in range(1, shape):
        noise[k] = r * noise[k - 1] + np.sqrt(1.0 - r**2) * noise[k]
    return sigma * noise


def with_residuals(estimation: Estimation, change: Callable[[Array], Array]) -> Estimation:
    left = tuple(
        replace(r, values={**r.values, CHANNEL: change(r.values[CHANNEL])})
        for r in estimation.residuals
    )
    return replace(estimation, residuals=left)


def with_rest(estimation: Estimation, change: Callable[[Array], Array]) -> Estimation:
    """Change what a channel says at rest."""

    def changed(recording: Recording) -> Recording:
        names = [channel.name for channel in recording.group.channels]
        if CHANNEL not in names:
            return recording
        values = recording.values.copy()
        quiet, column = recording.time_s < REST_S, names.index(CHANNEL)
        values[quiet, column] = change(values[quiet, column])
        return Recording(recording.group, recording.time_s, values)

    def record(old: Record) -> Record:
        return replace(old, recordings=tuple(map(changed, old.recordings)))

    return replace(estimation, records=tuple(map(record, estimation.records)))


def coloured(r: float, seed: int) -> Callable[[Array], Array]:
    rng = np.random.default_rng(seed)

    def change(values: Array) -> Array:
        return np.asarray(values.mean() + autoregressive(len(values), r, values.std(), rng))

    return change


def test_a_misfit_that_chi2_hardly_shows_is_doubtful() -> None:
    """Hubs that are 1 ms late bend the fit of the body, and chi2/n is 1.04."""
    assert not list(whiteness_findings(estimated("linear", 1)))
    estimation = estimated("hubs_late_1ms", 1)
    assert estimation.chi2_per_n < 1.1
    (finding,) = whiteness_findings(estimation)
    assert (finding.code, finding.severity) == ("whiteness", Severity.WARNING)
    assert "at rest (z " in finding.text


@pytest.mark.parametrize(
    ("r", "severity", "factor"),
    # The mean of n samples correlated by r has the variance of (1 - r) / (1 + r) n white ones.
    [(0.6, Severity.WARNING, 2.0), (0.15, Severity.NOTE, 1.16)],
)
def test_noise_coloured_at_rest_and_in_the_residuals_narrows_the_intervals(
    r: float, severity: Severity, factor: float
) -> None:
    noisy = with_rest(estimated("linear", 1), coloured(r, 1))
    (finding,) = whiteness_findings(with_residuals(noisy, coloured(r, 2)))
    assert (finding.code, finding.severity) == ("coloured_noise", severity)
    assert CHANNEL in finding.text
    found = float(finding.text.split("narrow by up to ")[1].split(" ")[0])
    assert found == pytest.approx(factor, rel=0.06)


def test_residuals_more_coloured_than_the_rest_are_a_misfit_too() -> None:
    noisy = with_rest(estimated("linear", 1), coloured(0.15, 1))
    findings = by_gate(whiteness_findings(with_residuals(noisy, coloured(0.5, 2))))
    assert set(findings) == {"coloured_noise", "whiteness"}
    assert doubtful(findings.values()) == ["whiteness"]


def test_without_rest_colour_may_be_noise_or_misfit() -> None:
    estimation = estimated("linear", 1)
    moving = replace(
        estimation,
        records=tuple(
            replace(r, recordings=tuple(q.between(1.25, 9.0) for q in r.recordings))
            for r in estimation.records
        ),
        rest={},
    )
    assert not list(whiteness_findings(moving))
    (finding,) = whiteness_findings(with_residuals(moving, coloured(0.4, 4)))
    assert finding.severity is Severity.WARNING
    assert "or the noise is coloured" in finding.text
