"""What may be silent, lost, cut or held in a run, from both sides of each limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from daq.channels import Channel
from daq.runs import Losses
from daq.verdict.checks import frozen, lost_frames, overload, stale
from daq.verdict.window import traces
from dbc.words import Finding

from .closed_forms import (
    BODY,
    HUB,
    OTHER,
    PITCH,
    T_S,
    TRAVEL,
    Array,
    bench_of,
    one,
    ringing,
    run_of,
    window,
)


def without(time_s: Array, start_s: float, length_s: float) -> Array:
    """Return the times less those within a gap: as long from sample to sample."""
    return time_s[(time_s <= start_s + 1e-6) | (time_s >= start_s + length_s - 1e-6)]


@pytest.mark.parametrize(
    ("period_s", "silent_s", "passed"),
    [(0.001, 0.249, True), (0.001, 0.251, False), (0.05, 0.45, True), (0.05, 0.55, False)],
)
def test_a_message_may_be_silent_for_a_quarter_second_or_ten_cycles(
    period_s: float, silent_s: float, passed: bool
) -> None:
    time_s = without(np.arange(-1.0, 2.5001, period_s), 1.0, silent_s)
    assert one(stale, {TRAVEL: np.sin(time_s)}, time_s).passed is passed


@pytest.mark.parametrize(
    ("pairs", "who"),
    [({}, "SUSP was"), ({"twin": "SUSP.y"}, "travel was"), ({"gone": "HUB.a"}, "SUSP, HUB were")],
)
def test_values_that_cannot_be_used_are_named_like_silence(pairs: dict[str, str], who: str) -> None:
    others = {name: replace(TRAVEL, name=name, signal=signal) for name, signal in pairs.items()}
    shown = {c: np.sin(T_S) for name, c in others.items() if name == "twin"}
    nothing = {c: np.empty(0) for name, c in others.items() if name == "gone"}
    bench, run = window({TRAVEL: np.full(len(T_S), np.nan), BODY: np.sin(T_S), **shown})
    bench = replace(bench, channels=(*bench.channels, *nothing))
    (finding,) = stale(bench, run, ())
    assert finding.text == f"{who} silent or without a usable value for 3.50 s (limit 0.25 s)"
    assert "plug and power, and type, checksum and factor" in finding.advice


@pytest.mark.parametrize(
    ("period_s", "gap_s", "start_s", "passed"),
    [
        (0.001, 0.019, 0.05, True),
        (0.001, 0.021, 0.05, False),
        (0.001, 0.021, 0.19, False),
        (0.001, 0.021, 0.21, True),
        (0.01, 0.03, 0.05, True),
        (0.01, 0.04, 0.05, False),
    ],
)
def test_no_gap_while_the_wheels_move(
    period_s: float, gap_s: float, start_s: float, passed: bool
) -> None:
    """A gap counts from 20 ms or 3.5 cycles on, within 0.2 s after the bump."""
    time_s = without(np.arange(-1.0, 2.5, period_s), start_s, gap_s)
    assert one(lost_frames, {TRAVEL: np.sin(time_s)}, time_s).passed is passed


@pytest.mark.parametrize("top", [50.0, -50.0])
@pytest.mark.parametrize(
    ("at_s", "saturated", "passed"),
    [(0.25, ("hub",), False), (0.15, ("hub",), True), (0.25, (), True), (0.25, ("other",), True)],
)
def test_of_a_channel_that_touched_its_range_one_sample_is_a_top(
    top: float, at_s: float, saturated: tuple[str, ...], passed: bool
) -> None:
    """The other end of the range is reached while the wheels move, where it is harmless."""
    value = np.random.default_rng(3).standard_normal(len(T_S))
    value[np.isclose(T_S, 0.1)], value[np.isclose(T_S, at_s)] = -top, top
    bench, run = window({HUB: value})
    (finding,) = overload(bench, replace(run, saturated=saturated), traces(bench.channels, run))
    assert finding.passed is passed


@pytest.mark.parametrize(
    ("lost", "came", "share", "passed"),
    [(0, 0, 0.0, True), (1, 0, 1.0, False), (20, 980, 0.02, True), (21, 980, 21 / 1001, False)],
)
def test_lost_frames_are_a_share_of_all(lost: int, came: int, share: float, passed: bool) -> None:
    bench, run = window({TRAVEL: T_S[:came]}, T_S[:came])
    run = replace(run, losses=Losses(counter_gaps=lost))
    (finding,) = lost_frames(bench, run, ())
    assert finding.passed is passed
    assert finding.value == pytest.approx(share)


def test_tops_are_counted_in_samples_and_those_on_the_bump_are_reported() -> None:
    noise = np.random.default_rng(3).standard_normal(len(T_S))
    late = np.where((T_S > 0.2495) & (T_S < 0.2695), 50.0, noise)
    finding = one(overload, {HUB: late})
    assert (finding.value, finding.limit, finding.subject) == (20.0, 0.0, "hub")
    assert "at +0.27 s" in finding.text
    early = one(overload, {HUB: np.where((T_S > 0.0995) & (T_S < 0.1195), 50.0, noise)})
    assert (early.passed, early.value, early.limit) == (True, 0.0, 0.0)
    assert early.text.startswith("hub: at the end of the range on the bump only")
    before = one(overload, {HUB: np.where((T_S > -0.5005) & (T_S < -0.4805), 50.0, noise)})
    none = one(overload, {HUB: noise})
    assert before.text == none.text == "no sensor at the end of its range"


def test_the_silence_of_each_message_is_counted_to_the_ends_of_the_run() -> None:
    for keep, silent_s in ((T_S < 2.3, 0.2), (T_S > -0.7, 0.3), (T_S < 1.9, 0.6)):
        run = run_of({TRAVEL: T_S[keep]}, T_S[keep])
        (finding,) = stale(bench_of(TRAVEL), run, ())
        assert finding.value == pytest.approx(silent_s, abs=0.002)
        assert finding.limit == 0.25
        assert finding.passed is (silent_s < 0.25)


def test_a_message_is_as_silent_as_its_best_channel_but_a_mute_channel_is_named() -> None:
    twin = replace(TRAVEL, name="twin", signal="SUSP.x")
    for share, passed in ((0.91, True), (0.89, False)):
        end_s = 2.5 - 3.5 * (1 - share)
        gap = np.where(end_s > T_S, T_S, np.nan)
        run = run_of({TRAVEL: T_S, twin: gap})
        (finding,) = stale(bench_of(TRAVEL, twin), run, ())
        assert finding.passed is passed
        if not passed:
            assert finding.subject == "twin"


NOISE: Array = 1e-3 * np.random.default_rng(0).standard_normal(len(T_S))
SWING: Array = ringing(1.2, 0.1) + NOISE
"""A channel that swings, with noise that changes each sample; 1 kHz."""


def frozen_one(records: Mapping[Channel, Array]) -> Finding:
    """Return the finding on some channels; the bump lasts 0.2 s."""
    bench = bench_of(*records)
    assert bench.campaign.bump_s == pytest.approx(0.2)
    run = run_of(records)
    (finding,) = frozen(bench, run, traces(tuple(records), run))
    return finding


def held(since_s: float, until_s: float, value: Array = SWING) -> Array:
    first, last = np.searchsorted(T_S, [since_s, until_s])
    result = value.copy()
    result[first : last + 1] = value[first]
    return result


@pytest.mark.parametrize(
    ("since_s", "until_s", "passed"),
    [
        (0.3, 0.49, True),
        (0.3, 0.51, False),  # a fifth of a second
        (0.68, 1.0, False),  # it begins within half a second after the bump
        (0.72, 2.4, True),
        (-0.4, 0.18, True),  # it is over before the decay
        (-0.4, 0.22, False),
    ],
)
def test_a_value_held_for_a_fifth_of_a_second_early_in_the_decay_rejects_a_run(
    since_s: float, until_s: float, passed: bool
) -> None:
    finding = frozen_one({TRAVEL: held(since_s, until_s), HUB: SWING})
    assert (finding.code, finding.passed) == ("frozen", passed)
    if not passed:
        assert finding.subject == "travel"
        length = until_s - since_s
        assert finding.text == f"travel held one value for {length:.2f} s (limit 0.20 s)"
        assert finding.advice.startswith("switch the sensor off and on")


@pytest.mark.parametrize("channel", [TRAVEL, HUB, BODY])
def test_a_sensor_that_shows_one_value_in_the_whole_run_is_frozen(channel: Channel) -> None:
    """Alone or with all others of its kind: each bump moves suspensions and body."""
    still = np.full(len(T_S), 0.3)
    records = {BODY: SWING, HUB: SWING, TRAVEL: SWING, PITCH: SWING}
    finding = frozen_one({**records, channel: still})
    assert (finding.passed, finding.subject) == (False, channel.name)
    assert finding.value == pytest.approx(3.5, abs=0.01)


def test_a_rate_of_turn_may_be_silent_by_symmetry() -> None:
    assert frozen_one({PITCH: np.zeros(len(T_S)), HUB: SWING}).passed
    assert not frozen_one({PITCH: held(0.3, 0.7), HUB: SWING}).passed


def test_what_others_of_its_kind_show_decides_whether_a_constant_sensor_is_frozen() -> None:
    """The other travel changes 4 times in the decay: 20 changes are not expected."""
    slow = np.where(T_S > 0.2, np.floor((T_S - 0.2) * 2.0), 0.0)
    still = np.zeros(len(T_S))
    assert frozen_one({TRAVEL: still, OTHER: slow, HUB: SWING}).passed
    assert not frozen_one({TRAVEL: still, OTHER: SWING, HUB: SWING}).passed
