"""Converts payload bytes to numbers: the bits of one signal, over all frames of a block at once.

A `FieldReader` is compiled once for each signal.  Fields that are whole bytes (most sensors) are
read through a typed view of the payload, in one pass; others by shifting a 64-bit window; only a
field that touches nine bytes needs two reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .layout import SignalLayout

_EXACT = 1 << 53
"""Largest whole number up to which all whole numbers are exact in float64."""


@dataclass(frozen=True, slots=True)
class FieldReader:
    """Reads one signal from payloads of a fixed width."""

    layout: SignalLayout
    """The signal."""
    view: np.dtype[np.generic]
    """Type to read, with its byte order: that of the field itself, or of a window of 8 bytes around
    it."""
    byte: int
    """Position of that type in the payload, bytes."""
    shift: int | None
    """Lowest bit of the field in the window; None if `view` is the field itself; negative if the
    field continues in the byte after the window."""
    arithmetic: np.dtype[np.generic]
    """Type in which raw * factor (+ offset) is exact or rounds as Python's numbers do."""

    def raw(self, payload: NDArray[np.uint8]) -> NDArray[Any]:
        """Return the raw numbers of the signal.

        `payload`, (n, 8) or (n, 64) uint8, contiguous: the width for which the reader was compiled.
        Returns (n,) array: signed or unsigned integers, or floats, of any width and byte order.
        """
        n, width = payload.shape
        if n == 0:
            return np.zeros(0, np.int64)
        window = np.ndarray((n,), self.view, payload.data, self.byte, (width,))
        if self.shift is None:
            return window
        layout = self.layout
        down = np.uint64(64 - layout.length)
        if self.shift < 0:
            beyond = payload[:, self.byte + 8].astype(np.uint64)
            bits = _join(window.astype(np.uint64), beyond, layout) << down
        else:
            bits = window << np.uint64(64 - layout.length - self.shift)
        if layout.is_float:
            whole = (bits >> down).astype(f"u{layout.length // 8}")
            return whole.view(f"f{layout.length // 8}")
        if layout.is_signed:
            return bits.view(np.int64) >> np.int64(down)
        return bits >> down

    def scale(self, raw: NDArray[Any]) -> NDArray[np.float64]:
        """Return raw * factor + offset, rounded as Python's number arithmetic rounds.

        `raw`, (n,) array: result of `raw()`.  Returns (n,) float64: a new array, in the unit of the
        DBC.
        """
        layout = self.layout
        factor, offset = layout.factor, layout.offset
        if self.arithmetic != np.float64:
            exact = raw.astype(self.arithmetic) * factor
            if isinstance(offset, int):
                return (exact + offset).astype(np.float64)
            return exact.astype(np.float64) + offset
        value = raw.astype(np.float64)
        if factor == 1 and offset == 0:
            return value
        value *= float(factor)
        if offset != 0 or factor < 0 or layout.is_float:  # otherwise adding 0 changes no bit
            value += float(offset)
        return value


def compile_reader(layout: SignalLayout, width: int) -> FieldReader:
    """Choose the fastest way to read a signal from payloads of `width` bytes, 8 or 64."""
    first, last = layout.first_byte, layout.last_byte
    order = ">" if layout.is_big_endian else "<"
    arithmetic = _arithmetic(layout)
    if layout.low_bit == 0 and layout.length in (8, 16, 32, 64):
        kind = "f" if layout.is_float else "i" if layout.is_signed else "u"
        view = np.dtype(f"{order}{kind}{layout.length // 8}")
        return FieldReader(layout, view, first, None, arithmetic)
    byte = min(first, width - 8)
    if layout.is_big_endian:
        shift = 8 * (byte + 7 - last) + layout.low_bit
    else:
        shift = 8 * (first - byte) + layout.low_bit
    if last - byte > 7:
        shift = -1
    return FieldReader(layout, np.dtype(f"{order}u8"), byte, shift, arithmetic)


def _join(
    window: NDArray[np.uint64], beyond: NDArray[np.uint64], layout: SignalLayout
) -> NDArray[np.uint64]:
    """Join a field of nine bytes; the caller's shift removes the bits above the field."""
    low, high = np.uint64(layout.low_bit), np.uint64(8 - layout.low_bit)
    if layout.is_big_endian:
        return window << high | beyond >> low
    return window >> low | beyond << np.uint64(64 - layout.low_bit)


def _arithmetic(layout: SignalLayout) -> np.dtype[np.generic]:
    """Return the cheapest type with the same results as Python's int and float arithmetic."""
    factor, offset = layout.factor, layout.offset
    if layout.is_float or not isinstance(factor, int) or (factor == 1 and offset == 0):
        return np.dtype(np.float64)
    largest = max(abs(raw) for raw in layout.raw_range) * max(abs(factor), 1)
    if isinstance(offset, int):
        largest += abs(offset)
    if largest <= _EXACT:
        return np.dtype(np.float64)
    return np.dtype(np.int64) if largest < 1 << 63 else np.dtype(object)
