"""A sensor may be silent equally long at the bench and at the desk."""

from __future__ import annotations

import numpy as np
import pytest

from daq.silence import Silence, longest_gap_s, longest_silence


@pytest.mark.parametrize(
    ("gap_s", "cycle_s", "stale"),
    [
        (0.24, 0.01, False),  # a quarter of a second
        (0.26, 0.01, True),
        (0.99, 0.1, False),  # ten cycles of a slow message
        (1.01, 0.1, True),
    ],
)
def test_a_quarter_of_a_second_or_ten_cycles_is_too_long(
    gap_s: float, cycle_s: float, stale: bool
) -> None:
    before = np.arange(20) * cycle_s
    after = before[-1] + gap_s + np.arange(20) * cycle_s
    found = longest_silence(np.concatenate([after, before]), 0.0, float(after[-1]))
    assert (found.begin_s, found.end_s) == pytest.approx((before[-1], after[0]))
    assert found.length_s == pytest.approx(gap_s)
    assert found.limit_s == pytest.approx(max(0.25, 10.0 * cycle_s))
    assert found.is_stale is stale


def test_silence_counts_from_the_begin_of_the_run_to_its_end() -> None:
    time_s = np.arange(101) / 100.0
    assert longest_silence(time_s, -0.5, 1.2)[:2] == (-0.5, 0.0)
    assert longest_silence(time_s, -0.1, 1.4)[:2] == (1.0, 1.4)
    assert longest_silence(time_s, 0.5, 0.9).length_s == pytest.approx(0.01)
    assert longest_silence(np.empty(0), 0.0, 2.0) == Silence(0.0, 2.0, 0.25)


@pytest.mark.parametrize(("period_s", "limit_s"), [(0.005, 0.02), (0.01, 0.035)])
def test_a_gap_in_the_wheels_motion_is_20_ms_or_three_and_a_half_samples(
    period_s: float, limit_s: float
) -> None:
    assert longest_gap_s(period_s) == pytest.approx(limit_s)
