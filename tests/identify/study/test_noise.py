"""Noise against the Cramer-Rao bound."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq import session_from_arrays
from daq.runs import Excitation
from daq.vehicle import DOF, FORD_GRANADA, PARAMETER_NAMES
from dbc.errors import InputError
from identify import identify
from identify.decays.decay import Record
from identify.fit.estimation import estimate
from identify.fit.generic_vehicles import generic_vehicles
from identify.fit.grey_box import GreyBox
from identify.model.matrices import physical_model
from identify.model.response import Bump, exact_response
from identify.study.campaign import (
    PAPER_CASES,
    PAPER_MASS_STATES,
    SENSOR_SETS,
    Campaign,
    noise_levels,
    records_of,
)
from identify.study.noise import Outcome, bound_percent, noise_study, outcome
from identify.study.result import DotPanel

from ..bumps import PAPER_DELTA_MASS, TRUTH, paper_records

# docs/method.md, "Noise and the bound", by another program: 30 dB, three cases, two mass states.
AT_200_HZ = [0.64, 0.74, 0.82, 0.76, 0.71, 0.77, 0.68, 0.73, 0.67, 0.73, 0.67, 0.52, 0.34, 1.14]
WORST = {100.0: 1.58, 200.0: 1.14, 500.0: 0.73, 1000.0: 0.52}
FOUR = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.WARP)
WORST_WITH_WARP = {100.0: 1.03, 200.0: 0.75, 500.0: 0.48, 1000.0: 0.34}


def test_the_bound_is_the_prototypes() -> None:
    bound = bound_percent(Campaign())
    np.testing.assert_allclose(bound[:14], AT_200_HZ, atol=0.011)
    assert bound[14] == pytest.approx(0.84, abs=0.011)


def test_the_bound_falls_with_rate_and_with_a_warp_run() -> None:
    for rate_hz, worst in WORST.items():
        assert bound_percent(Campaign(rate_hz)).max() == pytest.approx(worst, rel=0.015)
    for rate_hz, worst in WORST_WITH_WARP.items():
        campaign = Campaign(rate_hz, cases=FOUR)
        assert bound_percent(campaign).max() == pytest.approx(worst, rel=0.015)


def test_the_bound_with_the_geometry_measured() -> None:
    bound = bound_percent(Campaign(geometry=FORD_GRANADA.geometry))
    assert bound.max() == pytest.approx(0.64, abs=0.005)
    assert np.all(bound[11:] == 0.0)


def test_ten_decibels_are_a_factor_of_root_ten() -> None:
    quiet, loud = bound_percent(Campaign(noise_db=40.0)), bound_percent(Campaign(noise_db=30.0))
    np.testing.assert_allclose(loud / quiet, np.sqrt(10.0), rtol=1e-6)


def test_what_bounce_and_pitch_do_not_tell_has_no_bound() -> None:
    campaign = Campaign(cases=(Excitation.BOUNCE, Excitation.PITCH))
    bound = bound_percent(campaign)
    unknown = {name for name, b in zip(PARAMETER_NAMES, bound, strict=True) if np.isinf(b)}
    assert unknown == {"I_xx", "t_f", "t_r"}
    (_, remark) = noise_study(campaign, bound, []).notes
    assert "I_xx, t_f, t_r" in remark


def test_no_noise_no_bound() -> None:
    with pytest.raises(InputError, match="no noise"):
        bound_percent(Campaign(noise_db=np.inf))


def test_a_campaign_without_any_oracle_comes_near_the_truth() -> None:
    campaign = Campaign()
    bound = bound_percent(campaign)
    for seed in (1, 2):
        found = outcome(campaign, seed)
        assert not found.lost
        assert np.all(np.abs(found.errors_percent) < 4.5 * bound)
        np.testing.assert_allclose(found.stds_percent, bound, rtol=0.35)
        assert np.any(found.errors_percent != outcome(campaign, seed + 2).errors_percent)


def _drawn(n: int, spread: float) -> list[Outcome]:
    """Return outcomes whose errors are `spread` times as large as stated."""
    errors = spread * np.random.default_rng(5).standard_normal((n, 15))
    return [Outcome(row, np.ones(15), 1.0, True) for row in errors]


def test_statistics_of_honest_outcomes() -> None:
    study = noise_study(Campaign(), np.full(15, 0.8), _drawn(4000, 1.0))
    np.testing.assert_allclose(list(study.numbers("rms_error_percent").values()), 1.0, rtol=0.05)
    np.testing.assert_allclose(list(study.numbers("ratio").values()), 1.25, rtol=0.05)
    np.testing.assert_allclose(list(study.numbers("coverage_percent").values()), 95.0, atol=1.5)
    assert study.notes[0].startswith("lost: 0 of 4000")


def test_intervals_that_are_too_narrow_are_seen() -> None:
    study = noise_study(Campaign(), np.ones(15), _drawn(400, 2.0))
    covered = np.array(list(study.numbers("coverage_percent").values()))
    assert np.all(covered < 75.0)  # 67.3 % by the normal distribution
    panel = study.panels[0][1]
    assert isinstance(panel, DotPanel)
    assert panel.expected is not None
    low, high = panel.expected
    assert np.all(covered < low)
    assert 91.0 < low < 95.0 < high < 98.5


def test_what_is_lost_is_counted_and_left_out() -> None:
    good = _drawn(50, 1.0)
    wild = np.full(15, 1e3)
    bad = [
        Outcome(wild, np.ones(15), 1.0, converged=False),
        Outcome(wild, np.ones(15), 3.0, converged=True),
        Outcome(wild, np.full(15, np.inf), 1.0, converged=True),
        Outcome(wild, np.full(15, np.nan), np.nan, converged=True),
    ]
    study = noise_study(Campaign(), np.ones(15), good + bad)
    assert study.notes[0].startswith("lost: 4 of 54 (not converged 1")
    assert study.rows == noise_study(Campaign(), np.ones(15), good).rows


def test_measured_lengths_are_not_in_the_table() -> None:
    study = noise_study(Campaign(geometry=FORD_GRANADA.geometry), np.ones(15), _drawn(3, 1.0))
    assert study.column("parameter") == PARAMETER_NAMES[:11]


# Errors are those of the Cramer-Rao bound, from generic vehicles and with no oracle ---------------

BOX = GreyBox(SENSOR_SETS["paper"], PAPER_MASS_STATES, None)


def _percent(
    cases: tuple[Excitation, ...], campaigns: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return errors and stated standard deviations, %, (campaigns, 15)."""
    errors, stated = [], []
    for seed in range(campaigns):
        result = estimate(BOX, records_of(Campaign(cases=cases), seed), generic_vehicles())
        assert result.fit.converged
        assert result.holds
        errors.append(np.exp(result.fit.eta) / TRUTH - 1.0)
        stated.append(np.sqrt(np.diag(result.fit.covariance)))
    return 100.0 * np.array(errors), 100.0 * np.array(stated)


