"""The sensors' clocks against sample times that are known because we draw them."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from daq.samples.clock import arrival_times, lower_line, sensor_times

T0_NS = 1_700_000_000_000_000_000
Floats = NDArray[np.float64]
Way = Callable[[np.random.Generator, Floats], Floats]
"""Sample times to arrival times."""


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
    "hardware stamps": (_hardware, 2e-6),
}


def _stamps(t: Floats) -> NDArray[np.int64]:
    return T0_NS + np.rint(t * 1e9).astype(np.int64)


@pytest.mark.parametrize("cycle_s", [1e-3, 2e-3])
@pytest.mark.parametrize("error", [0.0, 80e-6, 0.01, -0.02])
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
    if limit_s > 10e-6:  # the stamps themselves would not do
        assert np.abs(arrival - t).max() > 5 * limit_s


def test_two_messages_of_one_run_agree() -> None:
    rng = np.random.default_rng(4)
    late = []
    for cycle_s in (1e-3, 2e-3):
        k = np.arange(round(4 / cycle_s))
        t = np.asarray(k * cycle_s, np.float64)
        stamps = _stamps(_jitter_and_stalls(rng, t))
        late.append(np.mean(sensor_times(k % 256, 256, stamps, cycle_s, T0_NS).time_s - t))
    assert abs(late[0] - late[1]) < 5e-6


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


@pytest.mark.parametrize(
    ("counter", "n"), [(np.zeros(500, np.int64), 500), (np.arange(12), 12)], ids=["stuck", "few"]
)
def test_a_counter_that_shows_nothing_leaves_the_arrival_times(
    counter: NDArray[np.int64], n: int
) -> None:
    t_ns = T0_NS + np.sort(np.random.default_rng(6).integers(0, 10**9, n))
    times = sensor_times(counter, 256, t_ns, 1e-3, T0_NS)
    np.testing.assert_array_equal(times.time_s, arrival_times(t_ns, T0_NS).time_s)


def test_arrival_times_increase_strictly_even_if_the_stamps_do_not() -> None:
    t_ns = T0_NS + np.array([0, 1000, 1000, 1000, 500, 5000])
    times = arrival_times(t_ns, T0_NS).time_s
    assert np.all(np.diff(times) > 0)
    np.testing.assert_allclose(times, [0, 1e-6, 1e-6, 1e-6, 1e-6, 5e-6], atol=4e-9)


@pytest.mark.parametrize("tolerance", [0.05, 1e-4])
def test_the_lower_line_is_the_optimum_of_the_linear_programme(tolerance: float) -> None:
    rng = np.random.default_rng(7)
    k = np.arange(-99.5, 100.0)
    y = 2.003 * k + rng.exponential(0.3, 200)
    start, slope = lower_line(k, y, 2.0, tolerance)
    best = linprog(
        [-1.0, 0.0],  # the highest line at the mean of k ...
        A_ub=np.column_stack([np.ones(200), k]),  # ... that lies below all points
        b_ub=y,
        bounds=[(None, None), (2.0 * (1 - tolerance), 2.0 * (1 + tolerance))],
    )
    np.testing.assert_allclose([start, slope], best.x, rtol=1e-9)


@pytest.mark.parametrize(("scatter_s", "late_s"), [(14e-6, 7e-6), (16e-6, 0.0)])
def test_a_scatter_below_15_us_is_noise_of_the_clock_and_above_it_delay(
    scatter_s: float, late_s: float
) -> None:
    """Every second stamp is later by so much: the mean line, or the line below all stamps."""
    k = np.arange(2000)
    t = np.asarray(k * 2e-3, np.float64)
    stamps = _stamps(t + scatter_s * (k % 2))
    found = sensor_times(k % 256, 256, stamps, 2e-3, T0_NS).time_s - t
    assert found == pytest.approx(np.full(len(k), late_s), abs=1e-7)
