"""The sensors' clocks against sample times that are known because we draw them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from daq.samples.clock import (
    SensorTimes,
    arrival_times,
    even_times,
    lower_line,
    sensor_times,
    stamped_times,
)
from daq.samples.mapping import bind, bind_counted, group_names
from dbc.codec import Samples

T0_NS = 1_700_000_000_000_000_000
Floats = NDArray[np.float64]


def _stalled(arrival: Floats, starts: Floats, length_s: float) -> Floats:
    """Let the reader stand still, and then take all that has come at one instant."""
    for start in starts:
        waiting = (arrival > start) & (arrival < start + length_s)
        arrival = np.where(waiting, start + length_s, arrival)
    return arrival


def _jitter(rng: np.random.Generator, t: Floats) -> Floats:
    return np.maximum.accumulate(t + 0.3e-3 * rng.random(len(t)))


def _jitter_and_stalls(rng: np.random.Generator, t: Floats) -> Floats:
    return _stalled(_jitter(rng, t), rng.uniform(t[0], t[-1], 4), 0.02)


def _long_stall(rng: np.random.Generator, t: Floats) -> Floats:
    return _stalled(_jitter(rng, t), rng.uniform(t[0], t[-1] - 0.4, 1), 0.3)


def _block_reads(rng: np.random.Generator, t: Floats) -> Floats:
    """Read a serial line every 5 to 6 ms: all frames of a read carry one stamp."""
    reads = t[0] + np.cumsum(5e-3 + 1e-3 * rng.random(2000))
    return np.asarray(reads[np.searchsorted(reads, t)])


def _busy_bus(rng: np.random.Generator, t: Floats) -> Floats:
    return np.maximum.accumulate(t + rng.exponential(0.1e-3, len(t)))


def _hardware(rng: np.random.Generator, t: Floats) -> Floats:
    return t + 3e-6 * rng.standard_normal(len(t))


WAYS = {
    "jitter": (_jitter, 20e-6),
    "jitter and stalls": (_jitter_and_stalls, 20e-6),
    "a stall longer than the counter": (_long_stall, 20e-6),
    "block reads": (_block_reads, 50e-6),
    "busy bus": (_busy_bus, 20e-6),
    "hardware stamps": (_hardware, 15e-6),
}


def _stamps(t: Floats) -> NDArray[np.int64]:
    return T0_NS + np.rint(t * 1e9).astype(np.int64)


@pytest.mark.parametrize("cycle_s", [1e-3, 2e-3])
@pytest.mark.parametrize("error", [80e-6, -0.02])
@pytest.mark.parametrize("way", list(WAYS))
def test_sample_times_are_recovered_from_jittered_arrivals(
    way: str, error: float, cycle_s: float
) -> None:
    travel, limit_s = WAYS[way]
    rng = np.random.default_rng(3)
    k = np.arange(round(4 / cycle_s))
    t = np.asarray(0.2 + (rng.random() + k * (1 + error)) * cycle_s, np.float64)
    arrival = travel(rng, t)
    kept = rng.random(len(k)) > 0.01
    times = sensor_times((k[kept] + 77) % 256, 256, _stamps(arrival[kept]), cycle_s, T0_NS)
    assert np.abs(times.time_s - t[kept]).max() < limit_s
    np.testing.assert_array_equal(times.step[1:], np.diff(k[kept]))
    if way != "hardware stamps":  # the stamps themselves would not do
        assert np.abs(arrival - t).max() > 5 * limit_s


def test_an_outage_of_many_turns_of_the_counter_is_bridged() -> None:
    k = np.concatenate([np.arange(1000), np.arange(1731, 3000)])
    t = k * 1e-3
    times = sensor_times(k % 16, 16, _stamps(t), 1e-3, T0_NS)
    np.testing.assert_allclose(times.time_s, t, atol=1e-6)
    assert times.step.max() == 732


def test_a_restart_of_the_sensor_is_fitted_on_both_sides() -> None:
    rng = np.random.default_rng(5)
    t = np.concatenate([np.arange(900) * 1e-3, 0.93037 + np.arange(900) * 1e-3])
    counter = np.concatenate([np.arange(900), np.arange(900)]) % 256
    times = sensor_times(counter, 256, _stamps(_jitter(rng, t)), 1e-3, T0_NS)
    assert np.abs(times.time_s - t).max() < 20e-6


def test_repeated_frames_have_no_time_and_do_not_shift_the_others() -> None:
    k = np.repeat(np.arange(300), np.where(np.arange(300) % 50 == 7, 2, 1))
    t = k * 2e-3
    times = sensor_times(k % 256, 256, _stamps(t + np.arange(len(k)) * 1e-9), 2e-3, T0_NS)
    repeated = np.concatenate([[False], np.diff(k) == 0])
    np.testing.assert_array_equal(np.isnan(times.time_s), repeated)
    np.testing.assert_allclose(times.time_s[~repeated], t[~repeated], atol=2e-6)


def test_arrival_times_increase_strictly_even_if_the_stamps_do_not() -> None:
    t_ns = T0_NS + np.array([0, 1000, 1000, 1000, 500, 5000])
    times = arrival_times(t_ns, T0_NS).time_s
    assert np.all(np.diff(times) > 0)
    np.testing.assert_allclose(times, [0, 1e-6, 1e-6, 1e-6, 1e-6, 5e-6], atol=4e-9)


@pytest.mark.parametrize("tolerance", [0.05, 1e-4])
def test_the_lower_line_is_the_highest_below_all_points(tolerance: float) -> None:
    rng = np.random.default_rng(7)
    k = np.arange(-99.5, 100.0)
    y = 2.003 * k + rng.exponential(0.3, 200)
    start, slope = lower_line(k, y, 2.0, tolerance)
    # An optimum touches two points, or is the highest line of an extreme slope.
    limits = 2.0 * (1 - tolerance), 2.0 * (1 + tolerance)
    one, other = np.triu_indices(200, 1)
    slopes = np.clip([(y[other] - y[one]) / (k[other] - k[one])], *limits).ravel()
    starts = np.array([np.min(y - each * k) for each in slopes])
    best = int(np.argmax(starts))
    np.testing.assert_allclose([start, slope], [starts[best], slopes[best]], rtol=1e-9)


# Messages without a counter: their clock is found where they come evenly --------------------------

CYCLE_S = 0.005


def arrivals(
    jitter_s: float, drift: float, lost: float = 0.01, seed: int = 4, most_cycles: float = 0.5
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return when samples were taken and when their frames arrived, ns."""
    rng = np.random.default_rng(seed)
    tick_s = 0.0013 + CYCLE_S * (1 + drift) * np.arange(700)
    late_s = np.minimum(rng.exponential(jitter_s, 700), most_cycles * CYCLE_S)
    kept = rng.random(700) >= lost
    t_ns = np.rint((tick_s + late_s)[kept] * 1e9).astype(np.int64)
    return np.asarray(tick_s[kept], np.float64), np.asarray(t_ns, np.int64)


