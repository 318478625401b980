"""What the motion shows: vague and impossible parameters, weak modes, wheels in the air."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.runs import ADDED, BASELINE, Excitation
from daq.sim.engine import Plant
from daq.sim.motion import GRAVITY_M_S2, Bump, drive, static_pose
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight, Structure, Vehicle
from dbc.words import Finding, Severity
from identify.decays.decay import FreeDecay
from identify.fit.estimation import Estimation
from identify.fit.varpro import evaluate, linear_part
from identify.model.matrices import SYMMETRIC, PhysicalModel, loaded_model
from identify.modes.modal_model import modes_of
from identify.trust.plausibility import (
    excitation_findings,
    least_loads_n,
    lift_off_findings,
    mode_snr_db,
    parameter_findings,
    static_loads_n,
    undetermined,
)

from ...simulated.elements import contact, load_car
from ..stress import BUMP_S, HUBS, REST_S, stress_session
from .campaigns import by_gate, campaign, estimated, fitted


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


# How far each mode stands out of the noise, and wheels that leave the r ---------------------------


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
    system = estimation.box.system(estimation.fit.eta, decay.mass_state)
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


def test_without_a_roll_run_three_modes_are_named_in_each_state() -> None:
    found = findings(estimated("no_roll", 1))
    assert [finding.severity for finding in found] == [Severity.WARNING] * 2
    for finding, state in zip(found, (BASELINE, ADDED), strict=True):
        assert finding.code == "excitation"
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


FULL = SYMMETRIC @ FORD_GRANADA.to_array()
TYRES = FULL[11:15]
CORNER_WEIGHT = (
    BodyWeight(60.0, 0.2, 0.5, height_m=0.4),
    BodyWeight(40.0, -2.9, -0.3),
    HubWeight(6.0, Corner.REAR_RIGHT),
)


def tyre_loads(plant: Plant, pose: Array, velocity: Array) -> Array:
    return contact(plant, pose, velocity, np.zeros((4, pose.shape[1]))).tyre_n


@pytest.mark.parametrize("weights", [(), CORNER_WEIGHT])
def test_static_loads_are_those_of_the_balance_of_forces(
    weights: tuple[BodyWeight | HubWeight, ...],
) -> None:
    plant = load_car(FORD_GRANADA, AddedMass(weights))
    pose = static_pose(plant)
    found = static_loads_n(loaded_model(FULL, AddedMass(weights)), TYRES)
    np.testing.assert_allclose(found, tyre_loads(plant, pose, np.zeros_like(pose))[:, 0], rtol=1e-9)
    carried = 1380.0 + 2 * 40.5 + 2 * 45.4 + sum(weight.mass_kg for weight in weights)
    assert found.sum() == pytest.approx(carried * GRAVITY_M_S2)


@pytest.mark.parametrize("label", ["baseline_bounce_1", "added_roll_2"])
def test_least_loads_are_those_of_the_simulated_car(label: str) -> None:
    """Tyre by tyre from the forces of the simulation; it is the control, so nothing lifts."""
    estimation, session = estimated("linear", 1), campaign("linear", 1)
    state, excitation, _ = label.split("_")
    (decay,) = (d for d in estimation.decays if d.label == label)
    added = session.mass_states[state == ADDED].added
    at = evaluate(estimation.box, estimation.fit.eta, state, estimation.noise)
    static = static_loads_n(loaded_model(FULL, added), TYRES)
    found, sigma = least_loads_n(at, decay, linear_part(at, decay), static, TYRES)

    plant = load_car(FORD_GRANADA, added)
    motion = drive(plant, Bump(Excitation(excitation), 0.05, REST_S, BUMP_S), REST_S + 1.5)
    assert decay.start_s == pytest.approx(REST_S + BUMP_S, abs=1e-6)
    seen = motion.at(REST_S + BUMP_S + 1e-6 + np.arange(0.0, 1.0, 1e-3))
    true = tyre_loads(plant, seen.pose, seen.velocity).min(axis=1)
    assert true.min() > 1000.0
    # Half a per cent of the 2,000 to 3,000 N by which the tyres were relieved or loaded, and noise.
    np.testing.assert_allclose(found, true, atol=30.0)
    assert (sigma < 10.0).all()


def test_a_bump_of_50_mm_lifts_nothing() -> None:
    assert not list(lift_off_findings(estimated("linear", 1)))


def test_a_bump_of_130_mm_is_doubtful() -> None:
    """The last wheel comes down 23 ms after the bump, and the onset is seen 2 ms late."""
    (finding,) = lift_off_findings(estimated("lift_off_high", 1))
    assert (finding.code, finding.severity) == ("lift_off", Severity.WARNING)
    assert "use a lower bump" in finding.text
    assert " more;" in finding.text  # more than three wheels
    waited_ms = float(finding.text.split("once they are down, ")[1].split(" ms")[0])
    assert 15.0 < waited_ms < 25.0


def misstated(estimation: Estimation) -> Estimation:
    """Let the decays start 20 ms later than the session says that the bump ends."""
    records = tuple(replace(r, bump_s=r.bump_s - 0.02) for r in estimation.records)
    return replace(estimation, records=records)


def test_a_late_decay_is_a_lift_off_only_if_a_tyre_has_hardly_any_load() -> None:
    assert not list(lift_off_findings(misstated(estimated("linear", 1))))
    (finding,) = lift_off_findings(misstated(estimated("lift_off", 1)))
    assert finding.severity is Severity.WARNING
