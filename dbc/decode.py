"""Decodes blocks of frames with the messages of one or several databases.

The bits of one signal are read over all frames of a message at once: whole bytes (most sensors)
through a typed view of the payload, others by shifting a window of 64 bits; only a field that
touches nine bytes needs two reads.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .crc import CRC_RULES, covered
from .encode import encode_message
from .finding import Finding
from .frames import FrameBatch, FrameFlag, read_only
from .layout import MessageLayout, SignalLayout
from .samples import DecodeCounts, Decoded, Quality, Samples

_STANDARD_IDS = 1 << 11
_BROADCAST = 240
"""Lowest PDU format whose parameter groups have no destination (SAE J1939-21)."""


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
    _places: dict[tuple[int | None, int, bool], int] = field(init=False, repr=False, compare=False)
    _groups: dict[tuple[int | None, int], list[int]] = field(init=False, repr=False, compare=False)
    _row: NDArray[np.uint32] = field(init=False, repr=False, compare=False)
    _standard: NDArray[np.uint16] = field(init=False, repr=False, compare=False)
    _readers: tuple[_MessageReader, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        groups: dict[tuple[int | None, int], list[int]] = defaultdict(list)
        for i, m in enumerate(self.messages):
            if m.is_j1939:
                groups[m.bus, _parameter_group(m.can_id)].append(i)
        # Row 0 holds the messages of any bus; a bus with messages of its own has a row with both.
        buses = sorted({m.bus for m in self.messages if m.bus is not None})
        row = np.zeros(256, np.uint32)
        row[buses] = np.arange(1, len(buses) + 1)
        standard = np.full((len(buses) + 1, _STANDARD_IDS), len(self.messages), np.uint16)
        for i in sorted(range(len(self.messages)), key=lambda i: self.messages[i].bus is not None):
            m = self.messages[i]
            if not m.is_extended:
                standard[slice(None) if m.bus is None else int(row[m.bus]), m.can_id] = i
        places = {(m.bus, m.can_id, m.is_extended): i for i, m in enumerate(self.messages)}
        for name, value in {
            "by_name": {m.name: m for m in self.messages},
            "_places": places,
            "_groups": dict(groups),
            "_row": row * np.uint32(_STANDARD_IDS),
            "_standard": standard.ravel(),
            "_readers": tuple(map(_MessageReader.of, self.messages)),
        }.items():
            object.__setattr__(self, name, value)

    def message(self, name: str) -> MessageLayout:
        """Return the message called `name`; raises KeyError if the DBC has none."""
        if name not in self.by_name:
            raise KeyError(f"the DBC has no message {name}")
        return self.by_name[name]

    def find(self, can_id: int, is_extended: bool, bus: int = 0) -> MessageLayout | None:
        """Return the message that frames with this identifier carry on a bus, or None."""
        for key in ((bus, can_id, is_extended), (None, can_id, is_extended)):
            if key in self._places:
                return self.messages[self._places[key]]
        return None

    def by_parameter_group(self) -> Codec:
        """Return the codec that matches all messages of 29 bits by their parameter group (J1939).

        Messages that the database marks as J1939 (`VFrameFormat` is ``J1939PG``) are matched so in
        any case.
        """
        messages = tuple(replace(m, is_j1939=m.is_extended) for m in self.messages)
        return replace(self, messages=messages)

    def classify(self, batch: FrameBatch) -> tuple[NDArray[np.uint16], int, int]:
        """Return the positions of the frames' messages, and the numbers of error and remote frames.

        The position is the number of messages for unknown identifiers, and one more for error and
        remote frames, which have no data.
        """
        unknown = np.uint16(len(self.messages))
        has_buses = len(self._standard) > _STANDARD_IDS
        place = batch.can_id + self._row.take(batch.bus) if has_buses else batch.can_id
        index = self._standard.take(place, mode="clip")
        index[batch.can_id >= _STANDARD_IDS] = unknown
        flags = batch.flags & np.uint16(FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR)
        if not flags.any():
            return index, 0, 0
        extended = np.flatnonzero(flags & np.uint16(FrameFlag.EXTENDED))
        keys = batch.bus[extended].astype(np.uint64) << np.uint64(32) | batch.can_id[extended]
        distinct, inverse = np.unique(keys, return_inverse=True)
        places = []
        for key in distinct.tolist():
            can_id, bus = key & 0xFFFF_FFFF, key >> 32
            exact = (self._places.get((where, can_id, True)) for where in (bus, None))
            position = next((number for number in exact if number is not None), None)
            if position is None:
                # Messages of one group from several sources differ in their identifiers only.
                group = _parameter_group(can_id)
                groups = (self._groups.get((where, group), ()) for where in (bus, None))
                both = [number for numbers in groups for number in numbers]
                position = both[0] if len(both) == 1 else len(self.messages)
            places.append(position)
        index[extended] = np.array(places, np.uint16)[inverse]
        error = (flags & np.uint16(FrameFlag.ERROR)) != 0
        remote = ((flags & np.uint16(FrameFlag.REMOTE)) != 0) & ~error
        index[error | remote] = unknown + 1
        return index, int(np.count_nonzero(error)), int(np.count_nonzero(remote))

    def decode(self, batch: FrameBatch) -> Decoded:
        """Decode a block of frames.

        Parameters
        ----------
        batch : FrameBatch
            Frames of any number of messages, in order of arrival.

        Returns
        -------
        Decoded
            Samples by `Message.signal`, in the DBC's own units, of the messages that occur in the
            block.  Samples of one signal keep the order of arrival.  Error and remote frames and
            unknown identifiers are counted and not decoded.  A frame that is shorter than its
            message gives NaN (`Quality.MISSING`) for the signals that it does not hold; the excess
            bytes of a longer frame are ignored; both are counted as frames of wrong length.
        """
        index, error_frames, remote_frames = self.classify(batch)
        count = np.bincount(index, minlength=len(self.messages) + 2)
        order = np.argsort(index, kind="stable")
        samples: dict[str, Samples] = {}
        wrong_length = crc_bad = 0
        stops = np.cumsum(count)
        words = batch.data.view(np.uint64)
        for i in np.flatnonzero(count[: len(self.messages)]).tolist():
            reader = self._readers[i]
            rows = order[stops[i] - count[i] : stops[i]]
            if reader.width == 8:
                payload = words[:, 0].take(rows)[:, None]
            else:
                payload = np.zeros((len(rows), 8), np.uint64)
                payload[:, : words.shape[1]] = words.take(rows, axis=0)
            t_ns, length = batch.t_ns.take(rows), batch.length.take(rows)
            with np.errstate(invalid="ignore", over="ignore"):  # a payload may hold any float
                decoded, bad = reader.decode(t_ns, payload.view(np.uint8), length)
            samples.update(decoded)
            crc_bad += bad
            wrong_length += int(np.count_nonzero(length != reader.layout.length))
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
        saturating sensor must saturate before), columns differ in length, or counter or checksum
        is given.
        """
        return encode_message(self.message(message), values, counter_start)


