"""Messages without a counter: their clock is found where they come evenly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from daq.samples.clock import even_times

CYCLE_S = 0.005


def arrivals(
    jitter_s: float, drift: float = 2e-4, lost: float = 0.01
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return when samples were taken and when their frames arrived, ns."""
    rng = np.random.default_rng(4)
    tick_s = 0.0013 + CYCLE_S * (1 + drift) * np.arange(700)
    late_s = np.minimum(rng.exponential(jitter_s, 700), CYCLE_S / 2)
    kept = rng.random(700) >= lost
    t_ns = np.rint((tick_s + late_s)[kept] * 1e9).astype(np.int64)
    return np.asarray(tick_s[kept], np.float64), np.asarray(t_ns, np.int64)


@pytest.mark.parametrize("jitter_s", [50e-6, 300e-6, 500e-6])
def test_late_frames_of_an_even_sensor_are_put_on_its_clock(jitter_s: float) -> None:
    taken_s, t_ns = arrivals(jitter_s)
    found = even_times(t_ns, 0)
    # Arrival alone is wrong by the jitter on average.
    assert np.max(np.abs(found.time_s - taken_s)) < jitter_s / 20
    assert_array_equal(np.cumsum(found.step)[1:] - 1, np.rint(taken_s / CYCLE_S)[1:])


def test_a_cycle_far_from_nominal_is_found() -> None:
    taken_s, t_ns = arrivals(300e-6, drift=0.03)
    assert np.max(np.abs(even_times(t_ns, 0).time_s - taken_s)) < 20e-6


def test_frames_that_come_when_they_like_keep_their_arrival() -> None:
    t_ns = np.sort(np.random.default_rng(1).integers(0, 3_500_000_000, 700))
    assert_array_equal(even_times(t_ns, 0).time_s, t_ns * 1e-9)


def test_twenty_frames_are_too_few_for_a_clock_with_nineteen() -> None:
    _, t_ns = arrivals(300e-6, lost=0.0)
    assert_array_equal(even_times(t_ns[:19], 0).time_s, t_ns[:19] * 1e-9)
    assert not np.array_equal(even_times(t_ns[:40], 0).time_s, t_ns[:40] * 1e-9)


def test_frames_that_all_come_at_once_keep_their_arrival() -> None:
    found = even_times(np.full(30, 5_000_000_000), 0)
    assert found.time_s == pytest.approx(np.full(30, 5.0), abs=1e-6)
    assert np.all(np.diff(found.time_s) > 0)
