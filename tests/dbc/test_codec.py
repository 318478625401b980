"""Frames decoded and encoded: as cantools does it, with marks, on the bus of each message."""

from __future__ import annotations

import math
from dataclasses import replace
from random import Random

import numpy as np
import pytest
from cantools.database.errors import DecodeError
from numpy.typing import ArrayLike

from dbc import Codec, FrameBatch, FrameFlag, Quality, parse_codec, shipped_dbc
from dbc.codec import CRC_RULES, covered

from .databases import (
    Field,
    Message,
    block,
    crc8_by_division,
    database,
    oracle,
    random_field,
    random_message,
    random_multiplexed,
    random_payload,
)

SHIPPED = parse_codec(shipped_dbc(), "bumpbench.dbc")


def same(ours: float, theirs: float) -> bool:
    """Return True if two numbers are the same float64, NaN being NaN.

    Beyond 2^53 cantools computes with whole numbers, and rounds once less.
    """
    if abs(theirs) > 1 << 53:
        return math.isclose(ours, float(theirs), rel_tol=1e-15)
    return ours == float(theirs) or (math.isnan(ours) and math.isnan(theirs))


def test_every_kind_of_signal_equals_cantools_bit_for_bit_in_frames_of_any_length() -> None:
    draw = Random(1)
    messages = [random_message(draw, f"M{i}", i, extended=bool(i % 2)) for i in range(80)]
    theirs = oracle(messages)
    codec = parse_codec(database(messages), "random.dbc")
    assert not codec.left_out
    for message in messages:
        size = message.length
        sizes = [size, size, size, draw.randint(0, size), draw.randint(0, size), 64]
        sent = [random_payload(draw, size) for size in sizes]
        sent = sent[: draw.randint(3, 6)]
        decoded = codec.decode(block(sent, message.can_id, message.extended))
        for field in message.fields:
            ours = decoded[f"{message.name}.{field.name}"]
            reference = theirs[message.name, field.name]
            for value, quality, payload in zip(ours.value, ours.quality, sent, strict=True):
                found = reference.decode(payload, decode_choices=False, allow_truncated=True)
                if field.name in found:
                    assert same(float(value), found[field.name]), (field, payload)
                    assert quality == 0
                else:
                    assert math.isnan(value)
                    assert quality == Quality.MISSING
        wrong = sum(len(payload) != size for payload in sent)
        assert decoded.counts.wrong_length == wrong


def test_identifier_and_its_kind_decide_together() -> None:
    draw = Random(2)
    keys = [(0x64, False), (0x64, True), (0x7FF, False), (0x1FFFFFFF, True)]
    known = [random_message(draw, f"M{i}", *key) for i, key in enumerate(keys)]
    others = [(0x65, False), (0x65, True), (0x7FF, True), (0x800, False)]
    lost = FrameFlag.ERROR | FrameFlag.REMOTE
    kinds = (0, 0, 0, FrameFlag.ERROR, FrameFlag.REMOTE, FrameFlag.FD)
    frames = [
        (draw.choice(keys + others), draw.choice(kinds), random_payload(draw, 64))
        for _ in range(200)
    ]
    decoded = parse_codec(database(known), "random.dbc").decode(
        block(
            [payload for _, _, payload in frames],
            [key[0] for key, _, _ in frames],
            [key[1] for key, _, _ in frames],
            [int(kind) for _, kind, _ in frames],
        )
    )
    for (name, signal), reference in oracle(known).items():
        key = keys[int(name[1:])]
        carried = [
            (1000 * i, payload)
            for i, (own, kind, payload) in enumerate(frames)
            if own == key and not kind & lost
        ]
        ours = decoded[f"{name}.{signal}"]
        assert ours.t_ns.tolist() == [t_ns for t_ns, _ in carried]
        for value, (_, payload) in zip(ours.value, carried, strict=True):
            theirs = reference.decode(payload, decode_choices=False)[signal]
            assert same(float(value), theirs)
    assert decoded.counts.error_frames == sum(kind == FrameFlag.ERROR for _, kind, _ in frames)
    assert decoded.counts.remote_frames == sum(kind == FrameFlag.REMOTE for _, kind, _ in frames)
    unknown = sum(key in others and not kind & lost for key, kind, _ in frames)
    assert decoded.counts.unknown_id == unknown


