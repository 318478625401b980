from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from dbc import parse_codec, shipped_dbc

from .databases import Field, Message, database, fields, multiplexed, parse_one
from .frames import block

SHIPPED = parse_codec(shipped_dbc(), "bumpbench.dbc")
EXAMPLES = settings(max_examples=100, deadline=None, derandomize=True, database=None)


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


@EXAMPLES
@given(multiplexed(), st.data())
def test_a_multiplexed_payload_holds_what_its_selectors_name(
    message: Message, data: st.DataObject
) -> None:
    values = {
        field.name: data.draw(st.integers(0, 7), label=field.name) for field in message.fields
    }
    codec = parse_codec(database([message]), "x.dbc")
    payload = codec.encode("Mux", {name: [value] for name, value in values.items()})
    decoded = codec.decode(block([payload.tobytes()], message.can_id, message.extended))
    used = {
        bit
        for field in message.fields
        if len(decoded[f"Mux.{field.name}"].value)
        for bit in field.bits
    }
    for field in message.fields:
        assert decoded[f"Mux.{field.name}"].value.tolist() in ([], [values[field.name]])
    set_bits = {bit for bit in range(64) if payload[0, bit // 8] >> bit % 8 & 1}
    assert set_bits <= used


def test_what_was_encoded_decodes_to_the_nearest_step() -> None:
    rng = np.random.default_rng(3)
    sent = {name: rng.uniform(-30, 30, 500) for name in ("acc_x", "acc_y", "acc_z")}
    frames = [row.tobytes() for row in SHIPPED.encode("IMU_Accel", sent)]
    decoded = SHIPPED.decode(block(frames, 0x100))
    assert decoded.counts.crc_bad == 0
    for name, value in sent.items():
        assert np.abs(decoded[f"IMU_Accel.{name}"].value - value).max() <= 0.0005 * (1 + 1e-9)


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


def test_a_multiplexed_signal_needs_its_selector() -> None:
    text = (
        'VERSION ""\n\nBU_: A\n\nBO_ 5 M: 2 A\n'
        ' SG_ top M : 0|8@1+ (1,0) [0|0] "" A\n SG_ s m1 : 8|8@1+ (1,0) [0|0] "" A\n'
    )
    with pytest.raises(ValueError, match=r"M\.s needs its selector top"):
        parse_codec(text, "x.dbc").encode("M", {"s": [1]})
