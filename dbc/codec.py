"""Decodes and encodes blocks of frames with the messages of one or several databases.

A signal is read over all frames of a message at once: whole bytes (most sensors) through a typed
view of the payload, others as rows of bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntFlag
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .frames import FrameBatch, FrameFlag, read_only
from .words import Finding

# Messages and signals, as a database describes them -----------------------------------------------


@dataclass(frozen=True, slots=True)
class CounterRule:
    """A counter that grows by one with each frame of a message."""

    signal: str
    modulus: int
    """Number of values: the counter runs from 0 to modulus - 1 and starts again."""


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Position of a signal in the payload, and the meaning of its bits."""

    name: str
    unit: str
    """Unit as in the DBC; may be empty."""
    start: int
    """Start bit as in the DBC, 8 * byte + bit: the lowest of an Intel signal, else the highest."""
    length: int
    """Number of bits, 1..64."""
    byte_order: Literal["big", "little"]
    """Order of the bytes, and so of the bits: big for Motorola, little for Intel."""
    is_signed: bool
    """True for two's complement."""
    is_float: bool
    """True for an IEEE 754 number of 16, 32 or 64 bits."""
    factor: int | float
    offset: int | float
    """value = raw * factor + offset.  Whole numbers stay `int`: their arithmetic is exact."""
    limits: tuple[float, float] | None
    """Lowest and highest valid value in `unit`; None where the DBC states none."""
    selector: str | None
    """Name of the multiplexer signal that decides whether this signal is in a frame."""
    selected_by: tuple[tuple[int, int], ...]
    """Inclusive ranges of the selector's raw value for which the signal is in the frame."""
    sentinels: tuple[int, ...]
    """Raw values that are not measurements."""

    @property
    def is_plain(self) -> bool:
        """True if its value is the raw number, unsigned and whole, and in every frame."""
        is_raw = (self.factor, self.offset) == (1, 0) and self.selector is None
        return is_raw and not self.is_float and not self.is_signed

    @property
    def first_bit(self) -> int:
        """Its first bit; the bits of a byte count from the highest (Motorola) or lowest (Intel)."""
        return self.start ^ 7 if self.byte_order == "big" else self.start

    @property
    def first_byte(self) -> int:
        """The lowest byte of the payload that holds a bit of the signal."""
        return self.start // 8

    @property
    def last_byte(self) -> int:
        """The highest byte of the payload that holds a bit of the signal."""
        return (self.first_bit + self.length - 1) // 8

    @property
    def is_one_byte(self) -> bool:
        """True if the signal is one byte of the payload."""
        return self.first_bit % 8 == 0 and self.length == 8

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
    """Name, unique in the codec; on a bench of several sensors it begins with `sensor.`."""
    can_id: int
    """Identifier of 11 or 29 bits, without flag bits."""
    is_extended: bool
    """True if `can_id` has 29 bits.  The pair decides; equal numbers may be different messages."""
    length: int
    """Number of payload bytes, 0..64."""
    cycle_s: float | None
    """Time between two frames, s; None where the DBC states none."""
    signals: tuple[SignalLayout, ...]
    """Signals, in the order of `first_bit`."""
    counter: CounterRule | None
    """The signal that the DBC marks as rolling counter."""
    crc: str | None
    """The signal that holds the checksum of one byte (`covered`)."""
    crc_rule: str = "crc8_j1850"
    """Rule by which the checksum is computed, a name in `CRC_RULES`."""
    bus: int | None = None
    """Number of the only bus on which this identifier is this message; None: any bus."""

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
    """Return the function from payloads, (n, bytes), to 8-bit CRCs, (n,), highest bit first."""
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

    In the first byte of a message of `length` bytes it covers all after it, else those before it.
    """
    return payload[:, 1:length] if byte == 0 else payload[:, :byte]


# Samples ------------------------------------------------------------------------------------------


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
    """Samples by signal, of the messages in the batch.  Signals in all frames share `t_ns`."""
    counts: DecodeCounts

    def __getitem__(self, signal: str) -> Samples:
        return self.samples[signal]


# Decoding and encoding ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Codec:
    """The messages of one or several databases, ready to decode and encode."""

    messages: tuple[MessageLayout, ...]
    """The messages; their names, and the pair (can_id, is_extended) on each bus, must be unique."""
    left_out: tuple[Finding, ...] = ()
    """Messages and signals of the database that cannot be used, and why."""

    @cached_property
    def by_name(self) -> Mapping[str, MessageLayout]:
        """The messages by their names."""
        return {message.name: message for message in self.messages}

    @cached_property
    def _n_buses(self) -> int:
        """Number of the first bus from which on only messages of any bus are known."""
        return max((m.bus + 1 for m in self.messages if m.bus is not None), default=0)

    @cached_property
    def _keys(self) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
        """Sorted keys (`_key`) of the known frames, (m,), and positions of their messages, (m,).

        Messages of any bus have a key for each bus that is named, and one for all higher numbers.
        A last key is that of no frame, so that a search ends within the keys.
        """
        index_of_key = {np.iinfo(np.int64).max: len(self.messages)}
        # A message of one bus takes the place of one of any bus.
        for i in sorted(range(len(self.messages)), key=lambda i: self.messages[i].bus is not None):
            message = self.messages[i]
            for bus in range(self._n_buses + 1) if message.bus is None else (message.bus,):
                index_of_key[int(_key(bus, message.is_extended, message.can_id))] = i
        keys = sorted(index_of_key)
        return np.array(keys, np.int64), np.array([index_of_key[key] for key in keys])

    def message(self, name: str) -> MessageLayout:
        """Return the message called `name`; raises KeyError if the DBC has none."""
        return self.by_name[name]

    def find(self, can_id: int, is_extended: bool, bus: int = 0) -> MessageLayout | None:
        """Return the message that frames with this identifier carry on a bus, or None."""
        keys, indices = self._keys
        key = _key(min(bus, self._n_buses), is_extended, can_id)
        position = int(np.searchsorted(keys, key))
        return self.messages[indices[position]] if keys[position] == key else None

    def classify(self, batch: FrameBatch) -> NDArray[np.uint16]:
        """Return the position of each frame's message among the messages, (n,).

        It is the number of messages for unknown identifiers, one more for error frames and two more
        for remote frames, which have no data.
        """
        (known_keys, indices), unknown = self._keys, len(self.messages)
        is_extended = batch.flags & np.uint16(FrameFlag.EXTENDED) != 0
        keys = _key(np.minimum(batch.bus, self._n_buses), is_extended, batch.can_id)
        position = np.searchsorted(known_keys, keys)
        index = np.where(known_keys[position] == keys, indices[position], unknown)
        index[batch.flags & np.uint16(FrameFlag.REMOTE) != 0] = unknown + 2
        index[batch.flags & np.uint16(FrameFlag.ERROR) != 0] = unknown + 1
        return index.astype(np.uint16)

    def decode(self, batch: FrameBatch) -> Decoded:
        """Return the samples of a block of frames of any messages, in order of arrival.

        They are in the DBC's own units, by `Message.signal`, of the messages that occur in the
        block.  Error and remote frames and unknown identifiers are counted and not decoded.  A
        frame shorter than its message gives NaN (`Quality.MISSING`) for the signals that it does
        not hold; excess bytes of a longer one are ignored; both count as of wrong length.
        """
        message_index = self.classify(batch)
        n_frames = np.bincount(message_index, minlength=len(self.messages) + 3)
        order = np.argsort(message_index, kind="stable")
        samples: dict[str, Samples] = {}
        wrong_length = crc_bad = 0
        stops = np.cumsum(n_frames)
        for i in np.flatnonzero(n_frames[: len(self.messages)]).tolist():
            message = self.messages[i]
            rows = order[stops[i] - n_frames[i] : stops[i]]  # of the frames of this message
            payload = batch.data.take(rows, axis=0)
            if message.length > payload.shape[1]:
                payload = np.pad(payload, ((0, 0), (0, 64 - payload.shape[1])))
            t_ns, length = batch.t_ns.take(rows), batch.length.take(rows)
            with np.errstate(invalid="ignore", over="ignore"):  # a payload may hold any float
                decoded, n_bad = _decode_message(message, t_ns, payload, length)
            samples.update(decoded)
            crc_bad += n_bad
            wrong_length += int(np.count_nonzero(length != message.length))
        unknown, errors, remote = n_frames[len(self.messages) :].tolist()
        counts = DecodeCounts(unknown, wrong_length, crc_bad, errors, remote)
        return Decoded(samples, counts)

    def encode(
        self, message: str, values: Mapping[str, ArrayLike], counter_start: int = 0
    ) -> NDArray[np.uint8]:
        """Return frames of one message, payloads padded with zeros, (n, 8) or (n, 64) uint8.

        `values`: by signal, one or more, (n,), in the DBC's own units, rounded to the nearest raw
        value; bits of other signals are 0.  `counter_start`: counter of the first frame; it grows
        by one with each, and wraps.  Counter and checksum are filled in here.  Raises KeyError if
        the DBC has no such message or signal, ValueError if a value exceeds its bits (a saturating
        sensor must saturate before), columns differ in length, or a signal is multiplexed.
        """
        layout = self.message(message)
        columns = {name: np.asarray(value, np.float64) for name, value in values.items()}
        (n,) = next(iter(columns.values())).shape
        if layout.counter is not None:
            counter = (counter_start + np.arange(n)) % layout.counter.modulus
            columns[layout.counter.signal] = counter.astype(np.float64)
        width = 8 if layout.length <= 8 else 64
        payload = np.zeros((n, width), np.uint8)
        for name, column in columns.items():
            signal = layout.signal(name)
            if signal.selector is not None:
                raise ValueError(f"{message}.{name} is multiplexed and cannot be sent")
            raw = _nearest_raw(message, signal, column)
            bits = np.unpackbits(raw.view(np.uint8).reshape(n, 8), axis=1)[:, 64 - signal.length :]
            signal_bits = slice(signal.first_bit, signal.first_bit + signal.length)
            payload_bits = np.zeros((n, 8 * width), np.uint8)
            payload_bits[:, signal_bits] = bits if signal.byte_order == "big" else bits[:, ::-1]
            payload |= np.packbits(payload_bits, axis=1, bitorder=signal.byte_order)
        if layout.crc is not None:
            byte = layout.signal(layout.crc).first_byte
            payload[:, byte] = CRC_RULES[layout.crc_rule](covered(payload, byte, layout.length))
        return payload


def _key(bus: Any, is_extended: Any, can_id: Any) -> Any:
    """Return bus, width and identifier of frames as one number each, int64 for arrays."""
    return (np.asarray(bus, np.int64) * 2 + is_extended) << 32 | can_id


def _raw_values(signal: SignalLayout, payload: NDArray[np.uint8]) -> NDArray[Any]:
    """Return the raw numbers of a signal, integers or floats, (n,), in payloads (n, 8 or 64)."""
    n, width = payload.shape
    length, kind = signal.length, "i" if signal.is_signed else "u"
    if signal.first_bit % 8 == 0 and length in (8, 16, 32, 64):
        kind = f"{'>' if signal.byte_order == 'big' else '<'}{'f' if signal.is_float else kind}"
        offset = signal.first_byte
        return np.ndarray((n,), f"{kind}{length // 8}", payload.data, offset, (width,))
    octets = payload[:, signal.first_byte : signal.last_byte + 1]
    begin = signal.first_bit % 8
    bits = np.unpackbits(octets, axis=1, bitorder=signal.byte_order)[:, begin : begin + length]
    bits = bits if signal.byte_order == "big" else bits[:, ::-1]  # (n, length), the highest first
    # The highest bit of a signed number is its sign, and fills the bits above.
    fill: Literal["edge", "constant"] = "edge" if signal.is_signed else "constant"
    words = np.packbits(np.pad(bits, ((0, 0), (64 - length, 0)), fill), axis=1)  # (n, 8 bytes)
    if signal.is_float:
        return words[:, 8 - length // 8 :].copy().view(f">f{length // 8}")[:, 0]
    return words.view(f">{kind}8")[:, 0]


def _decode_message(
    message: MessageLayout,
    t_ns: NDArray[np.int64],
    payload: NDArray[np.uint8],
    length: NDArray[np.uint8],
) -> tuple[dict[str, Samples], int]:
    """Return the samples of frames of a message, and the number of frames with a wrong checksum.

    `t_ns`, `length`: (n,); `payload`: (n, 8 or 64), all of its frames.  A multiplexed signal has
    samples only of the frames whose selector names it; frames of a wrong length do not count as
    frames with a wrong checksum.
    """
    is_crc_bad = np.zeros(len(t_ns), np.bool_)
    if message.crc is not None:
        byte = message.signal(message.crc).first_byte
        computed = CRC_RULES[message.crc_rule](covered(payload, byte, message.length))
        is_crc_bad = (computed != payload[:, byte]) & (length > byte)
    quality = is_crc_bad.view(np.uint8) * np.uint8(Quality.CRC_BAD)
    shortest_frame = int(length.min())
    times = read_only(t_ns)  # shared by signals, so that their users see that times are the same
    samples = {}
    for signal in message.signals:
        raw, marks, stamps_ns = _raw_values(signal, payload), quality, times
        value = raw.astype(np.float64)
        if signal.factor != 1:
            value *= float(signal.factor)
        if signal.offset:
            value += float(signal.offset)
        if signal.sentinels:
            codes = np.array(signal.sentinels, raw.dtype.newbyteorder("="))
            is_sentinel = np.isin(raw, codes, kind="sort")  # else NumPy 2.0 fails on 2^64 - 1
            value[is_sentinel] = np.nan
            marks = _marked(marks, is_sentinel, Quality.SENTINEL)
        if signal.limits is not None:
            is_outside = (value < signal.limits[0]) | (value > signal.limits[1])
            marks = _marked(marks, is_outside, Quality.OUT_OF_RANGE)
        if shortest_frame <= signal.last_byte:
            is_cut = length <= signal.last_byte
            value[is_cut] = np.nan
            # Marks from bits that were not received are wrong.
            wrong_marks = np.uint8(Quality.OUT_OF_RANGE | Quality.SENTINEL)
            marks = np.where(is_cut, marks & ~wrong_marks, marks)
            marks = _marked(marks, is_cut, Quality.MISSING)
        if signal.selector is not None:
            rows = np.flatnonzero(_is_present(message, signal, payload, length))
            value, marks, stamps_ns = value[rows], marks[rows], read_only(t_ns[rows])
        name = f"{message.name}.{signal.name}"
        samples[name] = Samples(name, stamps_ns, read_only(value), read_only(marks))
    return samples, int(np.count_nonzero(is_crc_bad & (length == message.length)))


def _is_present(
    message: MessageLayout,
    signal: SignalLayout,
    payload: NDArray[np.uint8],
    length: NDArray[np.uint8],
) -> NDArray[np.bool_]:
    """Return a mask of the frames whose selectors, at every level, name a signal."""
    is_present = np.ones(len(length), np.bool_)
    while signal.selector is not None:
        selector = message.signal(signal.selector)
        raw = _raw_values(selector, payload)
        in_ranges = [(raw >= low) & (raw <= high) for low, high in signal.selected_by]
        is_present &= np.logical_or.reduce(in_ranges)
        is_present &= length > selector.last_byte
        signal = selector
    return is_present


def _marked(
    quality: NDArray[np.uint8], where: NDArray[np.bool_], bit: Quality
) -> NDArray[np.uint8]:
    """Return the quality with a bit set where a mask is true."""
    return quality | where.view(np.uint8) * np.uint8(bit) if where.any() else quality


def _nearest_raw(
    message: str, signal: SignalLayout, value: NDArray[np.float64]
) -> NDArray[np.uint64]:
    """Return the raw value nearest to each value, as the signal's bits, (n,), big-endian uint64."""
    raw = (value - signal.offset) / signal.factor
    if signal.is_float:
        n_bytes = signal.length // 8
        return raw.astype(f"f{n_bytes}").view(f"u{n_bytes}").astype(">u8")
    nearest = np.rint(raw)
    low, high = signal.raw_range
    if not np.all((nearest >= low) & (nearest < high + 1)):
        raise ValueError(f"{message}.{signal.name} cannot hold {value.min()} .. {value.max()}")
    return nearest.astype(np.int64 if signal.is_signed else np.uint64).view(np.uint64).astype(">u8")
