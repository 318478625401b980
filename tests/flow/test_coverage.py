import numpy as np

from daq.bench.config import load_bench

from .coverage import outcome


def test_intervals_hold_the_truth_and_no_parameter_is_off_by_two_percent() -> None:
    outcomes = [outcome(load_bench(None), seed) for seed in range(2)]
    for one in outcomes:
        assert one.quality.verdict == "ok", one.quality.reasons
        assert 0.9 < one.quality.chi2_per_n < 1.1
        assert np.max(np.abs(one.errors)) < 0.02
        assert np.max(one.stds) < 0.005  # else two per cent would be luck
    # Fifteen parameters hang together, so two campaigns are some ten independent trials.
    assert np.mean([one.covered for one in outcomes]) > 0.7
    z = np.concatenate([one.errors / one.stds for one in outcomes])
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.7
