"""The checksum rules against the check values of published tables, and by long division."""

import numpy as np
import pytest
from numpy.typing import NDArray

from dbc.crc import CRC_RULES, covered

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
