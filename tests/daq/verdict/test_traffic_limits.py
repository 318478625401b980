"""The limits of what may be silent, lost or cut in a run, from both sides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.runs import Losses
from daq.verdict.traffic import lost_frames, overload, stale
from daq.verdict.window import traces

from .closed_forms import BODY, HUB, T_S, TRAVEL, Array, one, pulse, window


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


def test_a_message_that_another_says_was_silent_is_so_for_twice_the_limit() -> None:
    bench, run = window({TRAVEL: np.sin(T_S)})
    (finding,) = stale(bench, replace(run, stale=("absent",)), ())
    assert (finding.passed, finding.value, finding.subject) == (False, 0.5, "absent")


def test_silent_messages_are_named_unless_all_are() -> None:
    """The one that was silent for longest is the subject."""
    whole, broken = (
        np.arange(-1.0, 2.5001, 0.001),
        without(np.arange(-1.0, 2.5001, 0.001), 1.0, 0.5),
    )
    longer = without(whole, 1.0, 0.75)
    for hub_s, start, subject in (
        (longer, "all 2 messages were silent for 0.75 s", "HUB"),
        (whole, "SUSP was silent for 0.50 s", "SUSP"),
    ):
        bench, run = window({HUB: T_S, TRAVEL: T_S})
        columns = {
            channel.name: (run.bump_ns + np.rint(time_s * 1e9).astype(np.int64), np.sin(time_s))
            for channel, time_s in ((HUB, hub_s), (TRAVEL, broken))
        }
        (finding,) = stale(bench, replace(run, channels=columns), ())
        assert not finding.passed
        assert finding.text.startswith(start)
        assert finding.subject == subject


@pytest.mark.parametrize(
    ("pairs", "text", "advice"),
    [
        ({}, "SUSP was without a usable value for 3.50 s (limit 0.25 s)", "of its signal"),
        (
            {"twin": "SUSP.y"},
            "travel was without a usable value for 3.50 s (limit 0.25 s)",
            "of its signal",
        ),
        ({"gone": "HUB.a"}, "SUSP, HUB were silent for 3.50 s (limit 0.25 s)", "plug and power"),
    ],
)
def test_frames_without_a_usable_value_are_not_silence(
    pairs: dict[str, str], text: str, advice: str
) -> None:
    """A sensor that sent 1e12 m at 500 Hz was reported as silent."""
    others = {name: replace(TRAVEL, name=name, signal=signal) for name, signal in pairs.items()}
    shown = {c: np.sin(T_S) for name, c in others.items() if name == "twin"}
    nothing = {c: np.empty(0) for name, c in others.items() if name == "gone"}
    bench, run = window({TRAVEL: np.full(len(T_S), np.nan), BODY: np.sin(T_S), **shown})
    bench = replace(bench, channels=(*bench.channels, *nothing))
    (finding,) = stale(bench, run, ())
    assert finding.text == text
    assert advice in finding.advice


@pytest.mark.parametrize(("lost", "passed"), [(71, True), (72, False)])
def test_two_percent_of_the_frames_may_be_lost(lost: int, passed: bool) -> None:
    bench, run = window({TRAVEL: pulse(0.05)})  # 3500 came: 71 of 3571 are 1.99 %
    run = replace(run, losses=Losses(counter_gaps=lost))
    (finding,) = lost_frames(bench, run, traces(bench.channels, run))
    assert finding.passed is passed


def test_where_more_is_lost_than_a_gap_the_losses_are_named() -> None:
    time_s = without(np.arange(-1.0, 2.5, 0.001), 0.05, 0.021)  # 3480 samples: 72 are 2.03 %
    for lost, expected in ((70, 0.021), (72, 72 / 3552)):
        bench, run = window({TRAVEL: np.sin(time_s)}, time_s)
        run = replace(run, losses=Losses(counter_gaps=lost))
        (finding,) = lost_frames(bench, run, traces(bench.channels, run))
        assert not finding.passed
        assert finding.value == pytest.approx(expected)


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


@pytest.mark.parametrize(("at_s", "passed"), [(0.15, True), (0.25, False)])
def test_a_top_is_cut_after_the_bump_or_on_it(at_s: float, passed: bool) -> None:
    noise = np.random.default_rng(3).standard_normal(len(T_S))
    value = np.where((at_s <= T_S) & (at_s + 0.02 > T_S), 50.0, noise)
    assert one(overload, {HUB: value}).passed is passed


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
