import numpy as np

from daq.bench.config import load_bench

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
