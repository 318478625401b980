"""The envelope of the newest samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from daq.recorder.judging import LiveRing

S = 1_000_000_000


def ring_of(*blocks: tuple[Sequence[float], Sequence[float]]) -> LiveRing:
    ring = LiveRing(["acc"])
    for times_s, values in blocks:
        t_ns = np.rint(np.array(times_s) * S).astype(np.int64)
        ring.add({"acc": (t_ns, np.array(values, float))})
    return ring


def test_a_bin_has_lowest_and_highest_value_of_20_ms() -> None:
    live = ring_of(([0.0, 0.019, 0.02, 0.2], [1.0, 3.0, 5.0, 0.0])).fresh()
    assert live is not None
    assert (live.first_bin, live.bin_s) == (0, 0.02)
    assert live.lanes[0].low[:3] == (1.0, 5.0, None)
    assert live.lanes[0].high[:3] == (3.0, 5.0, None)


def test_a_bin_is_published_once_when_100_ms_older_than_the_newest() -> None:
    assert ring_of(([0.0, 0.09], [1.0, 2.0])).fresh() is None  # the newest bin is 4
    ring = ring_of(([0.0, 0.11], [1.0, 2.0]))  # 5: bin 0 is complete
    live = ring.fresh()
    assert live is not None
    assert live.lanes[0].low == (1.0,)
    assert ring.fresh() is None


def test_at_most_ten_seconds_are_published_at_once_and_a_minute_is_kept() -> None:
    ring = ring_of(([0.0, 30.0, 59.99], [1.0, 2.0, 3.0]))
    live = ring.fresh()
    assert live is not None
    assert len(live.lanes[0].low) == 500
    assert live.first_bin == 2995 - 500
    history = ring.history(60.0)
    assert history.first_bin == 0
    assert history.lanes[0].low[0] == 1.0
    ring.add({"acc": (np.array([60 * S]), np.array([4.0]))})  # one bin more than a minute
    assert ring.history(60.0).first_bin == 1


def test_values_are_rounded_to_four_digits_and_those_that_are_not_finite_left_out() -> None:
    values = [1.23456, np.nan, np.inf, -0.000123456, 0.0]
    live = ring_of(([0.0, 0.02, 0.04, 0.06, 0.3], values)).fresh()
    assert live is not None
    assert live.lanes[0].low[:4] == (1.235, None, None, -0.0001235)


def test_a_clock_set_by_more_than_a_minute_restarts_the_ring() -> None:
    for first_s, later_s in ((100.0, 200.0), (200.0, 100.0)):
        ring = ring_of(([first_s], [1.0]), ([later_s, later_s + 0.2], [2.0, 3.0]))
        history = ring.history(60.0)
        assert history.first_bin == later_s / 0.02
        assert history.lanes[0].low[:2] == (2.0, None)
