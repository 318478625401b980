from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bus.socketcan.hardware_clock import HardwareClock, advance

BOOT_NS = 1_800_000_000_000_000_000
RATE_HZ = 1000
BLOCK = 10


def stamps(
    seconds: float, fast: float, least_delay_ns: float, seed: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return true times of frames, the adapter's stamps, and the kernel's, which are late."""
    rng = np.random.default_rng(seed)
    n = int(seconds * RATE_HZ)
    since_ns = np.arange(n) * (10**9 // RATE_HZ)
    hardware_ns = np.rint(since_ns * (1 + fast)).astype(np.int64) + 4_000_000
    late_ns = np.rint(least_delay_ns + rng.exponential(300_000, n)).astype(np.int64)
    return BOOT_NS + since_ns, hardware_ns, BOOT_NS + since_ns + late_ns


def converted(
    hardware_ns: NDArray[np.int64],
    kernel_ns: NDArray[np.int64],
    clock: HardwareClock | None = None,
) -> NDArray[np.int64]:
    blocks = []
    for begin in range(0, len(hardware_ns), BLOCK):
        part = slice(begin, begin + BLOCK)
        clock, t_ns = advance(clock, hardware_ns[part], kernel_ns[part])
        blocks.append(t_ns)
    return np.concatenate(blocks)


@pytest.mark.parametrize("fast", [-80e-6, 0.0, 50e-6])
def test_an_adapter_since_boot_and_adrift_is_given_in_the_host_s_time(fast: float) -> None:
    true_ns, hardware_ns, kernel_ns = stamps(60.0, fast, 20_000, seed=1)
    error_ns = converted(hardware_ns, kernel_ns) - true_ns
    settled = error_ns[40 * RATE_HZ :]  # five times the time constant of the steering
    # the most punctual of 1000 exponential delays of 300 us is 0.3 us late on average
    assert np.abs(settled - 20_000).max() < 5_000
    assert np.abs(error_ns).max() < 400_000  # the drift, before it has been learned
    # against delays of 300 us rms: the intervals of neighbours are right to the adapter's drift
    assert np.abs(np.diff(settled)).max() <= 3


def test_time_never_runs_back_while_the_clock_is_steered() -> None:
    _, hardware_ns, kernel_ns = stamps(30.0, 200e-6, 0.0, seed=2)
    assert (np.diff(converted(hardware_ns, kernel_ns)) > 0).all()


@pytest.mark.parametrize("step_s", [-3600, -1, 1, 3600])
def test_a_host_clock_that_is_set_is_followed_at_once(step_s: int) -> None:
    true_ns, hardware_ns, kernel_ns = stamps(6.0, 0.0, 20_000, seed=3)
    kernel_ns[3000:] += step_s * 10**9
    true_ns[3000:] += step_s * 10**9
    assert np.abs(converted(hardware_ns, kernel_ns) - true_ns).max() < 1_000_000


def test_an_adapter_that_restarts_is_followed_at_once() -> None:
    true_ns, hardware_ns, kernel_ns = stamps(6.0, 0.0, 20_000, seed=4)
    hardware_ns[3000:] -= hardware_ns[3000]
    assert np.abs(converted(hardware_ns, kernel_ns) - true_ns).max() < 1_000_000


def test_a_single_late_frame_at_the_start_is_made_up_for_slowly() -> None:
    true_ns, hardware_ns, kernel_ns = stamps(70.0, 0.0, 0.0, seed=5)
    kernel_ns[:BLOCK] += 10_000_000
    error_ns = converted(hardware_ns, kernel_ns) - true_ns
    assert error_ns[0] > 9_000_000
    assert np.abs(error_ns[-1000:]).max() < 200_000
    assert np.abs(np.diff(error_ns)).max() <= 1_000  # a thousandth of the interval