def _parameter_group(can_id: int) -> int:
    """Return an identifier without priority, source and, where it has one, destination (J1939)."""
    group = can_id & ~0x1C00_00FF
    return group & ~0xFF00 if can_id >> 16 & 0xFF < _BROADCAST else group


@dataclass(frozen=True, slots=True)
class _FieldReader:
    """Reads one signal from payloads of a fixed width."""

    layout: SignalLayout
    view: np.dtype[np.generic]
    """Type to read: that of the field itself, or of a window of 8 bytes around it."""
    byte: int
    """Position of that type in the payload, bytes."""
    shift: int | None
    """Lowest bit of the field in the window; None if `view` is the field itself; negative if the
    field continues in the byte after the window."""
    limits: tuple[float, float] | None
    """Lowest and highest valid value, if the bits can express values outside that range."""

    @classmethod
    def of(cls, layout: SignalLayout, width: int) -> _FieldReader:
        """Return the fastest reader for payloads of `width` bytes, 8 or 64."""
        first, last = layout.first_byte, layout.last_byte
        order = ">" if layout.is_big_endian else "<"
        low, high = layout.minimum, layout.maximum
        limits = None if low is None or high is None or low >= high else (low, high)
        if limits and limits[0] <= layout.span[0] and layout.span[1] <= limits[1]:
            limits = None
        if layout.low_bit == 0 and layout.length in (8, 16, 32, 64):
            kind = "f" if layout.is_float else "i" if layout.is_signed else "u"
            view = np.dtype(f"{order}{kind}{layout.length // 8}")
            return cls(layout, view, first, None, limits)
        byte = min(first, width - 8)
        shift = 8 * (byte + 7 - last if layout.is_big_endian else first - byte) + layout.low_bit
        shift = -1 if last - byte > 7 else shift
        return cls(layout, np.dtype(f"{order}u8"), byte, shift, limits)

    def raw(self, payload: NDArray[np.uint8]) -> NDArray[Any]:
        """Return the raw numbers of the signal in (n, width) payloads: integers or floats, (n,)."""
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
            low, high = np.uint64(layout.low_bit), np.uint64(8 - layout.low_bit)
            if layout.is_big_endian:
                bits = window << high | beyond >> low
            else:
                bits = window >> low | beyond << np.uint64(64 - layout.low_bit)
            bits = bits << down
        else:
            bits = window << np.uint64(64 - layout.length - self.shift)
        if layout.is_float:
            whole = (bits >> down).astype(f"u{layout.length // 8}")
            return whole.view(f"f{layout.length // 8}")
        if layout.is_signed:
            return bits.view(np.int64) >> np.int64(down)
        return bits >> down


