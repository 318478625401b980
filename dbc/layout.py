"""Defines messages and signals, as a DBC describes them, as plain data."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class CounterRule:
    """A counter that grows by one with each frame of a message."""

    signal: str
    """Name of the signal in its message."""
    modulus: int
    """Number of values: the counter runs from 0 to modulus - 1 and starts again."""


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Position of a signal in the payload, and the meaning of its bits."""

    name: str
    unit: str
    """Unit as in the DBC; may be empty."""
    start: int
    """Start bit as in the DBC: the lowest bit of an Intel signal, the highest of a Motorola one,
    counted as 8 * byte + bit."""
    length: int
    """Number of bits, 1..64."""
    is_big_endian: bool
    """True for Motorola byte order."""
    is_signed: bool
    """True for two's complement."""
    is_float: bool
    """True for an IEEE 754 number of 16, 32 or 64 bits."""
    factor: int | float
    offset: int | float
    """value = raw * factor + offset.  Whole numbers stay `int`, because arithmetic with them is
    exact."""
    minimum: float | None
    """Lowest valid value in `unit`; None where the DBC states none."""
    maximum: float | None
    """Highest valid value in `unit`; None where the DBC states none."""
    selector: str | None
    """Name of the multiplexer signal that decides whether this signal is in a frame."""
    selected_by: tuple[tuple[int, int], ...]
    """Inclusive ranges of the selector's raw value for which the signal is in the frame."""
    sentinels: tuple[int, ...]
    """Raw values that are not measurements, see `dbc.database`."""

    @property
    def is_multiplexed(self) -> bool:
        """True if only some frames of the message hold this signal."""
        return self.selector is not None

    @property
    def is_plain(self) -> bool:
        """True if its value is the raw number, unsigned and whole, and in every frame."""
        as_it_is = (self.factor, self.offset) == (1, 0) and not self.is_float
        return as_it_is and not self.is_signed and not self.is_multiplexed

    @property
    def limits(self) -> tuple[float, float] | None:
        """The lowest and the highest valid value, if the bits can express values outside them."""
        low, high = self.minimum, self.maximum
        if low is None or high is None or low >= high:
            return None
        lowest, highest = self.span
        return None if low <= lowest and highest <= high else (low, high)

    @property
    def first_byte(self) -> int:
        """The lowest byte of the payload that holds a bit of the signal."""
        return self.start // 8

    @property
    def first_bit(self) -> int:
        """The first bit of the signal, counted in the order in which the bits are sent."""
        if self.is_big_endian:
            return 8 * (self.start // 8) + 7 - self.start % 8
        return self.start

    @property
    def last_byte(self) -> int:
        """The highest byte of the payload that holds a bit of the signal."""
        return (self.first_bit + self.length - 1) // 8

    @property
    def low_bit(self) -> int:
        """The position of the signal's lowest bit in the byte that holds it, 0..7."""
        if self.is_big_endian:
            return 7 - (7 - self.start % 8 + self.length - 1) % 8
        return self.start % 8

    @property
    def raw_range(self) -> tuple[int, int]:
        """The lowest and the highest raw value of an integer signal."""
        if self.is_signed:
            return -(1 << (self.length - 1)), (1 << (self.length - 1)) - 1
        return 0, (1 << self.length) - 1

    @property
    def span(self) -> tuple[float, float]:
        """The lowest and the highest value, in `unit`, that the bits can express."""
        if self.is_float:
            return float("-inf"), float("inf")
        ends = [float(raw * self.factor + self.offset) for raw in self.raw_range]
        return min(ends), max(ends)


@dataclass(frozen=True, slots=True)
class MessageLayout:
    """One message of a DBC."""

    name: str
    """Name, unique in the codec; on a bench with a list of sensors it begins with the sensor's name
    and a dot."""
    can_id: int
    """Identifier of 11 or 29 bits, without flag bits."""
    is_extended: bool
    """True if `can_id` has 29 bits.  The pair decides; equal numbers may be different messages."""
    length: int
    """Number of payload bytes, 0..64."""
    cycle_s: float | None
    """Time between two frames, s; None where the DBC states none."""
    signals: tuple[SignalLayout, ...]
    """Signals, in the order of their bits in the DBC."""
    counter: CounterRule | None
    """The signal that the DBC marks as rolling counter."""
    crc: str | None
    """The signal that holds the checksum of one byte (`dbc.layout.covered`)."""
    senders: tuple[str, ...]
    """Nodes that send the message."""
    crc_rule: str = "crc8_j1850"
    """Rule by which the checksum is computed, a name in `dbc.layout.CRC_RULES`."""
    bus: int | None = None
    """Number of the only bus on which frames with this identifier are this message; None: any
    bus."""

    def signal(self, name: str) -> SignalLayout:
        """Return the signal called `name`; raises KeyError if the message has none."""
        for signal in self.signals:
            if signal.name == name:
                return signal
        raise KeyError(f"message {self.name} has no signal {name}")


# Checksums of one byte ----------------------------------------------------------------------------


Checksum = Callable[[NDArray[np.uint8]], NDArray[np.uint8]]
"""Returns the checksum of each row of (n, m) bytes, (n,)."""


def _crc8(polynomial: int, initial: int, final_xor: int) -> Checksum:
    """Return the function from payloads, (n, bytes), to their 8-bit CRCs, (n,), unreflected."""
    table = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        table = np.where(table & 0x80, (table << 1) ^ polynomial, table << 1)
    crc_of_byte = (table & 0xFF).astype(np.uint8)

    def checksum(payload: NDArray[np.uint8]) -> NDArray[np.uint8]:
        crc = np.full(len(payload), initial, np.uint8)
        for column in range(payload.shape[1]):
            crc = crc_of_byte[crc ^ payload[:, column]]
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
