"""One-byte checksums of sensor frames, over columns of bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Crc8:
    """A CRC of 8 bits, most significant bit first, neither input nor output reflected."""

    polynomial: int
    """Generator polynomial, as catalogues of CRC algorithms list it."""
    initial: int
    """Register before the first byte."""
    final_xor: int
    """Exclusive-or of the register after the last byte."""

    def __call__(self, payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return the checksum of each row of (n, m) bytes, (n,)."""
        table = _TABLES[self.polynomial]
        crc = np.full(len(payload), self.initial, np.uint8)
        for column in range(payload.shape[1]):
            crc = table[crc ^ payload[:, column]]
        return crc ^ np.uint8(self.final_xor)


def _table(polynomial: int) -> NDArray[np.uint8]:
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 0x80, (table << 1) ^ polynomial, table << 1)
    return (table & 0xFF).astype(np.uint8)


_TABLES = {polynomial: _table(polynomial) for polynomial in (0x07, 0x1D, 0x2F)}

crc8_j1850 = Crc8(0x1D, 0xFF, 0xFF)


def xor8(payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the exclusive or of all bytes of each row."""
    return np.asarray(np.bitwise_xor.reduce(payload, axis=1), dtype=np.uint8)


def sum8(payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the sum of all bytes of each row, modulo 256."""
    return np.asarray(np.sum(payload, axis=1, dtype=np.uint8), dtype=np.uint8)


Checksum = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]

CRC_RULES: Mapping[str, Checksum] = MappingProxyType(
    {
        "crc8_j1850": crc8_j1850,
        "crc8_j1850_zero": Crc8(0x1D, 0x00, 0x00),
        "crc8_j1850_noxor": Crc8(0x1D, 0xFF, 0x00),
        "crc8_8h2f": Crc8(0x2F, 0xFF, 0xFF),
        "crc8_smbus": Crc8(0x07, 0x00, 0x00),
        "xor8": xor8,
        "sum8": sum8,
    }
)
"""Rules by name: SAE J1850 and its variants (start 0; no final XOR), the 0x2F polynomial of
AUTOSAR, the CRC of SMBus, and the two plain sums."""


def covered(payload: NDArray[np.uint8], byte: int, length: int) -> NDArray[np.uint8]:
    """Return the bytes that a checksum in `byte` covers.

    A checksum in the first byte of a message of `length` bytes covers all bytes after it; in any
    other byte it covers the bytes before it.
    """
    return payload[:, 1:length] if byte == 0 else payload[:, :byte]