def test_errors_are_at_the_bound_and_no_fit_is_lost() -> None:
    errors, stated = _percent(PAPER_CASES, 10)
    # docs/method.md, "Noise and the bound": that of another program.
    bound = np.array(
        [0.64, 0.74, 0.82, 0.76, 0.71, 0.77, 0.68, 0.73, 0.67, 0.73, 0.67, 0.52, 0.34, 1.14, 0.84]
    )
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert np.all(rms < 1.6 * bound)
    assert np.all(np.abs(errors) < 5.0 * bound)
    assert 0.90 < np.mean(np.abs(errors) < 1.96 * stated) < 0.99


def test_a_warp_run_brings_every_parameter_below_one_per_cent() -> None:
    errors, stated = _percent((*PAPER_CASES, Excitation.WARP), 12)
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert np.max(rms) < 1.0 * 1.3
    assert np.all(rms < 1.6 * stated.mean(axis=0))
    assert np.max(stated.mean(axis=0)) < 0.80  # docs/method.md: 0.75


@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_clean_data_give_the_vehicle_back_by_both_ways(rate_hz: float) -> None:
    runs = []
    for record in paper_records(rate_hz, np.inf, 0):
        (recording,) = record.recordings
        columns = zip(DOF, recording.values.T, strict=True)
        samples = {name: (recording.time_s, column) for name, column in columns}
        runs.append((record.mass_state, record.label.split("_")[1], samples))
    result = identify(session_from_arrays(runs, delta_mass=PAPER_DELTA_MASS, bump_s=0.2))
    likely = np.array([e.value for e in result.parameters.values()])
    chain = np.array(list(result.closed_form.values()))
    np.testing.assert_allclose(likely, TRUTH, rtol=1e-8)
    np.testing.assert_allclose(chain, TRUTH, rtol=1e-7)


