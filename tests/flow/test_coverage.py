"""Intervals hold the truth of simulated campaigns; one known mass fixes all scales."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.config import Bench, WeightTable, load_bench
from daq.vehicle import Corner

from .coverage import outcome


def test_intervals_hold_the_truth_and_no_parameter_is_off_by_two_percent() -> None:
    one = outcome(load_bench(None), 0)  # `make coverage`: a hundred
    assert one.quality.verdict == "ok", one.quality.reasons
    assert 0.9 < one.quality.chi2_per_n < 1.1
    assert np.max(np.abs(one.errors)) < 0.02
    assert np.max(one.stds) < 0.01  # else two per cent would be luck
    # Fifteen parameters hang together, so a campaign is some five independent trials.
    assert np.mean(one.covered) > 0.7
    assert 0.5 < np.sqrt(np.mean((one.errors / one.stds) ** 2)) < 1.7


# Few added weights --------------------------------------------------------------------------------

ONE = [WeightTable(mass_kg=32.5, x_m=0.14, y_m=0.55)]
HUBS = [WeightTable(mass_kg=4.0, hub=corner) for corner in Corner]


def _bench(weights: Sequence[WeightTable]) -> Bench:
    shipped = load_bench(None)
    campaign = replace(shipped.campaign, repeats=1)
    return replace(shipped, campaign=campaign, weights=tuple(weights))


@pytest.mark.parametrize(("weights", "std"), [(HUBS, 0.018), (ONE, 0.021)])
def test_weights_on_the_hubs_alone_or_a_single_one_on_the_floor_determine_all_parameters(
    weights: Sequence[WeightTable], std: float
) -> None:
    one = outcome(_bench(weights), 0)
    assert one.quality.verdict == "ok", one.quality.reasons
    assert len(one.names) == 15
    assert np.max(one.stds) < std
    # The common scale is one error of eleven parameters.
    assert np.max(np.abs(one.errors / one.stds)) < 3.0


def test_weights_too_light_to_fix_the_scale_are_named() -> None:
    one = outcome(_bench([WeightTable(mass_kg=0.05, x_m=0.14, y_m=0.55)]), 0)
    assert one.quality.verdict == "refused"
    (reason,) = one.quality.reasons
    assert "determine m_s, I_yy, I_xx, m_uf, m_ur, k_sf, k_sr, k_tf, k_tr, c_sf, c_sr:" in reason
    assert "add heavier ones, or weigh the vehicle" in reason