def held(message: Message, field: Field, payload: bytes) -> bool:
    """Return by hand whether a frame holds a signal: follow the selectors, bit by bit."""
    if not field.selector:
        return True
    selector = next(f for f in message.fields if f.name == field.selector)
    weights = reversed(range(selector.length)) if selector.motorola else range(selector.length)
    value = sum(
        (payload[bit // 8] >> bit % 8 & 1) << weight
        for bit, weight in zip(selector.bits, weights, strict=True)
    )
    chosen = any(low <= value <= high for low, high in field.chosen)
    return chosen and held(message, selector, payload)


def test_multiplexed_signals_exist_where_their_selectors_say_so() -> None:
    draw = Random(3)
    messages = [random_multiplexed(draw, f"M{i}", 0x300 + i) for i in range(40)]
    codec = parse_codec(database(messages), "random.dbc")
    whole = oracle(messages, whole=True)
    for message in messages:
        sent = [random_payload(draw, 8) for _ in range(8)]
        decoded = codec.decode(block(sent, message.can_id, message.extended))
        rows: dict[str, dict[int, float]] = {}
        for field in message.fields:
            ours = decoded[f"{message.name}.{field.name}"]
            stamps = (ours.t_ns // 1000).tolist()
            assert stamps == [i for i, payload in enumerate(sent) if held(message, field, payload)]
            rows[field.name] = dict(zip(stamps, ours.value.tolist(), strict=True))
        for i, payload in enumerate(sent):
            try:
                theirs = whole[message.name, ""].decode(payload, decode_choices=False)
            except DecodeError:
                continue  # cantools gives up on a frame with an undefined selector
            assert {name: values[i] for name, values in rows.items() if i in values} == theirs


def test_payloads_equal_those_of_cantools() -> None:
    draw = Random(4)
    messages = [
        Message(f"M{i}", i, False, length, (random_field(draw, "s", length),))
        for i, length in enumerate((1, 3, 8, 16, 64) * 20)
    ]
    messages = [m for m in messages if abs(float(m.fields[0].offset)) < 1e6]  # exact, or nearly so
    ours = parse_codec(database(messages), "x.dbc")
    for message, theirs in zip(messages, oracle(messages).values(), strict=True):
        field, signal = message.fields[0], theirs.signals[0]
        low = -(1 << field.length - 1) if field.sign == "-" or field.float_type else 0
        limit = 1000 if field.float_type else 1 << 40
        ends = max(low, -limit), min(low + (1 << field.length) - 1, limit)
        raws = [*ends, *(draw.randint(*ends) for _ in range(3))]
        values = [float(signal.conversion.raw_to_scaled(raw)) for raw in raws]
        for row, value in zip(
            ours.encode(message.name, {"s": np.array(values)}), values, strict=True
        ):
            expected = theirs.encode({"s": value}, strict=False)
            assert row.tobytes() == expected.ljust(8 if message.length <= 8 else 64, b"\0")


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"acc_x": [32.768]}, r"acc_x cannot hold 32\.768"),
        ({"acc_x": [-32.769]}, "acc_x cannot hold"),
        ({"acc_x": [float("nan")]}, "acc_x cannot hold"),
    ],
)
def test_what_cannot_be_sent_is_refused(values: dict[str, ArrayLike], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        SHIPPED.encode("IMU_Accel", values)


def test_a_multiplexed_signal_is_not_sent() -> None:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 2 A\n'
        ' SG_ top M : 0|8@1+ (1,0) [0|0] "" A\n SG_ s m1 : 8|8@1+ (1,0) [0|0] "" A\n'
    )
    with pytest.raises(ValueError, match=r"M\.s is multiplexed"):
        parse_codec(text, "x.dbc").encode("M", {"s": [1]})


