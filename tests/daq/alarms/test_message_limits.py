"""Messages that are late, mixed, of another length or unknown, on states made by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daq.alarms.messages import (
    MessagesWatch,
    MessageWatch,
    Stranger,
    advance_messages,
    alive,
    message_symptoms,
)
from daq.samples.health import HealthState
from dbc import FrameBatch, FrameFlag, parse_codec
from dbc.finding import Finding

from ..watched_bench import CODEC, frames

MESSAGE = CODEC.messages[0]
T_NS = 1_800_000_000_000_000_000
NOTHING = FrameBatch.concatenate([frames(0x700, [bytes(8)], T_NS)]).select(np.zeros(0, np.intp))


def message_watch(period_s: float | None, seen_s: float = 10.0, **facts: Any) -> MessageWatch:
    fresh = MessageWatch(seen_s, period_s, 0.0, 0, {0: seen_s})
    return replace(fresh, **facts)


def traffic(
    known: dict[str, MessageWatch], now_s: float, expected: tuple[str, ...] = (),
    well: tuple[bool, ...] = (True, True), **facts: Any,
) -> list[Finding]:  # fmt: skip
    watch = replace(MessagesWatch(0.0, now_s, known), **facts)
    return message_symptoms(watch, CODEC, expected, ("can0", "can1"), well, now_s)


@pytest.mark.parametrize(
    ("period_s", "away_s", "stale"),
    [(0.2, 0.99, 0), (0.2, 1.01, 1), (0.01, 0.49, 0), (0.01, 0.51, 1), (None, 50.0, 0)],
)
def test_a_message_is_late_after_five_periods_or_half_a_second(
    period_s: float | None, away_s: float, stale: int
) -> None:
    known = {MESSAGE.name: message_watch(period_s)}
    found = traffic(known, 10.0 + away_s, (MESSAGE.name,))
    assert [s.code for s in found] == ["stale"] * stale
    if stale and period_s == 0.2:
        assert found[0].text == "no frame for 1.0 s; one is due every 200 ms"
    assert traffic(known, 10.0 + away_s, (MESSAGE.name,), (False, True)) == []
    assert traffic(known, 10.0 + away_s, (MESSAGE.name,), ()) == []


@pytest.mark.parametrize(("away_s", "stale"), [(60.0, 1), (60.1, 0)])
def test_a_message_that_no_channel_needs_has_ended_after_a_minute(
    away_s: float, stale: int
) -> None:
    known = {MESSAGE.name: message_watch(0.01)}
    assert len(traffic(known, 10.0 + away_s)) == stale
    assert len(traffic(known, 10.0 + away_s, (MESSAGE.name,))) == 1


@pytest.mark.parametrize(("ago_s", "mixed"), [(2.0, 1), (2.1, 0)])
def test_a_message_on_two_buses_within_two_seconds_is_mixed(ago_s: float, mixed: int) -> None:
    each = message_watch(0.01, 10.0, buses={1: 10.0, 0: 10.0 - ago_s})
    found = traffic({MESSAGE.name: each}, 10.0)
    assert [(s.code, s.text) for s in found] == [
        ("mixed_id", "comes from can0 and can1 at the same time")
    ] * mixed
    five = message_watch(0.01, 10.0, buses={5: 10.0, 2: 10.0})
    (found_five,) = traffic({MESSAGE.name: five}, 10.0)
    assert found_five.text == "comes from 2 and 5 at the same time"


def test_a_sensor_that_never_came_is_late_after_a_second() -> None:
    for waited_s, stale in ((0.99, 0), (1.01, 1)):
        found = traffic({}, waited_s, (MESSAGE.name,))
        assert [s.code for s in found] == ["stale"] * stale
        assert traffic({}, waited_s, (MESSAGE.name,), (False, False)) == []
    (late,) = traffic({}, 12.4, (MESSAGE.name,), (False, True))
    assert late.text == "no frame since the recorder started to listen (12 s)"
    assert message_symptoms(MessagesWatch(), CODEC, (MESSAGE.name,), (), (True,), 9.0) == []
    assert traffic({}, 12.4, (MESSAGE.name,), began_s=11.5) == []
    (late,) = traffic({}, 12.6, (MESSAGE.name,), began_s=11.5)
    assert late.text == "no frame since the recorder started to listen (1 s)"


@pytest.mark.parametrize(
    ("age_s", "waited_s", "code"),
    [
        (2.0, 10.0, "none_of_dbc"),
        (2.1, 10.0, ""),
        (0.0, 0.7, "unknown_id"),
        (0.0, 0.8, "none_of_dbc"),
    ],
)
def test_a_bus_of_strangers_is_another_bus(age_s: float, waited_s: float, code: str) -> None:
    strangers = {(0, 0x700, False): Stranger(9, 10.0, waited_s - age_s)}
    found = traffic({}, waited_s, strangers=strangers)
    assert [s.code for s in found][:1] == ([code] if code else [])
    if code == "none_of_dbc":
        assert found[0].text == f"no frame of a message of the DBC in {waited_s:.1f} s, but 0x700"
        with_known = traffic({MESSAGE.name: message_watch(1e3, waited_s)}, waited_s,
                             strangers=strangers)  # fmt: skip
        assert [s.code for s in with_known] == ["unknown_id"]


def test_six_strangers_are_named_the_most_frequent_first() -> None:
    strangers = {(1, 0x700 + n, n == 2): Stranger(10 * n, 2.0 * n + 0.4, 10.0) for n in range(8)}
    (found,) = traffic({MESSAGE.name: message_watch(1e3)}, 10.0, strangers=strangers)
    assert (found.code, found.subject) == ("unknown_id", "can1")
    assert found.text == (
        "8 identifiers are not in the DBC: 0x707 (14 Hz), 0x706 (12 Hz), 0x705 (10 Hz), "
        "0x704 (8 Hz), 0x703 (6 Hz), 0x702x (4 Hz) and 2 more"
    )
    six = {key: strangers[key] for key in list(strangers)[:6]}
    (found,) = traffic({MESSAGE.name: message_watch(1e3)}, 10.0, strangers=six)
    assert "more" not in found.text
    twin = {(0, MESSAGE.can_id, True): Stranger(1, 1.0, 10.0)}
    found, _ = traffic({MESSAGE.name: message_watch(1e3)}, 10.0, strangers=twin)
    assert found.text.endswith("comes with 29 bits; the DBC has it with 11")
    wide = 'VERSION ""\n\nBU_: A\n\nBO_ 2147485440 M: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" A\n'
    watch = MessagesWatch(strangers={(0, 0x700, False): Stranger(1, 1.0, 10.0)})
    found, _ = message_symptoms(watch, parse_codec(wide, "x.dbc"), (), ("can0",), (True,), 10.0)
    assert found.text.endswith("comes with 11 bits; the DBC has it with 29")


def advanced(watch: MessagesWatch, batch: FrameBatch, now_s: float) -> MessagesWatch:
    return advance_messages(watch, CODEC, batch, None, HealthState(), now_s)[0]


def test_strangers_are_counted_with_their_rate_and_forgotten_after_a_minute() -> None:
    watch = advanced(MessagesWatch(), frames(0x700, [bytes(8)] * 5, T_NS), 100.0)
    key = (0, 0x700, False)
    assert watch.strangers[key] == Stranger(5, 5.0, 100.0)  # the first turn counts as a second
    both = FrameBatch.concatenate(
        [frames(0x700, [bytes(8)] * 4, T_NS), frames(0x700, [bytes(3)] * 2, T_NS)]
    )
    watch = advanced(watch, both, 100.5)
    assert watch.strangers[key] == Stranger(11, 12.0, 100.5)
    assert key in advanced(watch, NOTHING, 160.5).strangers
    assert key not in advanced(watch, NOTHING, 160.6).strangers
    many = FrameBatch.concatenate([frames(0x10000 + n, [b""], T_NS, FrameFlag.EXTENDED)
                                   for n in range(300)])  # fmt: skip
    assert len(advanced(MessagesWatch(), many, 1.0).strangers) == 256


def test_identifiers_of_11_and_29_bits_are_two_strangers() -> None:
    both = [frames(0x123, [bytes(8)], T_NS, flag) for flag in (FrameFlag.EXTENDED, FrameFlag.FD)]
    watch = advanced(MessagesWatch(), FrameBatch.concatenate(both), 1.0)
    assert set(watch.strangers) == {(0, 0x123, True), (0, 0x123, False)}


def test_what_a_counter_misses_is_counted_once() -> None:
    watch = MessagesWatch()
    for total, counted in ((0, {}), (3, {"M": 3}), (3, {}), (5, {"M": 2})):
        counters: Any = {"M": SimpleNamespace(missing=total)}
        health = replace(HealthState(), counters=counters)
        watch, counts = advance_messages(watch, CODEC, NOTHING, None, health, 1.0)
        assert {name: count.number for (_, name), count in counts.items()} == counted


def test_a_frame_of_another_length_is_counted() -> None:
    batch = FrameBatch.concatenate(
        [
            frames(MESSAGE.can_id, [bytes(MESSAGE.length - 1)] * 3, T_NS),
            frames(MESSAGE.can_id, [bytes(MESSAGE.length - 2)] * 2, T_NS),
            frames(MESSAGE.can_id, [bytes(8)] * 4, T_NS, FrameFlag.REMOTE),
        ]
    )
    after, counts = advance_messages(MessagesWatch(), CODEC, batch, None, HealthState(), 3.0)
    assert counts["wrong_length", MESSAGE.name].number == 5
    assert counts["wrong_length", MESSAGE.name].detail.endswith(
        f"bytes; the DBC says {MESSAGE.length}"
    )
    assert (after.began_s, after.turn_s) == (3.0, 3.0)
    assert advanced(MessagesWatch(), NOTHING, 3.0).began_s is None


def learn(times_s: list[float], each: int) -> MessageWatch:
    """Return a message without a cycle in the DBC after turns with some frames each."""
    (codec_message,) = (m for m in CODEC.messages if m is MESSAGE)
    watch = MessagesWatch(known={MESSAGE.name: message_watch(None, times_s[0], learn_s=times_s[0])})
    for at_s in times_s[1:]:
        batch = frames(codec_message.can_id, [bytes(MESSAGE.length)] * each, T_NS)
        watch = advanced(watch, batch, at_s)
    return watch.known[MESSAGE.name]


@pytest.mark.parametrize(
    ("turns", "each", "period_s"),
    [
        (20, 1, 0.1),  # 20 frames in 2 s
        (19, 1, None),
        (19, 2, None),  # 38 frames in 1.9 s
        (20, 2, 0.05),
    ],
)
def test_a_period_is_learned_from_twenty_frames_in_two_seconds(
    turns: int, each: int, period_s: float | None
) -> None:
    found = learn([10.0 + n / 10 for n in range(turns + 1)], each)
    assert found.period_s == (None if period_s is None else pytest.approx(period_s))


@pytest.mark.parametrize(("gap_s", "learned"), [(0.73, True), (0.74, False)])
def test_what_pauses_for_three_mean_periods_is_not_regular(gap_s: float, learned: bool) -> None:
    """Twelve frames in 2.2 s and the gap: three mean periods are 0.7333 s then."""
    times = [10.0 + n / 5 for n in range(12)]
    times += [times[-1] + gap_s + n / 5 for n in range(9)]
    assert (learn(times, 1).learn_s == 10.0) is learned


@pytest.mark.parametrize(("gap_s", "learned"), [(0.44, True), (0.46, False)])
def test_what_pauses_for_nearly_half_a_second_is_not_regular(gap_s: float, learned: bool) -> None:
    """Its mean period is 0.02 s; as no client watches, cycles are 0.3 s apart and more."""
    times = [10.0 + n / 50 for n in range(51)]
    times += [times[-1] + gap_s]
    assert (learn(times, 1).learn_s == 10.0) is learned


@pytest.mark.parametrize(("turns", "period_s"), [(19, None), (20, 0.1)])
def test_after_a_pause_the_period_is_learned_anew(turns: int, period_s: float | None) -> None:
    times = [10.0 + n / 10 for n in range(12)]
    times += [times[-1] + 0.5 + n / 10 for n in range(turns + 1)]
    found = learn(times, 1).period_s
    assert found == (None if period_s is None else pytest.approx(period_s))


@pytest.mark.parametrize(
    ("flag", "strangers"), [(FrameFlag.ERROR, 0), (FrameFlag.REMOTE, 0), (FrameFlag.FD, 1)]
)
def test_error_and_remote_frames_are_no_strangers(flag: FrameFlag, strangers: int) -> None:
    watch = advanced(MessagesWatch(), frames(0x700, [bytes(8)], T_NS, flag), 1.0)
    assert len(watch.strangers) == strangers


def test_alive_are_the_expected_messages_that_are_not_late() -> None:
    known = {"A": message_watch(0.2), "B": message_watch(None), "C": message_watch(0.01)}
    watch = MessagesWatch(0.0, 0.0, known)
    assert alive(watch, ("A", "B", "C", "D"), 10.4) == 3
    assert alive(watch, ("A", "B", "C", "D"), 10.6) == 2
    assert alive(watch, ("A", "B", "C", "D"), 11.1) == 1
    assert alive(watch, ("A", "B", "C", "D"), 12.1) == 0
