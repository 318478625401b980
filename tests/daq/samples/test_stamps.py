"""Sensor time stamps fitted to the time of the bus."""

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.samples.clock import stamped_times
from daq.samples.groups import bind

CYCLE_S = 0.01


def _samples(number: NDArray[np.int64], cycle_s: float = CYCLE_S) -> NDArray[np.float64]:
    return np.asarray(number * cycle_s, dtype=np.float64)


def _arrive(taken_s: NDArray[np.float64], seed: int = 1) -> NDArray[np.int64]:
    late = np.random.default_rng(seed).exponential(300e-6, len(taken_s))
    return np.rint(np.maximum.accumulate(taken_s + late) * 1e9).astype(np.int64)


@pytest.mark.parametrize("drift", [-200e-6, 0.0, 300e-6, 0.01])
@pytest.mark.parametrize("wrap_s", [0.65536, 4294.967296])
def test_times_are_those_of_the_samples(drift: float, wrap_s: float) -> None:
    k = np.delete(np.arange(600), [100, 101, 300])
    taken = _samples(k, CYCLE_S * (1 + drift))
    stamp: NDArray[np.float64] = (_samples(k) + wrap_s - 0.3) % wrap_s
    times = stamped_times(stamp, wrap_s, _arrive(taken), 0)
    assert np.abs(times.time_s - taken).max() < 30e-6
    assert times.step[1:].tolist() == np.diff(k).tolist()


def test_a_stalled_reader_moves_nothing() -> None:
    taken = _samples(np.arange(600))
    t_ns = _arrive(taken)
    t_ns[200:380] = t_ns[380]
    times = stamped_times(taken, 100.0, t_ns, 0)
    assert np.abs(times.time_s - taken).max() < 30e-6


@pytest.mark.parametrize("begin_s", [0.0, 2.5, 90.0])
def test_a_restarted_sensor_is_fitted_anew(begin_s: float) -> None:
    taken = np.concatenate([np.arange(200) * CYCLE_S, 3.7 + np.arange(300) * CYCLE_S])
    stamp = np.concatenate([50 + taken[:200], begin_s + taken[200:] - 3.7])
    times = stamped_times(stamp, 4294.967296, _arrive(taken), 0)
    assert np.abs(times.time_s - taken).max() < 50e-6


def test_repeated_stamps_are_no_samples() -> None:
    arrive = _samples(np.arange(150), CYCLE_S / 2)
    taken = np.repeat(arrive[::2], 2)
    times = stamped_times(taken, 100.0, _arrive(arrive), 0)
    fresh = times.step > 0
    assert fresh.sum() == 75
    assert np.isnan(times.time_s[~fresh]).all()


def test_stamps_that_do_not_run_with_the_bus_are_not_believed() -> None:
    taken = _samples(np.arange(200))
    t_ns = _arrive(taken)
    times = stamped_times(taken * 1e-3, 100.0, t_ns, 0)
    np.testing.assert_allclose(times.time_s, t_ns * 1e-9, atol=1e-9)
    still = stamped_times(np.full(200, 3.0), 100.0, t_ns, 0)
    np.testing.assert_allclose(still.time_s, t_ns * 1e-9, atol=1e-9)


@pytest.mark.parametrize("lead_s", [-0.002, 0.001, 0.004])
def test_binding_against_the_truth_with_losses_everywhere(lead_s: float) -> None:
    rng = np.random.default_rng(5)
    n = 2000
    jitter = rng.exponential(1e-4, n)
    carrier = np.arange(n) * CYCLE_S + jitter
    follower = carrier + lead_s + rng.uniform(0, 1e-4, n)
    here, there = rng.uniform(size=n) > 0.1, rng.uniform(size=n) > 0.1
    here[[0, -1]] = True
    number = np.flatnonzero(here)
    sent = np.flatnonzero(there)
    rows, found = bind(
        number,
        np.rint(carrier[here] * 1e9).astype(np.int64),
        np.arange(len(sent)),
        np.rint(follower[there] * 1e9).astype(np.int64),
    )
    assert np.array_equal(found, sent[rows])  # never to a wrong sample
    assert len(rows) >= len(sent) - 2
    assert np.all(np.diff(found) > 0)
