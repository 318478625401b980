"""When the time stamps of a sensor are believed, and when it began anew: each limit twice."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.samples.clock import SensorTimes, even_times, sensor_times, stamped_times
from daq.samples.mapping import bind, bind_counted, group_names
from dbc.codec import Samples

Array = NDArray[np.float64]
CYCLE_S = 0.01


def late(taken_s: Array) -> Array:
    """Return arrivals that are up to 0.3 ms late."""
    return np.maximum.accumulate(
        taken_s + 3e-4 * np.random.default_rng(2).random(len(taken_s)), axis=0
    )


def stamps(arrival_s: Array) -> NDArray[np.int64]:
    return np.rint(arrival_s * 1e9).astype(np.int64)


def is_arrival(times: SensorTimes, arrival_s: Array) -> bool:
    return bool(np.abs(times.time_s - arrival_s).max() < 1e-8)


@pytest.mark.parametrize(
    ("rate", "believed"), [(0.79, False), (0.81, True), (1.24, True), (1.26, False)]
)
def test_stamps_are_believed_that_run_by_a_fifth_or_a_quarter_off(
    rate: float, believed: bool
) -> None:
    taken = np.arange(400.0) * CYCLE_S
    arrival = late(taken)
    times = stamped_times(taken / rate, 100.0, stamps(arrival), 0)
    assert is_arrival(times, arrival) is not believed


@pytest.mark.parametrize(("n", "fitted"), [(19, False), (20, True)])
def test_twenty_frames_show_a_clock(n: int, fitted: bool) -> None:
    taken = np.arange(float(n)) * CYCLE_S
    arrival = late(taken)
    by_stamp = stamped_times(taken, 100.0, stamps(arrival), 0)
    by_count = sensor_times(np.arange(n), 256, stamps(arrival), CYCLE_S, 0)
    assert is_arrival(by_stamp, arrival) is not fitted
    assert is_arrival(by_count, arrival) is not fitted
    assert is_arrival(even_times(stamps(arrival), 0), arrival) is not fitted


@pytest.mark.parametrize(("n", "believed"), [(300, False), (301, True)])
def test_one_gap_in_three_must_have_a_new_stamp(n: int, believed: bool) -> None:
    """Each stamp comes three times: 99 of 299 gaps are less than a third, 100 of 300 are not."""
    arrival = late(np.arange(float(n)) * CYCLE_S)
    taken = np.repeat(np.arange(0.0, n, 3.0), 3)[:n] * CYCLE_S
    times = stamped_times(taken, 100.0, stamps(arrival), 0)
    assert bool(np.isnan(times.time_s).any()) is believed


@pytest.mark.parametrize(("share", "believed"), [(0.49, True), (0.51, False)])
def test_a_counter_that_stands_still_in_most_frames_tells_nothing(
    share: float, believed: bool
) -> None:
    n = 400
    step = np.ones(n, np.int64)
    step[np.linspace(1, n - 1, round(share * n)).astype(int)] = 0
    counter = (np.cumsum(step) - 1) % 256
    arrival = late(np.arange(float(n)) * CYCLE_S)
    times = sensor_times(counter, 256, stamps(arrival), CYCLE_S, 0)
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
    taken = np.concatenate([np.arange(400) * CYCLE_S, 3.99 + pause_s + np.arange(400) * CYCLE_S])
    stamp = taken + 20.0 + np.where(np.arange(800) < 400, 0.0, jump_s)
    times = stamped_times(stamp, 1000.0, stamps(late(taken)), 0)
    assert bool(np.abs(times.time_s - taken).max() < 1e-3) is restarted


@pytest.mark.parametrize("turns", [1, 2, 7])
def test_whole_turns_of_the_stamp_are_counted_by_the_time_of_the_bus(turns: int) -> None:
    taken = np.arange(200.0) * CYCLE_S
    taken[100:] += 0.5 * turns
    times = stamped_times(taken % 0.5, 0.5, stamps(late(taken)), 0)
    assert np.abs(times.time_s - taken).max() < 1e-4
    assert times.step[100] == 1 + 50 * turns


def test_a_backlog_that_a_reader_works_off_within_five_seconds_is_no_restart() -> None:
    """A quarter of a second late at once, then a little less with each frame, for four seconds."""
    taken = np.arange(1200.0) * CYCLE_S
    delay_s = np.where(taken < 4.0, 0.0, np.maximum(0.25 - (taken - 4.0) / 16.0, 0.0))
    times = stamped_times(taken, 100.0, stamps(late(taken) + delay_s), 0)
    assert np.abs(times.time_s - taken).max() < 1e-4


def test_a_restart_is_found_though_another_one_follows_after_seven_seconds() -> None:
    """The sensor stops for 80 ms and then leaps by 100 ms: over all 20 s it has not stopped."""
    taken = np.arange(2000.0) * CYCLE_S
    stamp = taken + 50.0 + np.where(taken < 13.0, 0.0, 0.1)
    taken += np.where(taken < 6.0, 0.0, 0.08)
    times = stamped_times(stamp, 1000.0, stamps(late(taken)), 0)
    assert np.abs(times.time_s - taken).max() < 1e-4


def test_times_increase_across_a_restart_whose_first_frames_were_held_up() -> None:
    """The second clock begins before the last frame of the first, which nothing forbids."""
    first, second = np.arange(100) * CYCLE_S, 0.97 + np.arange(100) * CYCLE_S
    arrival = np.concatenate([first, np.maximum(second, 1.0)])
    count = np.concatenate([np.arange(100), np.arange(100)])
    times = sensor_times(count, 256, stamps(arrival), CYCLE_S, 0)
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
        np.arange(len(frames_ms)),
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
        np.arange(len(frames)),
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
    found = group_names(["m" * 64, long, long + "x", "a.b", "a_b"])
    assert found["m" * 64] == "m" * 64
    assert all(len(name) <= 64 for name in found.values())
    assert len(set(found.values())) == 5
    assert found["a.b"] == "a_b"
