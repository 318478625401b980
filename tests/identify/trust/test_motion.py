"""How far each mode stands out of the noise, and wheels that leave the road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.runs import ADDED, BASELINE, Excitation
from daq.sim.engine import Plant
from daq.sim.motion import GRAVITY_M_S2, Bump, drive, static_pose
from daq.vehicle import FORD_GRANADA, AddedMass, BodyWeight, Corner, HubWeight
from dbc.finding import Finding, Severity
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
    static_loads_n,
)

from ...simulated.elements import contact, load_car
from ..stress import BUMP_S, REST_S
from .campaigns import campaign, estimated

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
