"""Converts values of a message's signals to payloads, for the simulated sensors."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .crc import CRC_RULES, covered
from .layout import MessageLayout, SignalLayout


def encode_message(
    layout: MessageLayout, values: Mapping[str, ArrayLike], counter_start: int
) -> NDArray[np.uint8]:
    """Return the payloads of n frames; see `Codec.encode`."""
    columns = {name: np.asarray(value) for name, value in values.items()}
    filled = {layout.crc, layout.counter.signal if layout.counter else None}
    for name in columns:
        if name in filled:
            raise ValueError(f"{layout.name}.{name} is filled in here and cannot be given")
        layout.signal(name)
    shapes = {column.shape for column in columns.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1:
        raise ValueError(f"the signals of {layout.name} must be arrays of one length")
    (n,) = shapes.pop()
    if layout.counter is not None:
        columns[layout.counter.signal] = (counter_start + np.arange(n)) % layout.counter.modulus
    raw = {name: _raw(layout, layout.signal(name), column) for name, column in columns.items()}
    payload = np.zeros((n, 8 if layout.length <= 8 else 64), np.uint8)
    for name, bits in raw.items():
        signal = layout.signal(name)
        sent = np.where(_present(layout, signal, raw, n), bits, np.uint64(0))
        for byte in range(signal.first_byte, signal.last_byte + 1):  # bits that are set stay set
            steps = signal.last_byte - byte if signal.is_big_endian else byte - signal.first_byte
            down = 8 * steps - signal.low_bit
            part = sent >> np.uint64(down) if down >= 0 else sent << np.uint64(-down)
            payload[:, byte] |= (part & np.uint64(0xFF)).astype(np.uint8)
    if layout.crc is not None:
        byte = layout.signal(layout.crc).first_byte
        payload[:, byte] = CRC_RULES[layout.crc_rule](covered(payload, byte, layout.length))
    return payload


def _raw(
    layout: MessageLayout, signal: SignalLayout, value: NDArray[np.generic]
) -> NDArray[np.uint64]:
    """Return the signal's bits, as the nearest raw value."""
    where = f"{layout.name}.{signal.name}"
    scaled = (value.astype(np.float64) - signal.offset) / signal.factor
    if signal.is_float:
        bits: NDArray[np.uint64] = (
            scaled.astype(f"f{signal.length // 8}").view(f"u{signal.length // 8}").astype(np.uint64)
        )
        return bits
    nearest = np.rint(scaled)
    low, high = signal.raw_range
    if not np.all((nearest >= low) & (nearest < high + 1)):
        lowest, highest = signal.span
        raise ValueError(
            f"{where} cannot hold {value.min()} .. {value.max()}, only {lowest} .. {highest}"
        )
    whole = nearest.astype(np.int64 if signal.is_signed else np.uint64).view(np.uint64)
    return whole & np.uint64((1 << signal.length) - 1)


def _present(
    layout: MessageLayout, signal: SignalLayout, raw: Mapping[str, NDArray[np.uint64]], n: int
) -> NDArray[np.bool_]:
    """Return a mask of the frames whose selectors, at every level, name this signal."""
    present = np.ones(n, np.bool_)
    while signal.selector is not None:
        if signal.selector not in raw:
            raise ValueError(f"{layout.name}.{signal.name} needs its selector {signal.selector}")
        selector = raw[signal.selector]
        present &= np.logical_or.reduce(
            [(selector >= low) & (selector <= high) for low, high in signal.selected_by]
        )
        signal = layout.signal(signal.selector)
    return present