@dataclass(frozen=True, slots=True)
class _MessageReader:
    """A message with the readers of its signals."""

    layout: MessageLayout
    width: int
    """Width of the payloads it reads, 8 or 64 bytes."""
    fields: tuple[_FieldReader, ...]

    @classmethod
    def of(cls, layout: MessageLayout) -> _MessageReader:
        """Return the reader of a message."""
        width = 8 if layout.length <= 8 else 64
        return cls(layout, width, tuple(_FieldReader.of(s, width) for s in layout.signals))

    def decode(
        self, t_ns: NDArray[np.int64], payload: NDArray[np.uint8], length: NDArray[np.uint8]
    ) -> tuple[dict[str, Samples], int]:
        """Decode all signals of frames of this message, in order of arrival.

        Returns samples by `Message.signal` (a multiplexed signal only in frames whose selector
        names it) and the number of frames of the right length whose checksum does not match.
        """
        layout = self.layout
        bad = np.zeros(len(t_ns), np.bool_)
        if layout.crc is not None:
            byte = layout.signal(layout.crc).first_byte
            computed = CRC_RULES[layout.crc_rule](covered(payload, byte, layout.length))
            bad = (computed != payload[:, byte]) & (length > byte)
        quality = bad.view(np.uint8) * np.uint8(Quality.CRC_BAD)
        shortest = int(length.min())
        times = read_only(t_ns)  # one array: what depends on it alone is computed once
        present: dict[str, NDArray[np.bool_]] = {}
        samples = {}
        for each in self.fields:
            signal = each.layout
            part, marks, own_ns, size = payload, quality, times, length
            if signal.is_multiplexed:
                rows = np.flatnonzero(self._presence(signal, payload, length, present))
                part, marks, own_ns, size = payload[rows], quality[rows], t_ns[rows], length[rows]
            raw = each.raw(part)
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
            if each.limits is not None:
                outside = (value < each.limits[0]) | (value > each.limits[1])
                marks = _marked(marks, outside, Quality.OUT_OF_RANGE)
            if shortest <= signal.last_byte:
                cut = size <= signal.last_byte
                value[cut] = np.nan
                false = Quality.OUT_OF_RANGE | Quality.SENTINEL  # from bits that were not received
                marks = _marked(marks & ~(cut * np.uint8(false)), cut, Quality.MISSING)
            name = f"{layout.name}.{signal.name}"
            columns = (read_only(own_ns), read_only(value), read_only(marks))
            samples[name] = Samples(name, *columns)
        return samples, int(np.count_nonzero(bad & (length == layout.length)))

    def _presence(
        self,
        signal: SignalLayout,
        payload: NDArray[np.uint8],
        length: NDArray[np.uint8],
        present: dict[str, NDArray[np.bool_]],
    ) -> NDArray[np.bool_]:
        """Return a mask of the frames that hold a signal; selectors may be nested."""
        if signal.selector is None:
            return np.ones(len(length), np.bool_)
        if signal.name not in present:
            selector = next(each for each in self.fields if each.layout.name == signal.selector)
            raw = selector.raw(payload)
            chosen = length > selector.layout.last_byte
            ranges: Sequence[tuple[int, int]] = signal.selected_by
            chosen &= np.any([(raw >= low) & (raw <= high) for low, high in ranges], axis=0)
            chosen &= self._presence(selector.layout, payload, length, present)
            present[signal.name] = chosen
        return present[signal.name]


def _marked(
    quality: NDArray[np.uint8], where: NDArray[np.bool_], bit: Quality
) -> NDArray[np.uint8]:
    return quality | where.view(np.uint8) * np.uint8(bit) if where.any() else quality
