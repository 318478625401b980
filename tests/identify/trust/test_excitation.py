from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from daq.runs import ADDED, BASELINE, Excitation
from daq.vehicle import FORD_GRANADA, AddedMass
from dbc.finding import Finding, Severity
from identify.decays.decay import FreeDecay
from identify.fit.estimation import Estimation
from identify.model.matrices import PhysicalModel, loaded_model, physical_model
from identify.modes.modal_model import modes_of
from identify.trust.motion import best_run, excitation_findings, mode_snr_db

from .campaigns import SEEDS, estimated

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


def findings(estimation: Estimation) -> tuple[Finding, ...]:
    return excitation_findings(estimation, mode_snr_db(estimation))


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


@pytest.mark.parametrize("seed", SEEDS)
def test_bounce_and_pitch_do_not_excite_roll_and_that_is_no_finding(seed: int) -> None:
    estimation = estimated("linear", seed)
    snr = mode_snr_db(estimation)
    against = np.array(antisymmetric(baseline(estimation)))
    assert against.sum() == 3
    for label in ("baseline_bounce_1", "baseline_pitch_2"):
        levels = np.array(snr[label])
        assert levels[against].max() < 14.0
        assert levels[~against].min() > 18.0
    assert min(snr["baseline_roll_1"]) > 40.0
    assert excitation_findings(estimation, snr) == ()


def test_without_a_roll_run_three_modes_are_named_in_each_state() -> None:
    found = findings(estimated("no_roll", 1))
    assert [finding.severity for finding in found] == [Severity.WARNING] * 2
    for finding, state in zip(found, (BASELINE, ADDED), strict=True):
        assert finding.code == "excitation"
        assert f"record a roll run in state {state}" in finding.text
        for name in ("body roll", "front wheels antisym", "rear wheels antisym"):
            assert name in finding.text
        assert "bounce" not in finding.text


def test_a_state_that_has_only_roll_runs_of_another_state_is_named() -> None:
    estimation = estimated("linear", 1)
    kept = tuple(d for d in estimation.decays if not d.label.startswith("added_roll"))
    (finding,) = findings(replace(estimation, decays=kept))
    assert f"record a roll run in state {ADDED}" in finding.text
    assert BASELINE not in finding.text


def test_a_motion_drowned_in_noise_asks_for_each_run() -> None:
    estimation = estimated("linear", 1)
    drowned = replace(estimation, rest={n: 1e3 * level for n, level in estimation.rest.items()})
    texts = [f.text for f in findings(drowned) if BASELINE in f.text]
    assert sum("mode" in text for text in texts) == len(texts) > 1
    assert any("record a bounce run" in text for text in texts)
    assert any("record a roll run" in text for text in texts)


def test_the_best_run_of_each_mode_of_the_paper_s_car() -> None:
    model = physical_model(FORD_GRANADA)
    poles = modes_of(model.A).poles
    tyres = np.full(4, FORD_GRANADA.k_tf)
    # What is alike left and right needs bounce or pitch, what is not needs roll or warp.
    for pole, against in zip(poles, antisymmetric(model), strict=True):
        best = best_run(model, pole, tyres)
        assert best in ((Excitation.ROLL,) if against else (Excitation.BOUNCE, Excitation.PITCH))
