"""Converts frames of one message to samples: scaling, multiplexing, length, checksum, range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .crc import CRC_RULES, covered
from .extract import FieldReader, compile_reader
from .frames import read_only
from .layout import MessageLayout, SignalLayout
from .samples import Quality, Samples


@dataclass(frozen=True, slots=True)
class MessageReader:
    """A message with the readers of its signals."""

    layout: MessageLayout
    """The message."""
    width: int
    """Width of the payloads it reads, 8 or 64 bytes."""
    readers: tuple[FieldReader, ...]
    """Readers, in the order of `layout.signals`."""
    ranges: tuple[tuple[float, float] | None, ...]
    """Lowest and highest valid value of each signal whose bits can express values outside that
    range."""


@dataclass(frozen=True, slots=True)
class MessageFrames:
    """The frames of one message in a block, in order of arrival."""

    t_ns: NDArray[np.int64]
    """Time stamps, shape (n,)."""
    payload: NDArray[np.uint8]
    """Payloads, of the width of the message's reader."""
    length: NDArray[np.uint8]
    """Number of bytes received, shape (n,)."""

    def select(self, rows: NDArray[np.intp]) -> MessageFrames:
        """Return some of the frames."""
        return MessageFrames(self.t_ns[rows], self.payload[rows], self.length[rows])


def compile_message(layout: MessageLayout) -> MessageReader:
    """Compile the readers of all signals of a message."""
    width = 8 if layout.length <= 8 else 64
    readers = tuple(compile_reader(signal, width) for signal in layout.signals)
    return MessageReader(layout, width, readers, tuple(map(_range, layout.signals)))


def decode_message(reader: MessageReader, frames: MessageFrames) -> tuple[dict[str, Samples], int]:
    """Decode all signals of frames that carry the same message.

    Returns samples by `Message.signal` (a multiplexed signal only in frames whose selector names
    it) and the number of frames of the right length whose checksum does not match.
    """
    layout = reader.layout
    bad = _crc_misfit(layout, frames)
    quality = bad.view(np.uint8) * np.uint8(Quality.CRC_BAD)
    shortest = int(frames.length.min())
    selected = _selected_rows(reader, frames)
    t_ns = read_only(frames.t_ns)  # one array: what depends on it alone is computed once
    samples = {}
    for field, valid in zip(reader.readers, reader.ranges, strict=True):
        signal = field.layout
        rows = selected.get(signal.name)
        part = frames if rows is None else frames.select(rows)
        raw = field.raw(part.payload)
        value = field.scale(raw)
        marks = quality if rows is None else quality[rows]
        if signal.sentinels:
            marked = np.array(signal.sentinels, raw.dtype.newbyteorder("="))
            named = np.isin(raw, marked, kind="sort")  # NumPy 2.0's table cannot hold 2^64 - 1
            value[named] = np.nan
            marks = _mark(marks, named, Quality.SENTINEL)
        if valid is not None:
            outside = (value < valid[0]) | (value > valid[1])
            marks = _mark(marks, outside, Quality.OUT_OF_RANGE)
        if shortest <= signal.last_byte:
            cut = part.length <= signal.last_byte
            value[cut] = np.nan
            false = Quality.OUT_OF_RANGE | Quality.SENTINEL  # from bits that were not received
            marks = _mark(marks & ~(cut * np.uint8(false)), cut, Quality.MISSING)
        name = f"{layout.name}.{signal.name}"
        own_ns = t_ns if rows is None else read_only(part.t_ns)
        samples[name] = Samples(name, own_ns, read_only(value), read_only(marks))
    return samples, int(np.count_nonzero(bad & (frames.length == layout.length)))


def _mark(quality: NDArray[np.uint8], where: NDArray[np.bool_], bit: Quality) -> NDArray[np.uint8]:
    return quality | where.view(np.uint8) * np.uint8(bit) if where.any() else quality


def _crc_misfit(layout: MessageLayout, frames: MessageFrames) -> NDArray[np.bool_]:
    """Return a mask of the frames that hold a checksum that does not match."""
    if layout.crc is None:
        return np.zeros(len(frames.t_ns), np.bool_)
    byte = layout.signal(layout.crc).first_byte
    computed = CRC_RULES[layout.crc_rule](covered(frames.payload, byte, layout.length))
    misfit: NDArray[np.bool_] = (computed != frames.payload[:, byte]) & (frames.length > byte)
    return misfit


def _selected_rows(reader: MessageReader, frames: MessageFrames) -> dict[str, NDArray[np.intp]]:
    """Find the frames that hold each multiplexed signal, by name; selectors may be nested."""
    fields = {field.layout.name: field for field in reader.readers}
    present: dict[str, NDArray[np.bool_]] = {}

    def presence(signal: SignalLayout) -> NDArray[np.bool_]:
        if signal.selector is None:
            return np.ones(len(frames.t_ns), np.bool_)
        if signal.name not in present:
            selector = fields[signal.selector]
            raw = selector.raw(frames.payload)
            chosen = np.zeros(len(raw), np.bool_)
            for low, high in signal.selected_by:
                chosen |= (raw >= low) & (raw <= high)
            readable = frames.length > selector.layout.last_byte
            present[signal.name] = chosen & readable & presence(selector.layout)
        return present[signal.name]

    multiplexed = (signal for signal in reader.layout.signals if signal.is_multiplexed)
    return {signal.name: np.flatnonzero(presence(signal)) for signal in multiplexed}


def _range(signal: SignalLayout) -> tuple[float, float] | None:
    low, high = signal.minimum, signal.maximum
    if low is None or high is None or low >= high:
        return None
    lowest, highest = signal.span
    return None if low <= lowest and highest <= high else (low, high)
