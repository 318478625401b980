"""Noise against the Cramer-Rao bound."""

from __future__ import annotations

import numpy as np
import pytest

from daq.runs import Excitation
from daq.vehicle import FORD_GRANADA, PARAMETER_NAMES
from dbc.errors import InputError
from identify.study.campaign import Campaign
from identify.study.noise import Outcome, bound_percent, noise_study, outcome
from identify.study.result import DotPanel

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
