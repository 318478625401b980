"""One-byte checksums of sensor frames, over columns of bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

Checksum = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
"""Returns the checksum of each row of (n, m) bytes, (n,)."""


def _crc8(polynomial: int, initial: int, final_xor: int) -> Checksum:
    """Return a CRC of 8 bits, most significant bit first, neither input nor output reflected."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 0x80, (table << 1) ^ polynomial, table << 1)
    steps = (table & 0xFF).astype(np.uint8)

    def checksum(payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
        crc = np.full(len(payload), initial, np.uint8)
        for column in range(payload.shape[1]):
            crc = steps[crc ^ payload[:, column]]
        return crc ^ np.uint8(final_xor)

    return checksum


CRC_RULES: Mapping[str, Checksum] = MappingProxyType(
    {
        "crc8_j1850": _crc8(0x1D, 0xFF, 0xFF),
        "crc8_j1850_zero": _crc8(0x1D, 0x00, 0x00),
        "crc8_j1850_noxor": _crc8(0x1D, 0xFF, 0x00),
        "crc8_8h2f": _crc8(0x2F, 0xFF, 0xFF),
        "crc8_smbus": _crc8(0x07, 0x00, 0x00),
        "xor8": lambda payload: np.asarray(np.bitwise_xor.reduce(payload, axis=1), np.uint8),
        "sum8": lambda payload: np.asarray(np.sum(payload, axis=1, dtype=np.uint8)),
    }
)
"""Rules by name: SAE J1850 and its variants (start 0; no final XOR), the 0x2F polynomial of
AUTOSAR, the CRC of SMBus, and the exclusive or and the sum modulo 256 of all bytes."""


def covered(payload: NDArray[np.uint8], byte: int, length: int) -> NDArray[np.uint8]:
    """Return the bytes that a checksum in `byte` covers.

    A checksum in the first byte of a message of `length` bytes covers all bytes after it; in any
    other byte it covers the bytes before it.
    """
    return payload[:, 1:length] if byte == 0 else payload[:, :byte]
