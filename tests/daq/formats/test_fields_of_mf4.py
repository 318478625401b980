"""Numbers in records of MDF 4: places, byte orders, signs, conversions, by ASAM's description."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from daq.formats.mdf4_layout import Field

NUMBERS: list[tuple[Field, str, float]] = [
    (Field(0, 0, 8, 0), "fe01", 0xFE),
    (Field(1, 0, 8, 0), "fe01", 1),
    (Field(0, 3, 5, 0), "f8ff", 31),
    (Field(0, 3, 5, 0), "07ff", 0),
    (Field(0, 4, 8, 0), "5012", 0x25),
    (Field(0, 0, 16, 0), "0102", 0x0201),
    (Field(0, 0, 16, 1), "0102", 0x0102),
    (Field(1, 4, 8, 1), "000123ff", 0x12),
    (Field(0, 0, 64, 0), "0102030405060708", 0x0807060504030201),
    (Field(0, 0, 63, 0), "ffffffffffffffff", (1 << 63) - 1),
    (Field(0, 1, 63, 0), "feffffffffffffff", (1 << 63) - 1),
    (Field(0, 0, 8, 2), "ff", -1),
    (Field(0, 0, 8, 2), "7f", 127),
    (Field(0, 0, 16, 3), "fffe", -2),
    (Field(0, 2, 3, 2), "10", -4),
    (Field(0, 0, 64, 2), "feffffffffffffff", -2),
    (Field(0, 0, 32, 4), "0000c03f", 1.5),
    (Field(0, 0, 32, 5), "3fc00000", 1.5),
    (Field(0, 0, 64, 4), "000000000000f83f", 1.5),
    (Field(0, 0, 64, 5), "3ff8000000000000", 1.5),
    (Field(1, 0, 32, 4), "ff0000c03fff", 1.5),
    (Field(0, 0, 0, 0), "ff", 0),
]


@pytest.mark.parametrize(("field", "record", "number"), NUMBERS)
def test_the_number_in_a_record(field: Field, record: str, number: float) -> None:
    assert field.raw(
        np.frombuffer(bytes.fromhex(record) * 2, np.uint8).reshape(2, -1)
    ).tolist() == [
        number,
        number,
    ]


@pytest.mark.parametrize(
    ("bit", "bits", "end"), [(0, 8, 4), (0, 9, 5), (1, 7, 4), (1, 8, 5), (7, 1, 4), (0, 0, 3)]
)
def test_the_first_byte_behind_a_number(bit: int, bits: int, end: int) -> None:
    assert Field(3, bit, bits, 0).end == end


@pytest.mark.parametrize(
    ("offset", "factor", "raw", "value"),
    [(0.0, 1.0, 7, 7), (0.0, 2.0, 7, 14), (3.0, 1.0, 7, 10), (1.0, 0.25, 7, 3), (-8.0, 1.0, 7, -1)],
)
def test_a_linear_conversion(offset: float, factor: float, raw: int, value: int) -> None:
    field = Field(0, 0, 8, 0, offset, factor)
    assert field.whole(np.array([[raw]], np.uint8)).tolist() == [value]


def test_a_conversion_by_a_table_takes_the_value_of_the_largest_number_that_is_not_above() -> None:
    field = Field(0, 0, 8, 0, table=((2.0, 20.0), (5.0, 50.0), (9.0, 64.0)))
    records = np.array([[0], [1], [2], [4], [5], [8], [9], [10]], np.uint8)
    assert field.whole(records).tolist() == [20, 20, 20, 20, 50, 50, 64, 64]


def test_a_floating_point_number_as_a_whole_one() -> None:
    record = np.frombuffer(struct.pack("<f", 291.0), np.uint8).reshape(1, 4)
    assert Field(0, 0, 32, 4).whole(record).tolist() == [291]
