"""Simulated campaigns: noise as defined, sensors as mounted, and errors against the bound."""

from __future__ import annotations

from math import inf, nan, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from dbc.errors import InputError
from identify.decays.decay import Record
from identify.model.matrices import physical_model
from identify.model.response import Bump, exact_response
from identify.study.campaign import (
    SENSOR_SETS,
    Campaign,
    Outcome,
    bound_percent,
    noise_study,
    outcome,
    records_of,
)

QUIET = np.inf
# docs/method.md, "Noise and the bound", by another program: 30 dB, three cases, two mass states.


AT_200_HZ = [0.64, 0.74, 0.82, 0.76, 0.71, 0.77, 0.68, 0.73, 0.67, 0.73, 0.67, 0.52, 0.34, 1.14]
WORST = {100.0: 1.58, 200.0: 1.14, 500.0: 0.73, 1000.0: 0.52}
FOUR = (Excitation.BOUNCE, Excitation.PITCH, Excitation.ROLL, Excitation.WARP)
WORST_WITH_WARP = {100.0: 1.03, 200.0: 0.75, 500.0: 0.48, 1000.0: 0.34}


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
    ("rate_hz", "noise_db", "cases", "taken"),
    [
        (40.0, -20.0, (Excitation.ROLL,), True),
        (20_000.0, inf, (Excitation.ROLL,), True),
        (39.9, 30.0, (Excitation.ROLL,), False),
        (20_001.0, 30.0, (Excitation.ROLL,), False),
        (nan, 30.0, (Excitation.ROLL,), False),
        (200.0, nan, (Excitation.ROLL,), False),
        (200.0, -20.1, (Excitation.ROLL,), False),
        (200.0, 30.0, (), False),
        (200.0, 30.0, (Excitation.ROLL, Excitation.ROLL), False),
    ],
)
def test_a_campaign_is_taken_within_its_limits(
    rate_hz: float, noise_db: float, cases: tuple[Excitation, ...], taken: bool
) -> None:
    if taken:
        Campaign(rate_hz, noise_db, cases)
    else:
        with pytest.raises(InputError):
            Campaign(rate_hz, noise_db, cases)


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


def test_what_bounce_and_pitch_do_not_tell_has_no_bound() -> None:
    campaign = Campaign(cases=(Excitation.BOUNCE, Excitation.PITCH))
    bound = bound_percent(campaign)
    unknown = {name for name, b in zip(PARAMETER_NAMES, bound, strict=True) if np.isinf(b)}
    assert unknown == {"I_xx", "t_f", "t_r"}
    (_, remark) = noise_study(campaign, bound, []).notes
    assert "I_xx, t_f, t_r" in remark


def test_a_bound_needs_noise_of_at_most_100_db() -> None:
    assert np.all(bound_percent(Campaign(noise_db=100.0)) < 1e-3)
    for noise_db in (100.1, np.inf):
        with pytest.raises(InputError, match="no noise"):
            bound_percent(Campaign(noise_db=noise_db))


def test_a_campaign_without_any_oracle_comes_near_the_truth() -> None:
    campaign = Campaign()
    bound = bound_percent(campaign)
    for seed in (1, 2):
        found = outcome(campaign, seed)
        assert not found.lost
        assert np.all(np.abs(found.errors_percent) < 4.5 * bound)
        np.testing.assert_allclose(found.stds_percent, bound, rtol=0.35)
        assert np.any(found.errors_percent != outcome(campaign, seed + 2).errors_percent)


def shares(*first: float) -> NDArray[np.float64]:
    """Return 15 numbers that begin with these; the others are 1."""
    return np.array([*first, *[1.0] * (15 - len(first))])


def made_up(error: float, std: float, chi2: float = 1.0, converged: bool = True) -> Outcome:
    return Outcome(shares(error), shares(std), chi2, converged)


def test_a_noise_study_sums_up_the_campaigns_that_are_not_lost() -> None:
    """Errors of 3 and -1 %: rms sqrt(5); stated 1 and 7 %: sqrt(25); one of two intervals holds."""
    kept = [made_up(3.0, 1.0), made_up(-1.0, 7.0)]
    lost = [made_up(99.0, 1.0, 2.0), made_up(99.0, 1.0, 2.0, False), made_up(9.0, 30.0)]
    study = noise_study(Campaign(), shares(2.5), [*kept, *lost])
    assert study.title == "Noise study: 5 campaigns at 30 dB, 200 Hz, bounce, pitch, roll"
    name, *cells = study.rows[0]
    assert name == "m_s"
    assert cells == pytest.approx([sqrt(5.0), 5.0, 2.5, sqrt(5.0) / 2.5, 50.0])
    assert list(study.rows[1][1:]) == pytest.approx([1.0, 1.0, 1.0, 1.0, 100.0])
    ratio = sqrt((0.8 + 14.0) / 15.0)
    assert study.notes == (
        "lost: 3 of 5 (not converged 1, chi2/n above 1.5 2, a standard deviation above 25 % 1)",
        f"rms error 2.236 % at most; 0.894 .. 1.000 times the bound, {ratio:.3f} in the mean "
        "square",
        "95 % intervals hold the truth in 96.7 % of all cases; for one parameter, 50 .. 100 % may "
        "be chance",
    )
