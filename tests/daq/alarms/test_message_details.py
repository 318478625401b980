"""Messages that never came, strangers of several buses, bad checksums: on states made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.alarms.messages import (
    MessagesWatch,
    MessageWatch,
    Stranger,
    advance_messages,
    message_symptoms,
)
from daq.samples.health import HealthState
from dbc import Codec, FrameBatch, FrameFlag, parse_codec
from dbc.finding import Finding

from ..watched_bench import CODEC, frames

T_NS = 1_800_000_000_000_000_000


def codec_of(cycle_ms: int) -> Codec:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 256 M: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" A\n'
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 10000;\n'
        f'BA_DEF_DEF_ "GenMsgCycleTime" {cycle_ms};\n'
    )
    return parse_codec(text, "m.dbc")


@pytest.mark.parametrize(
    ("cycle_ms", "limit_s"),
    [(0, 2.0), (500, 2.5), (150, 1.0), (210, 1.05)],  # no cycle is stated: two seconds
)
def test_a_message_that_never_came_is_given_five_cycles(cycle_ms: int, limit_s: float) -> None:
    codec = codec_of(cycle_ms)
    for waited_s, stale in ((limit_s - 0.01, False), (limit_s + 0.01, True)):
        watch = MessagesWatch(0.0, waited_s)
        found = message_symptoms(watch, codec, ("M",), ("can0",), (True,), waited_s)
        assert [symptom.code for symptom in found] == ["stale"] * stale


def strange(
    strangers: dict[tuple[int, int, bool], Stranger], codec: Codec = CODEC
) -> list[Finding]:
    known = {codec.messages[0].name: MessageWatch(10.0, None, 0.0, 0, {0: 10.0})}
    watch = MessagesWatch(0.0, 10.0, known, strangers)
    return message_symptoms(watch, codec, (), ("can0", "can1"), (True, True), 10.0)


def test_strangers_are_reported_bus_by_bus() -> None:
    found = strange(
        {
            (3, 0x701, False): Stranger(1, 1.0, 10.0),
            (0, 0x702, False): Stranger(5, 5.4, 10.0),
            (0, 0x703, False): Stranger(9, 2.0, 8.0),
            (0, 0x704, False): Stranger(9, 2.0, 7.9),  # too long ago
        }
    )
    assert [(symptom.code, symptom.subject, symptom.text) for symptom in found] == [
        ("unknown_id", "can0", "2 identifiers are not in the DBC: 0x703 (2 Hz), 0x702 (5 Hz)"),
        ("unknown_id", "3", "1 identifier is not in the DBC: 0x701 (1 Hz)"),
    ]


def test_six_messages_of_the_other_width_are_named() -> None:
    text = 'VERSION ""\n\nBU_: A\n\n' + "".join(
        f'BO_ {n} M{n}: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" A\n\n' for n in range(8)
    )
    twins = {(0, n, True): Stranger(1, 1.0, 10.0) for n in range(8)}
    found = strange(twins, parse_codec(text, "m.dbc"))
    assert [symptom.code for symptom in found] == ["mixed_id"] * 6 + ["unknown_id"]
    assert found[5].text == "0x5 comes with 29 bits; the DBC has it with 11"
    assert found[5].subject == "M5"


def test_the_first_six_of_a_bus_of_strangers_are_named() -> None:
    strangers = {(0, 0x700 + n, n == 1): Stranger(1, 1.0, 9.0) for n in range(8)}
    watch = MessagesWatch(0.0, 10.0, {}, strangers)
    first, *_ = message_symptoms(watch, CODEC, (), ("can0",), (True,), 10.0)
    assert first.code == "none_of_dbc"
    assert first.text.endswith("but 0x700, 0x701x, 0x702, 0x703, 0x704, 0x705")


def test_bad_checksums_are_counted_by_message() -> None:
    one, other = (m for m in CODEC.messages[:2])
    parts = []
    for message, bad in ((one, 3), (other, 0)):
        data = CODEC.encode(message.name, {message.signals[0].name: np.zeros(5)}).copy()
        data[:bad, 0] ^= 1
        rows = [bytes(row[: message.length]) for row in data]
        parts.append(frames(message.can_id, rows, T_NS))
    decoded = CODEC.decode(FrameBatch.concatenate(parts))
    batch = FrameBatch.empty()
    _, counts = advance_messages(MessagesWatch(), CODEC, batch, decoded, HealthState(), 1.0)
    assert {key: count.number for key, count in counts.items()} == {("crc_bad", one.name): 3}
    _, counts = advance_messages(MessagesWatch(), CODEC, batch, None, HealthState(), 1.0)
    assert counts == {}


@pytest.mark.parametrize(("turn_s", "rate_hz"), [(0.0, 4.0), (99.5, 8.0), (99.9999, 4000.0)])
def test_a_strangers_rate_is_that_of_its_turn(turn_s: float, rate_hz: float) -> None:
    """The first turn counts as a second, and none is shorter than a millisecond."""
    batch = frames(0x700, [bytes(8)] * 4, T_NS)
    watch = replace(MessagesWatch(), turn_s=turn_s)
    after, _ = advance_messages(watch, CODEC, batch, None, HealthState(), 100.0)
    assert after.strangers[0, 0x700, False].rate_hz == pytest.approx(rate_hz)


def test_a_message_is_at_home_on_the_bus_that_it_came_from_last() -> None:
    message = CODEC.messages[0]
    watch = MessagesWatch()
    for bus, now_s in ((1, 1.0), (0, 2.0), (4, 3.0)):
        batch = frames(message.can_id, [bytes(message.length)], T_NS, bus=bus)
        watch, _ = advance_messages(watch, CODEC, batch, None, HealthState(), now_s)
    known = watch.known[message.name]
    assert (known.home, dict(known.buses)) == (4, {1: 1.0, 0: 2.0, 4: 3.0})
    assert known.period_s == message.cycle_s
    wide = frames(0x1FFFFFFF, [bytes(64)], T_NS, FrameFlag.EXTENDED | FrameFlag.FD, bus=200)
    after, _ = advance_messages(watch, CODEC, wide, None, HealthState(), 4.0)
    assert set(after.strangers) == {(200, 0x1FFFFFFF, True)}
