"""Checksums and ranges: what is marked, and that the value stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc import Codec, FrameBatch, Quality, parse_codec, shipped_dbc
from dbc.layout import CRC_RULES, covered

from .databases import block, crc8_by_division

SHIPPED = parse_codec(shipped_dbc(), "bumpbench.dbc")


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


# A message that belongs to one bus is decoded from that bus alone -------------------------------


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


CHECK = b"123456789"

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


def _row(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, np.uint8)[None, :]


@pytest.mark.parametrize("name", CRC_RULES)
def test_the_published_check_value(name: str) -> None:
    assert CRC_RULES[name](_row(CHECK)).tolist() == [PUBLISHED[name]]


def test_a_checksum_at_the_head_covers_what_follows_another_what_is_before() -> None:
    payload = np.arange(16, dtype=np.uint8).reshape(2, 8)
    assert covered(payload, 0, 6).tolist() == [[1, 2, 3, 4, 5], [9, 10, 11, 12, 13]]
    assert covered(payload, 3, 6).tolist() == [[0, 1, 2], [8, 9, 10]]
