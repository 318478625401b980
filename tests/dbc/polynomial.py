"""CRC-8 SAE J1850 by long division of polynomials, as the standard defines it."""

from __future__ import annotations

DIVISOR = 0x11D


def crc8_by_division(payload: bytes) -> int:
    """Return the remainder of the inverted first byte and the rest, inverted."""
    if not payload:
        return 0
    dividend = int.from_bytes(bytes([payload[0] ^ 0xFF]) + payload[1:] + b"\0", "big")
    for bit in reversed(range(8, 8 * len(payload) + 8)):
        if dividend >> bit & 1:
            dividend ^= DIVISOR << bit - 8
    return dividend ^ 0xFF
