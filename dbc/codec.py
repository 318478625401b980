"""Decodes and encodes blocks of frames with the messages of one or several databases.

A signal is read over all frames of a message at once: whole bytes (most sensors) through a typed
view of the payload, others by shifting a window of 64 bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .frames import FrameBatch, FrameFlag, read_only
from .layout import CRC_RULES, MessageLayout, SignalLayout, covered
from .words import Finding


class Quality(IntFlag):
    """Faults of a sample, as bits; 0 is a good sample.  Stored in session files."""

    COUNTER_GAP = 1
    """At least one frame of this message is missing before this one."""
    CRC_BAD = 2
    """The checksum in the payload does not match: the value must not be used."""
    SENTINEL = 4
    """The raw value is a named code ("not available"), not a measurement."""
    OUT_OF_RANGE = 8
    """The value is outside the range that the DBC states."""
    INTERPOLATED = 16
    """The value is not measured but computed from its neighbours."""
    MISSING = 32
    """The frame is too short to hold the signal, or its selector names another signal."""


UNUSABLE = Quality.CRC_BAD | Quality.SENTINEL | Quality.MISSING
"""Samples with one of these bits never enter a computation."""


@dataclass(frozen=True, slots=True)
class Samples:
    """The samples of one signal."""

    channel: str
    """`Message.signal`, or a channel's name once it is mapped."""
    t_ns: NDArray[np.int64]
    """Time stamps of the frames, ns, shape (n,)."""
    value: NDArray[np.float64]
    """Physical values in the signal's unit, shape (n,); NaN where there is none."""
    quality: NDArray[np.uint8]
    """Bits of `Quality`, shape (n,)."""

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Mask of the samples that may enter a computation, shape (n,)."""
        return np.asarray((self.quality & UNUSABLE) == 0)


@dataclass(frozen=True, slots=True)
class DecodeCounts:
    """Numbers of frames of a batch that could not be decoded, by reason."""

    unknown_id: int
    wrong_length: int
    crc_bad: int
    error_frames: int
    remote_frames: int


@dataclass(frozen=True, slots=True)
class Decoded:
    """The result of decoding a batch of frames."""

    samples: Mapping[str, Samples]
    """Signals of the messages that occur in the batch.  Signals of one (not multiplexed) message
    share one `t_ns` array."""
    counts: DecodeCounts
    """Numbers of frames that were not decoded."""

    def __getitem__(self, signal: str) -> Samples:
        return self.samples[signal]


# Decoding and encoding ----------------------------------------------------------------------------


_STANDARD_IDS = 1 << 11
_Key = tuple[int | None, int, bool]


@dataclass(frozen=True, slots=True)
class Codec:
    """The messages of one or several databases, ready to decode and encode."""

    messages: tuple[MessageLayout, ...]
    """The messages; their names, and the pair (can_id, is_extended) on each bus, must be unique."""
    left_out: tuple[Finding, ...] = ()
    """Messages and signals of the database that cannot be used, and why."""
    notes: tuple[Finding, ...] = ()
    """Oddities of the database that do no harm."""
    by_name: Mapping[str, MessageLayout] = field(init=False, repr=False, compare=False)
    """The messages by their names."""
    _places: dict[_Key, int] = field(init=False, repr=False, compare=False)
    _limits: dict[str, tuple[float, float] | None] = field(init=False, repr=False, compare=False)
    """Valid values of each `Message.signal`."""
    _standard: NDArray[np.uint16] = field(init=False, repr=False, compare=False)
    """Positions of the messages of 11 bits, by bus and identifier; the last row: on other buses."""

    def __post_init__(self) -> None:
        places = {(m.bus, m.can_id, m.is_extended): i for i, m in enumerate(self.messages)}
        object.__setattr__(self, "by_name", {m.name: m for m in self.messages})
        object.__setattr__(self, "_places", places)
        limits = {f"{m.name}.{s.name}": s.limits for m in self.messages for s in m.signals}
        object.__setattr__(self, "_limits", limits)
        last = max((m.bus + 1 for m in self.messages if m.bus is not None), default=0)
        standard = np.full((last + 1, _STANDARD_IDS), len(self.messages), np.uint16)
        for i in sorted(range(len(self.messages)), key=lambda i: self.messages[i].bus is not None):
            message = self.messages[i]
            if not message.is_extended:
                rows = slice(None) if message.bus is None else message.bus
                standard[rows, message.can_id] = i
        object.__setattr__(self, "_standard", standard)

    def message(self, name: str) -> MessageLayout:
        """Return the message called `name`; raises KeyError if the DBC has none."""
        if name not in self.by_name:
            raise KeyError(f"the DBC has no message {name}")
        return self.by_name[name]

    def find(self, can_id: int, is_extended: bool, bus: int = 0) -> MessageLayout | None:
        """Return the message that frames with this identifier carry on a bus, or None."""
        place = self._place(bus, can_id, is_extended)
        return None if place is None else self.messages[place]

    def _place(self, bus: int, can_id: int, is_extended: bool) -> int | None:
        for where in (bus, None):
            if (where, can_id, is_extended) in self._places:
                return self._places[where, can_id, is_extended]
        return None

    def classify(self, batch: FrameBatch) -> tuple[NDArray[np.uint16], int, int]:
        """Return the positions of the frames' messages, and the numbers of error and remote frames.

        The position is the number of messages for unknown identifiers, and one more for error and
        remote frames, which have no data.
        """
        unknown = np.uint16(len(self.messages))
        row = np.minimum(batch.bus, len(self._standard) - 1)
        index = self._standard[row, batch.can_id % _STANDARD_IDS]
        index[batch.can_id >= _STANDARD_IDS] = unknown
        extended = np.flatnonzero(batch.flags & np.uint16(FrameFlag.EXTENDED))
        if len(extended):
            keys = batch.bus[extended].astype(np.uint64) << np.uint64(32) | batch.can_id[extended]
            distinct, inverse = np.unique(keys, return_inverse=True)
            places = [self._place(key >> 32, key & 0xFFFF_FFFF, True) for key in distinct.tolist()]
            known = [unknown if place is None else place for place in places]
            index[extended] = np.array(known, np.uint16)[inverse]
        error = batch.flags & np.uint16(FrameFlag.ERROR) != 0
        remote = (batch.flags & np.uint16(FrameFlag.REMOTE) != 0) & ~error
        index[error | remote] = unknown + 1
        return index, int(np.count_nonzero(error)), int(np.count_nonzero(remote))

    def decode(self, batch: FrameBatch) -> Decoded:
        """Return the samples of a block of frames of any messages, in order of arrival.

        They are in the DBC's own units, by `Message.signal`, of the messages that occur in the
        block.  Error and remote frames and unknown identifiers are counted and not decoded.  A
        frame that is shorter than its message gives NaN (`Quality.MISSING`) for the signals that it
        does not hold; the excess bytes of a longer frame are ignored; both are counted as frames of
        wrong length.
        """
        index, error_frames, remote_frames = self.classify(batch)
        count = np.bincount(index, minlength=len(self.messages) + 2)
        order = np.argsort(index, kind="stable")
        samples: dict[str, Samples] = {}
        wrong_length = crc_bad = 0
        stops = np.cumsum(count)
        words = batch.data.view(np.uint64)
        for i in np.flatnonzero(count[: len(self.messages)]).tolist():
            message = self.messages[i]
            rows = order[stops[i] - count[i] : stops[i]]
            if message.length <= 8:
                payload = words[:, 0].take(rows)[:, None]
            else:
                payload = np.zeros((len(rows), 8), np.uint64)
                payload[:, : words.shape[1]] = words.take(rows, axis=0)
            t_ns, length = batch.t_ns.take(rows), batch.length.take(rows)
            with np.errstate(invalid="ignore", over="ignore"):  # a payload may hold any float
                decoded, bad = _decoded(message, self._limits, t_ns, payload.view(np.uint8), length)
            samples.update(decoded)
            crc_bad += bad
            wrong_length += int(np.count_nonzero(length != message.length))
        unknown = int(count[len(self.messages)])
        counts = DecodeCounts(unknown, wrong_length, crc_bad, error_frames, remote_frames)
        return Decoded(samples, counts)

    def encode(
        self, message: str, values: Mapping[str, ArrayLike], counter_start: int = 0
    ) -> NDArray[np.uint8]:
        """Return frames of one message, payloads padded with zeros, (n, 8) or (n, 64) uint8.

        `values`: by signal, (n,), in the DBC's own units, rounded to the nearest raw value; all
        bits of other signals are 0.  `counter_start`: counter of the first frame; it grows by one
        with each, and wraps.  Counter and checksum are filled in here.  Raises KeyError if the DBC
        has no such message or signal, ValueError if a value does not fit in its bits (a
        saturating sensor must saturate before), columns differ in length, a signal is multiplexed,
        or counter or checksum is given.
        """
        layout = self.message(message)
        columns = {name: np.asarray(value) for name, value in values.items()}
        for name in columns:
            if name == layout.crc or (layout.counter and name == layout.counter.signal):
                raise ValueError(f"{message}.{name} is filled in here and cannot be given")
        shapes = {column.shape for column in columns.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            raise ValueError(f"the signals of {message} must be arrays of one length")
        (n,) = shapes.pop()
        if layout.counter is not None:
            columns[layout.counter.signal] = (counter_start + np.arange(n)) % layout.counter.modulus
        payload = np.zeros((n, 8 if layout.length <= 8 else 64), np.uint8)
        for name, column in columns.items():
            signal = layout.signal(name)
            if signal.is_multiplexed:
                raise ValueError(f"{message}.{name} is multiplexed and cannot be sent")
            _add_bits(payload, signal, _raw_bits(message, signal, column))
        if layout.crc is not None:
            byte = layout.signal(layout.crc).first_byte
            payload[:, byte] = CRC_RULES[layout.crc_rule](covered(payload, byte, layout.length))
        return payload


def _add_bits(payload: NDArray[np.uint8], signal: SignalLayout, bits: NDArray[np.uint64]) -> None:
    """Set the bits of a signal, (n,), in payloads, (n, width); bits that are set stay set."""
    for byte in range(signal.first_byte, signal.last_byte + 1):
        # Number of bytes between this one and the byte of the lowest bit.
        steps = signal.last_byte - byte if signal.is_big_endian else byte - signal.first_byte
        down = 8 * steps - signal.low_bit
        part = bits >> np.uint64(down) if down >= 0 else bits << np.uint64(-down)
        payload[:, byte] |= (part & np.uint64(0xFF)).astype(np.uint8)


def _raw_values(signal: SignalLayout, payload: NDArray[np.uint8]) -> NDArray[Any]:
    """Return the raw numbers of a signal, integers or floats, (n,), in payloads (n, 8 or 64)."""
    n, width = payload.shape
    first, last, low, length = (
        signal.first_byte, signal.last_byte, signal.low_bit, signal.length
    )  # fmt: skip
    if n == 0:
        return np.zeros(0, np.int64)
    order = ">" if signal.is_big_endian else "<"
    if low == 0 and length in (8, 16, 32, 64):
        kind = "f" if signal.is_float else "i" if signal.is_signed else "u"
        return np.ndarray((n,), f"{order}{kind}{length // 8}", payload.data, first, (width,))
    byte = min(first, width - 8)
    window = np.ndarray((n,), f"{order}u8", payload.data, byte, (width,))
    down = np.uint64(64 - length)
    if last - byte > 7:  # nine bytes
        beyond = payload[:, byte + 8].astype(np.uint64)
        if signal.is_big_endian:
            bits = window << np.uint64(8 - low) | beyond >> np.uint64(low)
        else:
            bits = window >> np.uint64(low) | beyond << np.uint64(64 - low)
        bits = bits << down
    else:
        shift = 8 * (byte + 7 - last if signal.is_big_endian else first - byte) + low
        bits = window << np.uint64(64 - length - shift)
    if signal.is_float:
        return (bits >> down).astype(f"u{length // 8}").view(f"f{length // 8}")
    if signal.is_signed:
        return bits.view(np.int64) >> np.int64(down)
    return bits >> down


def _decoded(
    message: MessageLayout,
    limits_of: Mapping[str, tuple[float, float] | None],
    t_ns: NDArray[np.int64],
    payload: NDArray[np.uint8],
    length: NDArray[np.uint8],
) -> tuple[dict[str, Samples], int]:
    """Return the samples of frames of a message, and the number of frames with a wrong checksum.

    A multiplexed signal has samples only of the frames whose selector names it; frames of a wrong
    length do not count as frames with a wrong checksum.
    """
    bad = np.zeros(len(t_ns), np.bool_)
    if message.crc is not None:
        byte = message.signal(message.crc).first_byte
        computed = CRC_RULES[message.crc_rule](covered(payload, byte, message.length))
        bad = (computed != payload[:, byte]) & (length > byte)
    quality = bad.view(np.uint8) * np.uint8(Quality.CRC_BAD)
    shortest = int(length.min())
    times = read_only(t_ns)  # one array: what depends on it alone is computed once
    samples = {}
    for signal in message.signals:
        name = f"{message.name}.{signal.name}"
        limits, last_byte = limits_of[name], signal.last_byte
        part, marks, stamps, size = payload, quality, times, length
        if signal.is_multiplexed:
            rows = np.flatnonzero(_presence(message, signal, payload, length))
            part, marks, stamps, size = payload[rows], quality[rows], t_ns[rows], length[rows]
        raw = _raw_values(signal, part)
        value = raw.astype(np.float64)
        if signal.factor != 1:
            value *= float(signal.factor)
        if signal.offset:
            value += float(signal.offset)
        if signal.sentinels:
            codes = np.array(signal.sentinels, raw.dtype.newbyteorder("="))
            named = np.isin(raw, codes, kind="sort")  # NumPy 2.0's table: not 2^64 - 1
            value[named] = np.nan
            marks = _marked(marks, named, Quality.SENTINEL)
        if limits is not None:
            outside = (value < limits[0]) | (value > limits[1])
            marks = _marked(marks, outside, Quality.OUT_OF_RANGE)
        if shortest <= last_byte:
            cut = size <= last_byte
            value[cut] = np.nan
            # Marks from bits that were not received are wrong.
            wrong_marks = np.uint8(Quality.OUT_OF_RANGE | Quality.SENTINEL)
            marks = np.where(cut, marks & ~wrong_marks, marks)
            marks = _marked(marks, cut, Quality.MISSING)
        samples[name] = Samples(name, read_only(stamps), read_only(value), read_only(marks))
    return samples, int(np.count_nonzero(bad & (length == message.length)))


def _presence(
    message: MessageLayout,
    signal: SignalLayout,
    payload: NDArray[np.uint8],
    length: NDArray[np.uint8],
) -> NDArray[np.bool_]:
    """Return a mask of the frames whose selectors, at every level, name a signal."""
    present = np.ones(len(length), np.bool_)
    while signal.selector is not None:
        selector = message.signal(signal.selector)
        raw = _raw_values(selector, payload)
        named = [(raw >= low) & (raw <= high) for low, high in signal.selected_by]
        present &= np.logical_or.reduce(named)
        present &= length > selector.last_byte
        signal = selector
    return present


def _marked(
    quality: NDArray[np.uint8], where: NDArray[np.bool_], bit: Quality
) -> NDArray[np.uint8]:
    """Return the quality with a bit set where a mask is true."""
    return quality | where.view(np.uint8) * np.uint8(bit) if where.any() else quality


def _raw_bits(message: str, signal: SignalLayout, value: NDArray[np.generic]) -> NDArray[np.uint64]:
    """Return the signal's bits, as the nearest raw value."""
    scaled = (value.astype(np.float64) - signal.offset) / signal.factor
    if signal.is_float:
        size = signal.length // 8
        bits: NDArray[np.uint64] = scaled.astype(f"f{size}").view(f"u{size}").astype(np.uint64)
        return bits
    nearest = np.rint(scaled)
    low, high = signal.raw_range
    if not np.all((nearest >= low) & (nearest < high + 1)):
        lowest, highest = signal.span
        raise ValueError(
            f"{message}.{signal.name} cannot hold {value.min()} .. {value.max()}, "
            f"only {lowest} .. {highest}"
        )
    whole = nearest.astype(np.int64 if signal.is_signed else np.uint64).view(np.uint64)
    return whole & np.uint64((1 << signal.length) - 1)
