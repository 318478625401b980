"""A message that belongs to one bus is decoded from that bus alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dbc import Codec, parse_codec

from .frames import block

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