@pytest.mark.parametrize(("jitter_s", "drift"), [(50e-6, 2e-4), (300e-6, 0.03), (500e-6, 2e-4)])
def test_late_frames_of_an_even_sensor_are_put_on_its_clock(jitter_s: float, drift: float) -> None:
    taken_s, t_ns = arrivals(jitter_s, drift)
    found = even_times(t_ns, 0)
    # Arrival alone is wrong by the jitter on average.
    assert np.max(np.abs(found.time_s - taken_s)) < jitter_s / 15
    tick = (taken_s - 0.0013) / (CYCLE_S * (1 + drift))
    assert_array_equal(np.cumsum(found.step)[1:] - 1, np.rint(tick)[1:])


@pytest.mark.parametrize(("seed", "lost"), [(0, 0.02), (4, 0.02), (4, 0.0)])
def test_each_guess_of_the_cycle_finds_a_clock_that_the_other_two_miss(
    seed: int, lost: float
) -> None:
    """At a jitter of 0.2 cycles: the median gap, the mean gap, and the length of the whole run."""
    taken_s, t_ns = arrivals(0.2 * CYCLE_S, 0.0, lost, seed, 0.9)
    assert np.abs(even_times(t_ns, 0).time_s - taken_s).max() < 0.05 * CYCLE_S


def test_frames_that_come_when_they_like_keep_their_arrival() -> None:
    t_ns = np.sort(np.random.default_rng(1).integers(0, 3_500_000_000, 700))
    assert_array_equal(even_times(t_ns, 0).time_s, t_ns * 1e-9)


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


