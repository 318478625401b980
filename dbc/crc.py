"""CRC-8 SAE J1850 over columns of bytes: the checksum of sensor frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

POLYNOMIAL = 0x1D
INITIAL = 0xFF
FINAL_XOR = 0xFF


def _table() -> NDArray[np.uint8]:
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 0x80, (table << 1) ^ POLYNOMIAL, table << 1)
    return (table & 0xFF).astype(np.uint8)


_TABLE = _table()


def crc8_j1850(payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the CRC-8 of each row.

    Parameters
    ----------
    payload : (n, m) uint8
        The bytes that the checksum covers, one frame a row.

    Returns
    -------
    (n,) uint8
        SAE J1850: polynomial 0x1D, start 0xFF, final XOR 0xFF, not reflected.
    """
    crc = np.full(len(payload), INITIAL, np.uint8)
    for column in range(payload.shape[1]):
        crc = _TABLE[crc ^ payload[:, column]]
    return crc ^ np.uint8(FINAL_XOR)