# Simulated campaigns: noise as defined, sensors as mounted ----------------------------------------

QUIET = np.inf


def _values(record: Record) -> dict[str, NDArray[np.float64]]:
    return {
        channel.name: column
        for recording in record.recordings
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True)
    }


def test_noise_lies_30_db_below_the_rms_over_the_three_records() -> None:
    noisy = records_of(Campaign(rate_hz=1000.0), 1)
    clean = records_of(Campaign(rate_hz=1000.0, noise_db=QUIET), 1)
    assert [r.label for r in noisy[:4]] == [
        "baseline_bounce_1",
        "baseline_pitch_1",
        "baseline_roll_1",
        "added_bounce_1",
    ]
    for state in (slice(0, 3), slice(3, 6)):
        signal = np.concatenate([r.recordings[0].values for r in clean[state]])
        noise = np.concatenate([r.recordings[0].values for r in noisy[state]]) - signal
        ratio = noise.std(axis=0) / np.sqrt(np.mean(signal**2, axis=0))
        np.testing.assert_allclose(20 * np.log10(ratio), -30.0, atol=0.3)


def test_noise_levels_are_those_of_the_records() -> None:
    campaign = Campaign(rate_hz=1000.0, groups=SENSOR_SETS["all"])
    clean = Campaign(rate_hz=1000.0, noise_db=QUIET, groups=SENSOR_SETS["all"])
    noisy = [_values(r) for r in records_of(campaign, 2)]
    quiet = [_values(r) for r in records_of(clean, 2)]
    for name, level in noise_levels(campaign).items():
        noise = np.concatenate([a[name] - b[name] for a, b in zip(noisy, quiet, strict=True)])
        assert noise.std() == pytest.approx(level, rel=0.03)


def test_one_more_run_leaves_the_noise_as_it_is() -> None:
    assert noise_levels(Campaign(cases=tuple(Excitation))) == noise_levels(Campaign())


def test_sensors_see_the_motion_of_their_places() -> None:
    campaign = Campaign(noise_db=QUIET, cases=(Excitation.WARP,), groups=SENSOR_SETS["all"])
    seen = _values(records_of(campaign, 0)[0])
    run = exact_response(
        physical_model(FORD_GRANADA), Excitation.WARP, Bump(), campaign.rate_hz, 3.0
    )
    z, theta, phi, a, b, c, d = run.displacement.T
    # The IMU is 1.05 m behind the front axle, the CG 1.25 m.
    np.testing.assert_allclose(seen["imu_z"], run.acceleration @ [1, -0.2, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(seen["pitch_rate"], run.velocity[:, 1])
    np.testing.assert_allclose(seen["roll_rate"], run.velocity[:, 2])
    np.testing.assert_allclose(seen["hub_RL"], run.acceleration[:, 5])
    corner = {
        "FL": (a, z - 1.25 * theta + 0.74 * phi),
        "FR": (b, z - 1.25 * theta - 0.74 * phi),
        "RL": (c, z + 1.51 * theta + 0.74 * phi),
        "RR": (d, z + 1.51 * theta - 0.74 * phi),
    }
    for name, (wheel, body) in corner.items():
        np.testing.assert_allclose(seen[f"travel_{name}"], wheel - body, atol=1e-12)


@pytest.mark.parametrize(
    ("rate_hz", "noise_db", "cases"),
    [
        (0.0, 30.0, (Excitation.ROLL,)),
        (np.nan, 30.0, (Excitation.ROLL,)),
        (1e6, 30.0, (Excitation.ROLL,)),
        (200.0, np.nan, (Excitation.ROLL,)),
        (200.0, -50.0, (Excitation.ROLL,)),
        (200.0, 30.0, ()),
        (200.0, 30.0, (Excitation.ROLL, Excitation.ROLL)),
    ],
)
def test_campaigns_that_make_no_sense(
    rate_hz: float, noise_db: float, cases: tuple[Excitation, ...]
) -> None:
    with pytest.raises(InputError):
        Campaign(rate_hz, noise_db, cases)
