"""What is kept of the last seconds."""

import numpy as np

from daq.recorder.recent import RecentSamples

S = 1_000_000_000


def _times(samples: RecentSamples, start_s: int, stop_s: int) -> list[int]:
    found = samples.between(start_s * S, stop_s * S)
    return [int(t_ns) // S for t_ns in found["acc"][0]] if found else []


def test_a_run_is_whole_when_a_pause_of_the_bus_follows() -> None:
    samples = RecentSamples(kept_s=4.0)
    for second in (0, 1, 2, 3, 4, 20):
        samples.add(second * S, {"acc": (np.array([second * S]), np.ones(1))})
    assert _times(samples, 0, 5) == [0, 1, 2, 3, 4]  # the run ends at the first block after it
    samples.add(21 * S, {"acc": (np.array([21 * S]), np.ones(1))})
    assert _times(samples, 0, 30) == [20, 21]


def test_samples_of_a_clock_that_was_set_back_go() -> None:
    samples = RecentSamples(kept_s=4.0)
    for second in (100, 101, 50):
        samples.add(second * S, {"acc": (np.array([second * S]), np.ones(1))})
    assert _times(samples, 0, 200) == [50]
