from __future__ import annotations

import math

import numpy as np
import pytest
from cantools.database.errors import DecodeError
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from dbc import FrameFlag, Quality, parse_codec, shipped_dbc

from .databases import (
    Field,
    Message,
    block,
    database,
    fields,
    messages,
    multiplexed,
    parse_one,
    payloads,
)

EXAMPLES = settings(max_examples=60, deadline=None, derandomize=True, database=None)


def same(ours: float, theirs: float) -> bool:
    """Return True if two numbers are the same float64, NaN being NaN.

    Beyond 2^53 cantools computes with whole numbers, and rounds once less.
    """
    if abs(theirs) > 1 << 53:
        return math.isclose(ours, float(theirs), rel_tol=1e-15)
    return ours == float(theirs) or (math.isnan(ours) and math.isnan(theirs))


@EXAMPLES
@given(st.data())
def test_every_kind_of_signal_equals_cantools_bit_for_bit(data: st.DataObject) -> None:
    message = data.draw(messages("M", 0x55, extended=False))
    sent = data.draw(st.lists(payloads(message.length), min_size=1, max_size=6))
    codec = parse_codec(database([message]), "random.dbc")
    decoded = codec.decode(block(sent, 0x55, width=data.draw(st.sampled_from((8, 64)))))
    for field in message.fields:
        oracle = parse_one(message, field)
        ours = decoded[f"M.{field.name}"]
        for value, payload in zip(ours.value.tolist(), sent, strict=True):
            theirs = oracle.decode(payload, decode_choices=False)[field.name]
            assert same(value, theirs), (field, payload)
        assert not ours.quality.any()


@EXAMPLES
@given(st.data())
def test_frames_of_any_length_give_the_signals_that_fit(data: st.DataObject) -> None:
    message = data.draw(messages("M", 0x55, extended=True))
    sizes = st.integers(0, 64).flatmap(payloads)
    sent = data.draw(st.lists(sizes, min_size=1, max_size=6))
    codec = parse_codec(database([message]), "random.dbc")
    decoded = codec.decode(block(sent, 0x55, extended=True))
    for field in message.fields:
        oracle = parse_one(message, field)
        ours = decoded[f"M.{field.name}"]
        for value, quality, payload in zip(ours.value, ours.quality, sent, strict=True):
            theirs = oracle.decode(payload, decode_choices=False, allow_truncated=True)
            if field.name in theirs:
                assert same(float(value), theirs[field.name])
                assert quality == 0
            else:
                assert math.isnan(value)
                assert quality == Quality.MISSING
    wrong = sum(len(payload) != message.length for payload in sent)
    assert decoded.counts.wrong_length == wrong


@settings(EXAMPLES, max_examples=25)
@given(st.data())
def test_identifier_and_its_kind_decide_together(data: st.DataObject) -> None:
    known = [
        data.draw(messages(f"M{i}", can_id, extended=extended))
        for i, (can_id, extended) in enumerate(
            [(0x64, False), (0x64, True), (0x7FF, False), (0x1FFFFFFF, True)]
        )
    ]
    by_key = {(m.can_id, m.extended): m for m in known}
    keys = st.sampled_from([*by_key, (0x65, False), (0x65, True), (0x7FF, True), (0x800, False)])
    kinds = st.sampled_from((0, 0, 0, FrameFlag.ERROR, FrameFlag.REMOTE, FrameFlag.FD))
    frames = data.draw(st.lists(st.tuples(keys, kinds, payloads(64)), min_size=1, max_size=12))
    codec = parse_codec(database(known), "random.dbc")
    decoded = codec.decode(
        block(
            [payload for _, _, payload in frames],
            [key[0] for key, _, _ in frames],
            [key[1] for key, _, _ in frames],
            [int(kind) for _, kind, _ in frames],
        )
    )
    lost = FrameFlag.ERROR | FrameFlag.REMOTE
    for message in known:
        oracles = {field.name: parse_one(message, field) for field in message.fields}
        carried = [
            (i, payload)
            for i, (key, kind, payload) in enumerate(frames)
            if key == (message.can_id, message.extended) and not kind & lost
        ]
        for name, oracle in oracles.items():
            channel = f"{message.name}.{name}"
            assert (channel in decoded.samples) == bool(carried)
            if carried:
                assert decoded[channel].t_ns.tolist() == [1000 * i for i, _ in carried]
                for value, (_, payload) in zip(decoded[channel].value, carried, strict=True):
                    assert same(float(value), oracle.decode(payload, decode_choices=False)[name])
    assert decoded.counts.error_frames == sum(kind == FrameFlag.ERROR for _, kind, _ in frames)
    assert decoded.counts.remote_frames == sum(kind == FrameFlag.REMOTE for _, kind, _ in frames)
    unknown = sum(key not in by_key and not kind & lost for key, kind, _ in frames)
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


@EXAMPLES
@given(multiplexed(), st.lists(payloads(8), min_size=1, max_size=8))
def test_multiplexed_signals_exist_where_their_selectors_say_so(
    message: Message, sent: list[bytes]
) -> None:
    codec = parse_codec(database([message]), "random.dbc")
    decoded = codec.decode(block(sent, message.can_id, message.extended))
    whole = parse_one(message)
    rows: dict[str, dict[int, float]] = {}
    for field in message.fields:
        ours = decoded[f"Mux.{field.name}"]
        stamps = (ours.t_ns // 1000).tolist()
        assert stamps == [i for i, payload in enumerate(sent) if held(message, field, payload)]
        rows[field.name] = dict(zip(stamps, ours.value.tolist(), strict=True))
    for i, payload in enumerate(sent):
        try:
            theirs = whole.decode(payload, decode_choices=False)
        except DecodeError:
            continue  # cantools gives up on a frame with an undefined selector
        assert {name: values[i] for name, values in rows.items() if i in values} == theirs


SHIPPED = parse_codec(shipped_dbc(), "bumpbench.dbc")


def exact(field: Field) -> bool:
    """Return True if raw values up to 2**40 and their scaling are exact, or nearly so."""
    return abs(float(field.offset)) < 1e6


@EXAMPLES
@given(st.data())
def test_payloads_equal_those_of_cantools(data: st.DataObject) -> None:
    length = data.draw(st.sampled_from((1, 3, 8, 16, 64)))
    field = data.draw(fields("s", length).filter(exact))
    low = -(1 << field.length - 1) if field.sign == "-" or field.float_type else 0
    high = low + (1 << field.length) - 1
    limit = 1000 if field.float_type else 1 << 40
    raw = st.integers(max(low, -limit), min(high, limit))
    message = Message("M", 0x55, False, length, (field,))
    oracle = parse_one(message)
    scale = oracle.signals[0].conversion.raw_to_scaled
    values = [float(scale(number)) for number in data.draw(st.lists(raw, min_size=1, max_size=5))]
    ours = parse_codec(database([message]), "x.dbc").encode("M", {"s": np.array(values)})
    for row, value in zip(ours, values, strict=True):
        theirs = oracle.encode({"s": value}, strict=False)
        assert row.tobytes() == theirs.ljust(8 if length <= 8 else 64, b"\0")


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"acc_x": [32.768]}, r"acc_x cannot hold 32\.768"),
        ({"acc_x": [-32.769]}, "acc_x cannot hold"),
        ({"acc_x": [float("nan")]}, "acc_x cannot hold"),
        ({"acc_x": [1.0], "acc_y": [1.0, 2.0]}, "one length"),
        ({"acc_x": [[1.0]]}, "one length"),
        ({}, "one length"),
        ({"counter": [1]}, "filled in here"),
        ({"crc": [1]}, "filled in here"),
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
