"""Frames and samples of the last seconds are kept."""

from itertools import pairwise

import numpy as np
import pytest

from daq.recorder.judging import RecentLosses, RecentSamples
from daq.runs import Losses

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


def _counted(*blocks: tuple[float, float, int]) -> RecentLosses:
    """Return losses of blocks: earliest and latest stamp, s, and frames missing so far."""
    losses = RecentLosses(kept_s=4.0)
    for first_s, last_s, missing in blocks:
        losses.add(round(first_s * S), round(last_s * S), Losses(counter_gaps=missing))
    return losses


def _missing(losses: RecentLosses, start_s: float, stop_s: float) -> int:
    return losses.between(round(start_s * S), round(stop_s * S)).counter_gaps


def test_a_span_has_the_losses_of_its_blocks() -> None:
    losses = _counted((0, 1, 5), (1, 2, 7), (2, 3, 10), (3, 4, 14), (4, 5, 19))
    assert [_missing(losses, a + 0.5, b + 0.5) for a, b in pairwise(range(5))] == [7, 5, 7, 9]
    assert _missing(losses, 1.5, 4.0) == 2 + 3 + 4


def test_what_a_pause_of_the_bus_cost_is_not_lost_from_the_run_before_it() -> None:
    losses = _counted((0, 1, 1), (1, 2, 3), (2, 3, 6), (63, 64, 60_006))
    assert _missing(losses, 1.5, 3.0) == 5
    assert _missing(losses, 1.5, 3.03) == 5 + 30  # half a thousandth of the pause is the run's
    assert _missing(losses, 1.5, 63.5) == 5 + 60_000
    again = _counted((0, 1, 1), (1, 2, 3), (2, 3.5, 6), (3.4, 3.6, 7), (63, 64, 60_007))
    assert _missing(again, 1.5, 3.0) == 5  # another bus goes on for a while


def test_losses_before_a_clock_was_set_back_are_not_those_of_a_run_after_it() -> None:
    """What the first block after it has lost may be from before it."""
    losses = _counted((99, 100, 5), (100, 101, 7), (49, 50, 9), (50, 51, 12))
    assert _missing(losses, 45.0, 60.0) == 12 - 9


@pytest.mark.parametrize(("last_s", "missing"), [(100.0, 9), (99.9, 9 - 7)])
def test_a_bus_that_is_a_second_behind_another_is_no_clock_that_was_set_back(
    last_s: float, missing: int
) -> None:
    losses = _counted((100, 101, 5), (101, 101.5, 7), (99, last_s, 9))
    assert _missing(losses, 90.0, 102.0) == missing


def test_losses_of_longer_ago_than_a_run_and_a_second_are_forgotten() -> None:
    """Four seconds and one, before the block that came last but one."""
    blocks = [(second, second + 1, second + 1) for second in range(9)]
    assert _missing(_counted(*blocks), 0.0, 20.0) == 9 - 2
    assert _missing(_counted(*blocks[:-1]), 0.0, 20.0) == 8 - 1


def test_of_a_bus_whose_stamps_stand_still_20_000_blocks_are_kept() -> None:
    """No block of them grows old; half an hour at ten a second."""
    samples, losses = RecentSamples(kept_s=4.0), RecentLosses(kept_s=4.0)
    t_ns = np.array([S])
    for k in range(20_001):
        samples.add(S, {"acc": (t_ns, np.array([k]))})
        losses.add(S, S, Losses(counter_gaps=k))
    assert samples.between(0, 2 * S)["acc"][1].tolist() == list(range(1, 20_001))
    assert losses.between(0, 2 * S).counter_gaps == 20_000 - 1