def test_a_flipped_bit_marks_every_sample_of_its_frame_and_keeps_the_values() -> None:
    good = bytes([1, 2, 3, 4, 5, 6, 7])
    good += bytes([crc8_by_division(good)])
    sent = [good] + [
        bytes(byte ^ (1 << bit % 8) * (bit // 8 == place) for place, byte in enumerate(good))
        for bit in range(64)
    ]
    decoded = SHIPPED.decode(block(sent, 0x100))
    assert decoded.counts.crc_bad == 64
    for name in ("acc_x", "acc_y", "acc_z", "counter", "crc"):
        samples = decoded[f"IMU_Accel.{name}"]
        assert samples.quality.tolist() == [0] + [Quality.CRC_BAD] * 64
        assert not np.isnan(samples.value).any()
    assert decoded["IMU_Accel.acc_x"].value[0] == 0x0201 * 0.001


def test_only_values_outside_the_stated_range_are_marked() -> None:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 4 A\n'
        ' SG_ ranged : 0|8@1+ (0.5,-10) [0|100] "" A\n'
        ' SG_ empty : 8|8@1+ (1,0) [9|9] "" A\n'
        ' SG_ unstated : 16|8@1+ (1,0) [0|0] "" A\n'
        ' SG_ whole : 24|8@1- (1,0) [-128|127] "" A\n'
    )
    sent = [bytes([raw]) * 4 for raw in (0, 19, 20, 220, 221, 255)] + [b"\x00\x00\x00", b""]
    decoded = parse_codec(text, "x.dbc").decode(block(sent, 5))
    out, missing = Quality.OUT_OF_RANGE, Quality.MISSING
    assert decoded["M.ranged"].quality.tolist() == [out, out, 0, 0, out, out, out, missing]
    assert decoded["M.ranged"].value[:6].tolist() == [-10, -0.5, 0, 100, 100.5, 117.5]
    for name in ("empty", "unstated"):
        assert decoded[f"M.{name}"].quality.tolist() == [0, 0, 0, 0, 0, 0, 0, missing]
    assert decoded["M.whole"].quality.tolist() == [0, 0, 0, 0, 0, 0, missing, missing]


def test_marks_follow_the_frames_of_a_multiplexed_signal() -> None:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 4 A\n'
        ' SG_ top M : 0|8@1+ (1,0) [0|0] "" A\n'
        ' SG_ zero m0 : 8|8@1+ (1,0) [0|0] "" A\n'
        ' SG_ one m1 : 8|8@1+ (1,0) [0|9] "" A\n'
        ' SG_ two m2 : 8|16@1+ (1,0) [0|0] "" A\n'
        ' SG_ crc : 24|8@1+ (1,0) [0|0] "" A\n\n'
        'BA_DEF_ SG_ "SignalRole" ENUM "value","counter","crc8_j1850";\n'
        'BA_DEF_DEF_ "SignalRole" "value";\nBA_ "SignalRole" SG_ 5 crc 2;\n'
    )

    def frame(*payload: int) -> bytes:
        return bytes([*payload, crc8_by_division(bytes(payload))])

    sent = [frame(1, 5, 0), frame(2, 5, 1), frame(1, 10, 0), b"\x01\x07\x00\x00", b"\x02\x07", b""]
    decoded = parse_codec(text, "x.dbc").decode(block(sent, 5))
    one, two = decoded["M.one"], decoded["M.two"]
    assert one.t_ns.tolist() == [0, 2000, 3000]
    assert one.value.tolist() == [5, 10, 7]
    assert one.quality.tolist() == [0, Quality.OUT_OF_RANGE, Quality.CRC_BAD]
    assert two.t_ns.tolist() == [1000, 4000]
    assert two.value[0] == 261
    assert np.isnan(two.value[1])
    assert two.quality.tolist() == [0, Quality.MISSING]
    assert decoded.counts.crc_bad == 1
    assert len(decoded["M.zero"].t_ns) == 0, "without its selector nothing is known to be there"


def test_a_frame_too_short_for_its_checksum_is_missing_it_and_not_wrong() -> None:
    decoded = SHIPPED.decode(block([b"\x01\x02\x03"], 0x100))
    assert decoded.counts.crc_bad == 0
    assert decoded.counts.wrong_length == 1
    assert decoded["IMU_Accel.acc_x"].quality.tolist() == [0]
    assert decoded["IMU_Accel.crc"].quality.tolist() == [Quality.MISSING]


TEXT = """VERSION ""
BU_: A
BO_ 256 M: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A
BO_ 2147745791 X: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A
BO_ 300 N: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A
"""
M, X, N = parse_codec(TEXT, "x.dbc").messages


def two_buses() -> Codec:
    """Return a codec with M and X on the buses 0 and 3, and N on any."""
    own = [
        replace(message, name=f"{sensor}.{message.name}", bus=bus)
        for sensor, bus in (("a", 0), ("b", 3))
        for message in (M, X)
    ]
    return Codec((*own, N))


