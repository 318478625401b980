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


@pytest.mark.parametrize(("missing", "is_found"), [(None, True), (350, False)])
def test_frames_a_cycle_late_are_put_on_the_clock_where_none_is_missing(
    missing: int | None, is_found: bool
) -> None:
    rng = np.random.default_rng(5)
    taken_s = 0.0013 + CYCLE_S * (1 + 2e-4) * np.arange(700)
    late_s = rng.exponential(200e-6, 700)
    late_s[rng.random(700) < 0.04] += 4 * CYCLE_S  # a stall, and then all at once
    arrival_s = np.maximum.accumulate(taken_s + late_s)
    kept = np.arange(700) != missing
    taken_s, t_ns = taken_s[kept], np.rint(arrival_s[kept] * 1e9).astype(np.int64)
    found = even_times(t_ns, 0).time_s
    assert (np.max(np.abs(found - taken_s)) < 50e-6) == is_found
    assert np.allclose(found, t_ns * 1e-9, rtol=0.0, atol=1e-6) == (not is_found)


def stalled(every: int) -> NDArray[np.float64]:
    """Return the lateness of frames where each `every`-th waits for the one two cycles later."""
    late_s = np.zeros(240)
    late_s[1::every], late_s[2::every] = 2 * CYCLE_S, CYCLE_S
    return late_s


def is_on_a_clock(late_s: NDArray[np.float64]) -> bool:
    arrival_s = 0.0013 + CYCLE_S * np.arange(240) + late_s
    t_ns = np.rint(np.maximum.accumulate(arrival_s) * 1e9).astype(np.int64)
    return bool(np.all(np.diff(even_times(t_ns, 0).time_s) > 0.9 * CYCLE_S))


@pytest.mark.parametrize(("late_share", "is_found"), [(0.08, True), (0.12, False)])
def test_some_of_forty_frames_must_be_punctual(late_share: float, is_found: bool) -> None:
    late_s = stalled(9)
    late_s[96:144] += late_share * CYCLE_S
    assert is_on_a_clock(late_s) == is_found


@pytest.mark.parametrize(("every", "is_found"), [(9, True), (7, False)])
def test_frames_that_are_read_in_blocks_keep_their_arrival(every: int, is_found: bool) -> None:
    # Two of nine come with the one before them, 22 %; of seven, 29 %.
    assert is_on_a_clock(stalled(every)) == is_found


def errors(late_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the times that are found lie from the ticks, in cycles."""
    tick_s = 0.0013 + CYCLE_S * np.arange(len(late_s))
    t_ns = np.rint(np.maximum.accumulate(tick_s + late_s) * 1e9).astype(np.int64)
    return np.asarray((even_times(t_ns, 0).time_s - tick_s) / CYCLE_S)


@pytest.mark.parametrize("place", [0, 239])
def test_a_late_first_or_last_frame_does_not_tilt_the_clock(place: int) -> None:
    late_s = stalled(9)
    late_s[4::9], late_s[5::9], late_s[6::9] = 0.6 * CYCLE_S, 0.5 * CYCLE_S, 0.7 * CYCLE_S
    late_s[place] = 0.6 * CYCLE_S  # by 0.6 of 240 cycles the mean distance of the frames is wrong
    assert np.max(np.abs(errors(late_s))) < 0.01


def test_the_ticks_of_jitter_beyond_a_cycle_are_found_or_the_arrival_is_kept() -> None:
    rng = np.random.default_rng(3)
    found = []
    for _ in range(60):
        late_s = np.minimum(rng.exponential(0.3 * CYCLE_S, 700), 1.5 * CYCLE_S)
        error = errors(late_s)
        if np.std(error) < 0.2:
            found.append(np.max(np.abs(error)))
    assert len(found) > 50
    assert max(found) < 0.1


@pytest.mark.parametrize(("n_late", "end"), [(1, 0.0), (2, 0.0), (3, 1.0)])
def test_the_last_two_frames_are_late_rather_than_behind_a_gap(n_late: int, end: float) -> None:
    late_s = np.zeros(240)
    late_s[-n_late:] = 1.1 * CYCLE_S
    assert errors(late_s)[-1] == pytest.approx(end, abs=0.2)


def test_the_last_frame_is_behind_a_gap_where_others_are_missing() -> None:
    late_s = np.zeros(240)
    late_s[100:] = 1.0 * CYCLE_S  # as if one were missing
    late_s[-1] = 2.1 * CYCLE_S
    assert errors(late_s)[-1] == pytest.approx(2.0, abs=0.2)


@pytest.mark.parametrize(("late_share", "is_found"), [(0.2, True), (0.3, False)])
def test_a_clock_that_is_not_followed_is_none(late_share: float, is_found: bool) -> None:
    late_s = np.zeros(240)
    late_s[96:144] += late_share * CYCLE_S
    assert (np.std(errors(late_s)) < 0.01) == is_found


@pytest.mark.parametrize("missing", [None, 350])
def test_a_faster_clock_of_which_each_tenth_frame_is_missing_is_none(missing: int | None) -> None:
    """Frames of other sensors in the way make most gaps shorter than the cycle, and some longer."""
    beat = np.resize([0.08, 0.045, 0.1, 0.02, 0.14], 700)
    kept = np.arange(700) != missing
    for seed in range(60):
        rng = np.random.default_rng(seed)
        tick_s = 0.0013 + CYCLE_S * np.arange(700)
        arrival_s = tick_s + CYCLE_S * (beat + rng.exponential(0.012, 700))
        found = even_times(np.rint(arrival_s[kept] * 1e9).astype(np.int64), 0)
        assert np.max(np.abs(found.time_s - tick_s[kept])) < 0.2 * CYCLE_S, seed
        assert np.flatnonzero(found.step > 1).tolist() == ([] if missing is None else [missing])


@pytest.mark.parametrize(("every", "is_found"), [(12, True), (10, False)])
def test_up_to_a_tenth_of_the_frames_may_follow_a_gap(every: int, is_found: bool) -> None:
    """With each twelfth frame missing one in 11 follows a gap, with each tenth one in 9."""
    number = np.delete(np.arange(720), np.arange(every - 1, 719, every))
    t_ns = np.rint((number * 0.01 + 3e-4 * np.random.default_rng(4).random(len(number))) * 1e9)
    found = even_times(t_ns.astype(np.int64), 0)
    assert (np.abs(found.time_s - number * 0.01).max() < 1e-4) == is_found
    assert (found.step.max() == 2) == is_found
