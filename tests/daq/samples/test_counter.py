import numpy as np
import pytest
from numpy.typing import NDArray

from daq.samples.clock import counter_steps


def _ns(t_ms: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.rint(t_ms * 1e6).astype(np.int64)


@pytest.mark.parametrize("modulus", [16, 256])
def test_lost_frames_are_counted_over_whole_turns(modulus: int) -> None:
    rng = np.random.default_rng(1)
    k = np.flatnonzero(rng.random(20_000) > 0.3)
    k = k[(k < 5000) | (k > 9000)]
    steps = counter_steps(k % modulus, modulus, _ns(k + 0.3 * rng.random(len(k))), 1e-3)
    np.testing.assert_array_equal(steps.step, np.diff(k))
    assert steps.missing == k[-1] - k[0] + 1 - len(k)


@pytest.mark.parametrize("stall_ms", [20, 300, 900])
def test_a_backlog_that_arrives_at_once_is_no_loss(stall_ms: int) -> None:
    k = np.arange(3000)
    arrival = np.where((k > 1000) & (k < 1000 + stall_ms), 1000.0 + stall_ms, k)
    steps = counter_steps(k % 256, 256, _ns(arrival), 1e-3)
    assert steps.missing == 0
    assert not steps.restarted.any()
    assert steps.late_s < 1e-3


def test_frames_lost_within_a_backlog_are_counted() -> None:
    k = np.delete(np.arange(3000), np.arange(1200, 1240))
    arrival = np.where((k > 1000) & (k < 1300), 1300.0, k)
    steps = counter_steps(k % 256, 256, _ns(arrival), 1e-3)
    assert steps.missing == 40
    assert not steps.restarted.any()


def test_a_restart_is_no_loss_of_what_the_counter_skips() -> None:
    counter = np.concatenate([np.arange(100), np.arange(100)])
    steps = counter_steps(counter, 256, _ns(np.arange(200.0)), 1e-3)
    np.testing.assert_array_equal(np.flatnonzero(steps.restarted), [99])
    np.testing.assert_array_equal(steps.step, np.ones(199))
    assert steps.missing == 0


@pytest.mark.parametrize("pause_s", [2.6, 3.3, 11.0, 128.0, 256.0, 257.0])
def test_a_sender_that_paused_has_lost_nothing(pause_s: float) -> None:
    """By the time alone it were 256 frames after 2.6 s, and 25,600 after 256 s."""
    arrival = np.arange(200.0) * 10
    arrival[100:] += pause_s * 1e3
    steps = counter_steps(np.arange(200) % 256, 256, _ns(arrival), 0.01)
    assert steps.missing == 0
    np.testing.assert_array_equal(np.flatnonzero(steps.restarted), [99])
    assert steps.late_s < 1e-9


@pytest.mark.parametrize(("cycles", "missing"), [(97, 96), (113, 0)])
def test_a_silence_of_a_second_is_a_pause(cycles: int, missing: int) -> None:
    """At 100 Hz, with a counter of four bits: 0.97 s and 1.13 s are whole turns and one frame."""
    arrival = np.arange(40.0) * 10
    arrival[20:] += (cycles - 1) * 10
    assert counter_steps(np.arange(40) % 16, 16, _ns(arrival), 0.01).missing == missing


def test_repeated_frames_are_no_loss() -> None:
    steps = counter_steps(np.array([3, 4, 4, 5]), 256, _ns(np.array([0, 1, 1.2, 2])), 1e-3)
    np.testing.assert_array_equal(steps.step, [1, 0, 1])
    assert steps.missing == 0


def test_without_a_cycle_the_counter_is_taken_at_its_word() -> None:
    steps = counter_steps(np.array([250, 255, 3]), 256, _ns(np.array([0.0, 1, 9000])), None)
    np.testing.assert_array_equal(steps.step, [5, 4])
    assert steps.missing == 7


@pytest.mark.parametrize(
    ("counter", "late_s"),
    [
        (np.arange(21), 0.02),
        (np.delete(np.arange(22), 5), 0.0195),
        (np.concatenate([np.arange(11), np.arange(10)]), 0.02),
    ],
    ids=["whole", "one lost", "a restart"],
)
def test_a_delay_is_carried_over_and_forgotten_by_a_twentieth(
    counter: NDArray[np.int64], late_s: float
) -> None:
    """The first of the frames is 3 cycles late; 20 (21) cycles later one of them is forgotten."""
    sent = np.arange(21) + (np.arange(21) >= 5) * (counter[5] == 6)
    steps = counter_steps(counter, 256, _ns(sent * 10.0), 0.01, 0.03)
    assert steps.late_s == pytest.approx(late_s)