@pytest.mark.parametrize(("message", "can_id"), [("M", 256), ("X", 262143)])
def test_one_identifier_on_two_buses_is_two_messages(message: str, can_id: int) -> None:
    frames = block([bytes([k, *[0] * 7]) for k in range(6)], can_id, extended=message == "X")
    frames = replace(frames, bus=np.array([0, 3, 0, 3, 3, 7], np.uint8))
    decoded = two_buses().decode(frames)
    assert decoded[f"a.{message}.s"].value.tolist() == [0, 2]
    assert decoded[f"b.{message}.s"].value.tolist() == [1, 3, 4]
    assert decoded.counts.unknown_id == 1  # no sensor is on bus 7


def test_a_message_of_no_bus_is_decoded_from_each() -> None:
    frames = block([bytes([k, *[0] * 7]) for k in range(4)], 300)
    frames = replace(frames, bus=np.array([0, 3, 7, 255], np.uint8))
    assert two_buses().decode(frames)["N.s"].value.tolist() == [0, 1, 2, 3]


def test_a_message_of_the_bus_goes_before_one_of_any_bus() -> None:
    codec = Codec((replace(M, name="any"), replace(M, name="own", bus=2)))
    frames = block([b"\1" + bytes(7), b"\2" + bytes(7)], 256)
    decoded = codec.decode(replace(frames, bus=np.array([1, 2], np.uint8)))
    assert decoded["any.s"].value.tolist() == [1]
    assert decoded["own.s"].value.tolist() == [2]


def _frames(t_ns: list[int], bus: list[int]) -> FrameBatch:
    n = len(t_ns)
    return FrameBatch(
        np.array(t_ns, np.int64),
        np.arange(n, dtype=np.uint32),
        np.zeros(n, np.uint16),
        np.array(bus, np.uint8),
        np.full(n, 8, np.uint8),
        np.zeros((n, 8), np.uint8),
    )


FRAMES = _frames([30, 10, 20, 10, 40], [0, 1, 2, 0, 1])


@pytest.mark.parametrize(
    ("spans", "kept"),
    [
        ([(10, 30)], [1, 2, 3]),  # from the first stamp, until before the last
        ([(11, 31)], [0, 2]),
        ([(0, 11), (40, 41)], [1, 3, 4]),
        ([(0, 10), (41, 50)], []),
        ([(10, 30), (20, 40)], [0, 1, 2, 3]),  # each frame once
        ([], []),
    ],
)
def test_frames_within_spans(spans: list[tuple[int, int]], kept: list[int]) -> None:
    assert FRAMES.within(spans).can_id.tolist() == kept


def test_frames_on_buses() -> None:
    assert FRAMES.on_buses({1, 2}).can_id.tolist() == [1, 2, 4]
    assert FRAMES.on_buses({3}).can_id.tolist() == []
    assert FRAMES.on_buses(frozenset()) is FRAMES


def test_frames_of_one_time_keep_their_order() -> None:
    frames = _frames([1, 0] * 500, [0] * 1000)
    assert frames.by_time().can_id.tolist() == [*range(1, 1000, 2), *range(0, 1000, 2)]


# The checksum rules against the check values of published tables, and by long division ----------


# The catalogue of parametrised CRC algorithms lists these as check values; the sums by hand.
PUBLISHED = {
    "crc8_j1850": 0x4B,
    "crc8_j1850_zero": 0x37,
    "crc8_j1850_noxor": 0xB4,
    "crc8_8h2f": 0xDF,
    "crc8_smbus": 0xF4,
    "xor8": 0x31,
    "sum8": 0xDD,
}


def test_the_published_check_values() -> None:
    row = np.frombuffer(b"123456789", np.uint8)[None, :]
    assert {name: int(rule(row)[0]) for name, rule in CRC_RULES.items()} == PUBLISHED


def test_a_checksum_at_the_head_covers_what_follows_another_what_is_before() -> None:
    payload = np.arange(16, dtype=np.uint8).reshape(2, 8)
    assert covered(payload, 0, 6).tolist() == [[1, 2, 3, 4, 5], [9, 10, 11, 12, 13]]
    assert covered(payload, 3, 6).tolist() == [[0, 1, 2], [8, 9, 10]]
