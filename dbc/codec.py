"""Databases compiled for blocks of frames: decoding, encoding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .decode import MessageFrames, MessageReader, compile_message, decode_message
from .encode import encode_message
from .finding import Finding
from .frames import FrameBatch
from .identifiers import Identifiers
from .layout import MessageLayout
from .samples import DecodeCounts, Decoded, Samples


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
    _by_id: dict[tuple[int | None, int, bool], MessageLayout] = field(
        init=False, repr=False, compare=False
    )
    _readers: tuple[MessageReader, ...] = field(init=False, repr=False, compare=False)
    _identifiers: Identifiers = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        by_id = {(m.bus, m.can_id, m.is_extended): m for m in self.messages}
        object.__setattr__(self, "by_name", {m.name: m for m in self.messages})
        object.__setattr__(self, "_by_id", by_id)
        object.__setattr__(self, "_readers", tuple(map(compile_message, self.messages)))
        object.__setattr__(self, "_identifiers", Identifiers.of(self.messages))

    def message(self, name: str) -> MessageLayout:
        """Return the message called `name`.

        Raises
        ------
        KeyError
            If the DBC has none.
        """
        if name not in self.by_name:
            raise KeyError(f"the DBC has no message {name}")
        return self.by_name[name]

    def find(self, can_id: int, is_extended: bool, bus: int = 0) -> MessageLayout | None:
        """Return the message that frames with this identifier carry on a bus, or None."""
        own = self._by_id.get((bus, can_id, is_extended))
        return own or self._by_id.get((None, can_id, is_extended))

    def by_parameter_group(self) -> Codec:
        """Return the codec that matches all messages of 29 bits by their parameter group (J1939).

        Messages that the database marks as J1939 (`VFrameFormat` is ``J1939PG``) are matched so in
        any case.
        """
        messages = tuple(replace(m, is_j1939=m.is_extended) for m in self.messages)
        return replace(self, messages=messages)

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
        index, error_frames, remote_frames = self._identifiers.classify(batch)
        count = np.bincount(index, minlength=len(self.messages) + 2)
        order = np.argsort(index, kind="stable")
        samples: dict[str, Samples] = {}
        wrong_length = crc_bad = 0
        stops = np.cumsum(count)
        for i in np.flatnonzero(count[: len(self.messages)]).tolist():
            reader = self._readers[i]
            frames = _gather(batch, order[stops[i] - count[i] : stops[i]], reader.width)
            with np.errstate(invalid="ignore", over="ignore"):  # a payload may hold any float
                decoded, bad = decode_message(reader, frames)
            samples.update(decoded)
            crc_bad += bad
            wrong_length += int(np.count_nonzero(frames.length != reader.layout.length))
        unknown = int(count[len(self.messages)])
        counts = DecodeCounts(unknown, wrong_length, crc_bad, error_frames, remote_frames)
        return Decoded(samples, counts)

    def encode(
        self, message: str, values: Mapping[str, ArrayLike], counter_start: int = 0
    ) -> NDArray[np.uint8]:
        """Encode frames of one message.

        Parameters
        ----------
        message : str
            Name of the message.
        values : mapping of signal name to (n,) array
            Values in the DBC's own units, rounded here to the nearest raw value.  Signals that
            are not given have all bits 0.
        counter_start : int
            Counter of the first frame; it grows by one with each later frame, and wraps.

        Returns
        -------
        (n, 8) or (n, 64) uint8
            Payloads padded with zeros, with counter and checksum filled in.

        Raises
        ------
        KeyError
            If the DBC has no message or signal of that name.
        ValueError
            If a value does not fit in its bits (a saturating sensor must saturate before), if
            columns differ in length, or if the counter or the checksum is given.
        """
        return encode_message(self.message(message), values, counter_start)


def _gather(batch: FrameBatch, rows: NDArray[np.intp], width: int) -> MessageFrames:
    """Collect the frames at `rows`, with payloads of the width that the reader expects."""
    words = batch.data.view(np.uint64)
    if width == 8:
        payload = words[:, 0].take(rows)[:, None]
    else:
        payload = np.zeros((len(rows), 8), np.uint64)
        payload[:, : words.shape[1]] = words.take(rows, axis=0)
    return MessageFrames(batch.t_ns.take(rows), payload.view(np.uint8), batch.length.take(rows))
