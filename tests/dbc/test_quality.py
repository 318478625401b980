"""Checksums and ranges: what is marked, and that the value stays."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dbc import Quality, parse_codec, shipped_dbc
from dbc.crc import CRC_RULES

from .frames import block
from .polynomial import crc8_by_division

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


@settings(max_examples=50, deadline=None, derandomize=True, database=None)
@given(st.lists(st.binary(min_size=7, max_size=7), min_size=1, max_size=5))
def test_crc_is_the_remainder_of_a_division(rows: list[bytes]) -> None:
    ours = CRC_RULES["crc8_j1850"](np.frombuffer(b"".join(rows), np.uint8).reshape(-1, 7))
    assert ours.tolist() == [crc8_by_division(row) for row in rows]


def test_a_frame_too_short_for_its_checksum_is_missing_it_and_not_wrong() -> None:
    decoded = SHIPPED.decode(block([b"\x01\x02\x03"], 0x100))
    assert decoded.counts.crc_bad == 0
    assert decoded.counts.wrong_length == 1
    assert decoded["IMU_Accel.acc_x"].quality.tolist() == [0]
    assert decoded["IMU_Accel.crc"].quality.tolist() == [Quality.MISSING]
