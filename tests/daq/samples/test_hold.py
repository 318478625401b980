"""The longest hold of a value in a run, and when it is too long to be chance."""

from __future__ import annotations

import numpy as np
import pytest

from daq.samples.converter import Hold, longest_hold

T_S = np.arange(2000) / 1000.0
"""A run of 2 s at 1 kHz: at rest until 0.3 s, the decay from 0.5 s on."""


def held(begin_s: float, end_s: float) -> Hold:
    """Return the longest hold of a channel that changes in each sample but between two times."""
    value = np.arange(2000.0)
    first, last = np.searchsorted(T_S, [begin_s - 1e-9, end_s + 1e-9])
    value[first:last] = value[first]
    return longest_hold(T_S, value, 0.3, 0.5)


@pytest.mark.parametrize(
    ("begin_s", "end_s", "held_s"),
    [
        (0.6, 0.7, 0.1),
        (0.999, 1.4, 0.401),  # it begins within half a second after the start of the decay
        (1.001, 1.4, 0.0),
        (0.1, 0.499, 0.0),  # it is over before the decay
        (0.1, 0.502, 0.402),
    ],
)
def test_a_hold_counts_if_it_begins_early_in_the_decay_or_reaches_into_it(
    begin_s: float, end_s: float, held_s: float
) -> None:
    found = held(begin_s, end_s)
    assert found.held_s == pytest.approx(held_s)
    assert not found.constant
    if held_s:
        assert found.last - found.first == round(1000 * held_s)


def test_rates_are_those_of_the_rest_and_of_the_decay_and_not_of_the_bump() -> None:
    value = np.zeros(2000)
    value[:300:3] = 1.0  # 200 of 299 differences
    value[300:500] = np.arange(200)
    value[500:] = np.arange(1500) // 10  # one of ten
    found = longest_hold(T_S, value, 0.3, 0.5)
    assert found.rest_rate == pytest.approx(2 / 3, abs=0.01)
    assert found.decay_rate == pytest.approx(0.1, abs=0.001)
    assert (found.last - found.first, found.constant) == (9, False)


def test_a_constant_channel_is_held_for_the_whole_run() -> None:
    found = longest_hold(T_S, np.full(2000, 3.0), 0.3, 0.5)
    assert (found.first, found.last, found.constant) == (0, 1999, True)
    assert found.held_s == pytest.approx(1.999)
    assert (found.rest_rate, found.decay_rate) == (0.0, 0.0)


def test_a_hold_is_frozen_from_a_fifth_of_a_second_and_20_expected_changes_on() -> None:
    time_s = np.arange(80) / 200.0
    value = np.arange(80.0)
    value[30:70] = 0.0  # 40 samples, 0.195 s
    short = longest_hold(time_s, value, 0.1, 0.12)
    assert short.held_s == pytest.approx(0.195)
    assert not short.is_frozen(1.0)
    long = longest_hold(time_s * 1.03, value, 0.1, 0.12)
    assert long.held_s == pytest.approx(0.201, abs=0.001)
    assert long.is_frozen(0.5)
    assert not long.is_frozen(0.49)
    assert not long.is_frozen(np.nan)