def errors(late_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far the times that are found lie from the ticks, in cycles."""
    tick_s = 0.0013 + CYCLE_S * np.arange(len(late_s))
    t_ns = np.rint(np.maximum.accumulate(tick_s + late_s) * 1e9).astype(np.int64)
    return np.asarray((even_times(t_ns, 0).time_s - tick_s) / CYCLE_S)


def with_late(late_s: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Return the lateness with 48 frames later by a share of a cycle."""
    return late_s + share * CYCLE_S * ((np.arange(240) >= 96) & (np.arange(240) < 144))


@pytest.mark.parametrize(
    ("late_s", "is_found"),
    [
        # Some of forty frames must be punctual.
        (with_late(stalled(9), 0.08), True),
        (with_late(stalled(9), 0.12), False),
        # Frames that are read in blocks: two of nine come with the one before them, 22 %; of
        # seven, 29 %.
        (stalled(9), True),
        (stalled(7), False),
        # A clock that is not followed is none.
        (with_late(np.zeros(240), 0.2), True),
        (with_late(np.zeros(240), 0.3), False),
    ],
)
def test_frames_are_on_a_clock_or_keep_their_arrival(
    late_s: NDArray[np.float64], is_found: bool
) -> None:
    assert (np.std(errors(late_s)) < 0.01) == is_found


@pytest.mark.parametrize("place", [0, 239])
def test_a_late_first_or_last_frame_does_not_tilt_the_clock(place: int) -> None:
    late_s = stalled(9)
    late_s[4::9], late_s[5::9], late_s[6::9] = 0.6 * CYCLE_S, 0.5 * CYCLE_S, 0.7 * CYCLE_S
    late_s[place] = 0.6 * CYCLE_S  # by 0.6 of 240 cycles the mean distance of the frames is wrong
    assert np.max(np.abs(errors(late_s))) < 0.01


def test_the_ticks_of_jitter_beyond_a_cycle_are_found_or_the_arrival_is_kept() -> None:
    rng = np.random.default_rng(3)
    found = []
    for _ in range(20):
        late_s = np.minimum(rng.exponential(0.3 * CYCLE_S, 700), 1.5 * CYCLE_S)
        error = errors(late_s)
        if np.std(error) < 0.2:
            found.append(np.max(np.abs(error)))
    assert len(found) > 16
    assert max(found) < 0.1


@pytest.mark.parametrize("missing", [None, 350])
def test_a_faster_clock_of_which_each_tenth_frame_is_missing_is_none(missing: int | None) -> None:
    """Frames of other sensors in the way make most gaps shorter than the cycle, and some longer."""
    beat = np.resize([0.08, 0.045, 0.1, 0.02, 0.14], 700)
    kept = np.arange(700) != missing
    for seed in range(20):
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


# Sensor time stamps fitted to the time of the bus -------------------------------------------------

Array = NDArray[np.float64]
SET_CYCLE_S = 0.01


def late(taken_s: Array) -> Array:
    """Return arrivals that are up to 0.3 ms late."""
    return np.maximum.accumulate(
        taken_s + 3e-4 * np.random.default_rng(2).random(len(taken_s)), axis=0
    )


def stamps(arrival_s: Array) -> NDArray[np.int64]:
    return np.rint(arrival_s * 1e9).astype(np.int64)


@pytest.mark.parametrize("drift", [-200e-6, 0.0, 300e-6, 0.01])
@pytest.mark.parametrize("wrap_s", [0.65536, 4294.967296])
def test_times_are_those_of_the_samples(drift: float, wrap_s: float) -> None:
    k = np.delete(np.arange(600.0), [100, 101, 300])
    taken: Array = k * SET_CYCLE_S * (1 + drift)
    stamp: Array = (k * SET_CYCLE_S + wrap_s - 0.3) % wrap_s
    times = stamped_times(stamp, wrap_s, stamps(late(taken)), 0)
    assert np.abs(times.time_s - taken).max() < 30e-6
    assert times.step[1:].tolist() == np.diff(k).tolist()


@pytest.mark.parametrize("lead_s", [-0.002, 0.001, 0.004])
def test_binding_against_the_truth_with_losses_everywhere(lead_s: float) -> None:
    rng = np.random.default_rng(5)
    n = 2000
    jitter = rng.exponential(1e-4, n)
    carrier = np.arange(n) * SET_CYCLE_S + jitter
    follower = carrier + lead_s + rng.uniform(0, 1e-4, n)
    here, there = rng.uniform(size=n) > 0.1, rng.uniform(size=n) > 0.1
    here[[0, -1]] = True
    number = np.flatnonzero(here)
    sent = np.flatnonzero(there)
    rows, found = bind(
        number,
        np.rint(carrier[here] * 1e9).astype(np.int64),
        np.rint(follower[there] * 1e9).astype(np.int64),
    )
    assert np.array_equal(found, sent[rows])  # never to a wrong sample
    assert len(rows) >= len(sent) - 2
    assert np.all(np.diff(found) > 0)


# When the time stamps of a sensor are believed, and when it began anew: each limit twice ----------


def is_arrival(times: SensorTimes, arrival_s: Array) -> bool:
    return bool(np.abs(times.time_s - arrival_s).max() < 1e-8)


@pytest.mark.parametrize("rate", [0.5, 0.94, 0.96, 1.04, 1.06, 2.0])
def test_a_clock_that_runs_by_more_than_a_twentieth_off_is_none(rate: float) -> None:
    fitted = abs(rate - 1.0) < 0.05
    taken = np.arange(400.0) * SET_CYCLE_S
    arrival = late(taken)
    for times in (
        stamped_times(taken / rate % 6.5536, 6.5536, stamps(arrival), 0),
        sensor_times(np.arange(400) % 256, 256, stamps(arrival), SET_CYCLE_S / rate, 0),
    ):
        assert is_arrival(times, arrival) is not fitted
        assert not fitted or np.abs(times.time_s - taken).max() < 30e-6


@pytest.mark.parametrize(("n", "fitted"), [(19, False), (20, True)])
def test_twenty_frames_show_a_clock(n: int, fitted: bool) -> None:
    taken = np.arange(float(n)) * SET_CYCLE_S
    arrival = late(taken)
    by_stamp = stamped_times(taken, 100.0, stamps(arrival), 0)
    by_count = sensor_times(np.arange(n), 256, stamps(arrival), SET_CYCLE_S, 0)
    assert is_arrival(by_stamp, arrival) is not fitted
    assert is_arrival(by_count, arrival) is not fitted
    assert is_arrival(even_times(stamps(arrival), 0), arrival) is not fitted


@pytest.mark.parametrize(("n", "believed"), [(300, False), (301, True)])
def test_one_gap_in_three_must_have_a_new_stamp(n: int, believed: bool) -> None:
    """Each stamp comes three times: 99 of 299 gaps are less than a third, 100 of 300 are not."""
    arrival = late(np.arange(float(n)) * SET_CYCLE_S)
    taken = np.repeat(np.arange(0.0, n, 3.0), 3)[:n] * SET_CYCLE_S
    times = stamped_times(taken, 100.0, stamps(arrival), 0)
    assert bool(np.isnan(times.time_s).any()) is believed


@pytest.mark.parametrize(("share", "believed"), [(0.49, True), (0.51, False)])
def test_a_counter_that_mostly_stands_still_tells_nothing(share: float, believed: bool) -> None:
    n = 400
    step = np.ones(n, np.int64)
    step[np.linspace(1, n - 1, round(share * n)).astype(int)] = 0
    counter = (np.cumsum(step) - 1) % 256
    arrival = late(np.arange(float(n)) * SET_CYCLE_S)
    times = sensor_times(counter, 256, stamps(arrival), SET_CYCLE_S, 0)
    assert bool(np.isnan(times.time_s).any()) is believed


@pytest.mark.parametrize(
    ("pause_s", "jump_s", "restarted"),
    [
        # 50 ms and a twentieth of the time between the frames: 50.5 ms, and 150 ms over a pause.
        # Stamps that fall back are a whole turn ahead.
        (0.01, 0.0495, False), (0.01, 0.0515, True), (0.01, -0.0495, True),
        (2.0, 0.148, False), (2.0, 0.152, True),
    ],
)  # fmt: skip
def test_a_jump_of_the_stamps_is_a_restart(pause_s: float, jump_s: float, restarted: bool) -> None:
    taken = np.concatenate(
        [np.arange(400) * SET_CYCLE_S, 3.99 + pause_s + np.arange(400) * SET_CYCLE_S]
    )
    stamp = taken + 20.0 + np.where(np.arange(800) < 400, 0.0, jump_s)
    times = stamped_times(stamp, 1000.0, stamps(late(taken)), 0)
    assert bool(np.abs(times.time_s - taken).max() < 1e-3) is restarted


@pytest.mark.parametrize("turns", [1, 2, 7])
def test_whole_turns_of_the_stamp_are_counted_by_the_time_of_the_bus(turns: int) -> None:
    taken = np.arange(200.0) * SET_CYCLE_S
    taken[100:] += 0.5 * turns
    times = stamped_times(taken % 0.5, 0.5, stamps(late(taken)), 0)
    assert np.abs(times.time_s - taken).max() < 1e-4
    assert times.step[100] == 1 + 50 * turns


def test_a_backlog_that_a_reader_works_off_within_five_seconds_is_no_restart() -> None:
    """A quarter of a second late at once, then a little less with each frame, for four seconds."""
    taken = np.arange(1200.0) * SET_CYCLE_S
    delay_s = np.where(taken < 4.0, 0.0, np.maximum(0.25 - (taken - 4.0) / 16.0, 0.0))
    times = stamped_times(taken, 100.0, stamps(late(taken) + delay_s), 0)
    assert np.abs(times.time_s - taken).max() < 1e-4


def test_a_restart_is_found_though_another_one_follows_after_seven_seconds() -> None:
    """The sensor stops for 80 ms and then leaps by 100 ms: over all 20 s it has not stopped."""
    taken = np.arange(2000.0) * SET_CYCLE_S
    stamp = taken + 50.0 + np.where(taken < 13.0, 0.0, 0.1)
    taken += np.where(taken < 6.0, 0.0, 0.08)
    times = stamped_times(stamp, 1000.0, stamps(late(taken)), 0)
    assert np.abs(times.time_s - taken).max() < 1e-4


def test_times_increase_across_a_restart_whose_first_frames_were_held_up() -> None:
    """The second clock begins before the last frame of the first, which nothing forbids."""
    first, second = np.arange(100) * SET_CYCLE_S, 0.97 + np.arange(100) * SET_CYCLE_S
    arrival = np.concatenate([first, np.maximum(second, 1.0)])
    count = np.concatenate([np.arange(100), np.arange(100)])
    times = sensor_times(count, 256, stamps(arrival), SET_CYCLE_S, 0)
    assert np.all(np.diff(times.time_s) > 0.0)
    assert np.abs(times.time_s[110:] - second[10:]).max() < 1e-4


# Which frames belong to one sample, on arrivals that are written down here ------------------------

MS = 1_000_000


def bound(
    numbers: Sequence[int], carriers_ms: Sequence[float], frames_ms: Sequence[float]
) -> dict[int, int]:
    """Return the sample number of each frame that belongs to one."""
    rows, found = bind(
        np.array(numbers),
        np.rint(np.array(carriers_ms) * MS).astype(np.int64),
        np.rint(np.array(frames_ms) * MS).astype(np.int64),
    )
    assert np.all(np.diff(found) > 0)
    return dict(zip(rows.tolist(), found.tolist(), strict=True))


@pytest.mark.parametrize(
    ("numbers", "carriers_ms", "frames_ms", "expected"),
    [
        ((5, 6, 7), (0, 10, 20), (1, 11, 21), {0: 5, 1: 6, 2: 7}),
        ((5, 6, 7), (0, 10, 20), (4.9, 14.9, 24.9), {0: 5, 1: 6, 2: 7}),
        ((5, 6, 7), (0, 10, 20), (-4.9, 5.1, 15.1), {0: 5, 1: 6, 2: 7}),  # ahead of the carrier
        ((5, 6, 7), (0, 10, 20), (-9, 1, 11), {1: 5, 2: 6}),  # before the first
        ((5, 6, 7), (0, 10, 20), (0, 10, 20), {0: 5, 1: 6, 2: 7}),  # at one instant
        ((5, 6), (0, 10), (1, 2, 11), {0: 5, 2: 6}),  # one came twice
        ((5, 8, 9), (0, 30, 40), (1, 11, 21, 31), {0: 5, 1: 6, 2: 7, 3: 8}),  # by their count
        ((5, 8, 9), (0, 30, 40), (1, 21, 31), {0: 5, 1: 7, 2: 8}),  # by their time
        ((5, 8, 9), (0, 30, 40), (1, 17.4, 31), {0: 5, 1: 6, 2: 8}),
        ((5, 8, 9), (0, 30, 40), (1, 17.6, 31), {0: 5, 1: 7, 2: 8}),
        ((5, 8, 9), (0, 30, 40), (1, 29.9, 31), {0: 5, 1: 7, 2: 8}),  # never beyond the next one
        ((5, 8, 9), (0, 30, 40), (-1, 29, 39), {0: 5, 1: 8, 2: 9}),
        ((5,), (0,), (1,), {0: 5}),
        ((5,), (0,), (-1,), {}),
        ((5, 6), (0, 10), (), {}),
    ],
)
def test_frames_belong_to_the_carrier_they_are_sent_with(
    numbers: Sequence[int],
    carriers_ms: Sequence[float],
    frames_ms: Sequence[float],
    expected: dict[int, int],
) -> None:
    assert bound(numbers, carriers_ms, frames_ms) == expected


def counted(
    numbers: Sequence[int],
    carriers_ms: Sequence[float],
    frames: Sequence[tuple[float, int]],
    modulus: int,
) -> dict[int, int]:
    """Return the sample number of each frame, which is at a time and has a counter."""
    t_ns = np.array([round(t * MS) for t, _ in frames], np.int64)
    values = np.array([value for _, value in frames], np.float64)
    own = Samples("M.counter", t_ns, values, np.zeros(len(frames), np.uint8))
    rows, found = bind_counted(
        np.array(numbers),
        np.array(numbers, np.float64) % modulus,
        np.rint(np.array(carriers_ms) * MS).astype(np.int64),
        own,
        modulus,
    )
    return dict(zip(rows.tolist(), found.tolist(), strict=True))


@pytest.mark.parametrize(
    ("numbers", "carriers_ms", "frames", "modulus", "expected"),
    [
        ((100, 101, 102), (0, 10, 20), ((2, 4), (12, 5), (22, 6)), 16, {0: 100, 1: 101, 2: 102}),
        ((100, 101, 102), (0, 10, 20), ((2, 4), (18, 5), (19, 6)), 16, {0: 100, 1: 101, 2: 102}),
        ((15, 16, 17), (0, 10, 20), ((9, 15), (11, 1)), 16, {0: 15, 1: 17}),  # over the wrap
        ((100, 101), (0, 10), ((0, 3), (1, 4), (10, 6)), 16, {1: 100}),  # of no carrier that came
        ((100, 101), (0, 10), ((1, 4), (2, 4)), 16, {0: 100}),  # one came twice
        ((7,), (0,), ((-90, 7), (90, 8)), 16, {0: 7}),
        # A counter of two values: the nearest carrier decides.
        ((0, 1, 2, 3), (0, 10, 20, 30), ((9, 1), (14.9, 1), (15.1, 0)), 2, {0: 1, 2: 2}),
        ((0, 1, 2, 3), (0, 10, 20, 30), ((5, 1), (25, 1)), 2, {0: 1, 1: 3}),
        ((0, 1, 2, 3), (0, 10, 20, 30), ((-9, 0), (39, 1)), 2, {0: 0, 1: 3}),
    ],
)
def test_frames_with_a_counter_belong_to_the_sample_of_that_number(
    numbers: Sequence[int],
    carriers_ms: Sequence[float],
    frames: Sequence[tuple[float, int]],
    modulus: int,
    expected: dict[int, int],
) -> None:
    assert counted(numbers, carriers_ms, frames, modulus) == expected


def test_groups_have_names_that_a_session_file_can_hold() -> None:
    assert group_names(["IMU", "HUB.a", "IMU"]) == {"IMU": "IMU", "HUB.a": "HUB_a"}
    long = "m" * 80
    found = group_names(["m" * 64, long, long + "x", "a.b", "a_b", "a/b", "ä" * 40])
    assert found["m" * 64] == "m" * 64
    assert all(len(name.encode()) <= 64 and "/" not in name for name in found.values())
    assert len(set(found.values())) == 7
    assert found["a.b"] == "a_b"
