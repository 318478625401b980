"""A DBC compiled for blocks of frames: which frame is which message, decoding, encoding."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .decode import MessageFrames, MessageReader, compile_message, decode_message
from .encode import encode_message
from .finding import Finding
from .frames import FrameBatch, FrameFlag
from .layout import MessageLayout
from .samples import DecodeCounts, Decoded, Samples

_STANDARD_IDS = 1 << 11


@dataclass(frozen=True, slots=True)
class Codec:
    """The messages of a DBC, ready to decode and encode."""

    messages: tuple[MessageLayout, ...]
    """Names, and pairs of (can_id, is_extended), must be unique."""
    left_out: tuple[Finding, ...] = ()
    """Messages of the database that cannot be used, and why."""
    notes: tuple[Finding, ...] = ()
    """Oddities of the database that do no harm."""
    _by_name: dict[str, MessageLayout] = field(init=False, repr=False, compare=False)
    _by_id: dict[tuple[int, bool], MessageLayout] = field(init=False, repr=False, compare=False)
    _readers: tuple[MessageReader, ...] = field(init=False, repr=False, compare=False)
    _standard: NDArray[np.uint16] = field(init=False, repr=False, compare=False)
    _extended: NDArray[np.uint32] = field(init=False, repr=False, compare=False)
    _extended_index: NDArray[np.uint16] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        unknown = len(self.messages)
        standard = np.full(_STANDARD_IDS, unknown, np.uint16)
        extended = sorted((m.can_id, i) for i, m in enumerate(self.messages) if m.is_extended)
        for i, message in enumerate(self.messages):
            if not message.is_extended:
                standard[message.can_id] = i
        object.__setattr__(self, "_by_name", {m.name: m for m in self.messages})
        object.__setattr__(self, "_by_id", {(m.can_id, m.is_extended): m for m in self.messages})
        object.__setattr__(self, "_readers", tuple(map(compile_message, self.messages)))
        object.__setattr__(self, "_standard", standard)
        object.__setattr__(self, "_extended", np.array([e[0] for e in extended], np.uint32))
        object.__setattr__(self, "_extended_index", np.array([e[1] for e in extended], np.uint16))

    def message(self, name: str) -> MessageLayout:
        """Return the message called `name`.

        Raises
        ------
        KeyError
            If the DBC has none.
        """
        if name not in self._by_name:
            raise KeyError(f"the DBC has no message {name}")
        return self._by_name[name]

    def find(self, can_id: int, is_extended: bool) -> MessageLayout | None:
        """Return the message that frames with this identifier carry, or None."""
        return self._by_id.get((can_id, is_extended))

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
            message gives NaN (`Quality.MISSING`) for the signals that it does not hold; in a
            longer one the excess is ignored; both are counted as of wrong length.
        """
        index, error_frames, remote_frames = self._classify(batch)
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
            Counter of the first frame; later ones count on and wrap.

        Returns
        -------
        (n, 8) or (n, 64) uint8
            Payloads padded with zeros, counter and checksum filled in.

        Raises
        ------
        KeyError
            If there is no such message or signal.
        ValueError
            If a value does not fit in its bits (a saturating sensor must saturate before), if
            columns differ in length, or if the counter or the checksum is given.
        """
        return encode_message(self.message(message), values, counter_start)

    def _classify(self, batch: FrameBatch) -> tuple[NDArray[np.uint16], int, int]:
        """Give each frame its position in `messages`; then unknown ones, then no data at all."""
        unknown = np.uint16(len(self.messages))
        index = self._standard.take(batch.can_id, mode="clip")
        special = FrameFlag.EXTENDED | FrameFlag.REMOTE | FrameFlag.ERROR
        flags = batch.flags & np.uint16(special)
        index[batch.can_id >= _STANDARD_IDS] = unknown
        if not flags.any():
            return index, 0, 0
        extended = np.flatnonzero(flags & np.uint16(FrameFlag.EXTENDED))
        index[extended] = unknown
        if len(self._extended):
            can_id = batch.can_id[extended]
            place = np.searchsorted(self._extended, can_id).clip(max=len(self._extended) - 1)
            known = self._extended[place] == can_id
            index[extended[known]] = self._extended_index[place[known]]
        error = (flags & np.uint16(FrameFlag.ERROR)) != 0
        remote = ((flags & np.uint16(FrameFlag.REMOTE)) != 0) & ~error
        index[error | remote] = unknown + 1
        return index, int(np.count_nonzero(error)), int(np.count_nonzero(remote))


def _gather(batch: FrameBatch, rows: NDArray[np.intp], width: int) -> MessageFrames:
    """Collect the frames at `rows`, with payloads of the width that the reader expects."""
    words = batch.data.view(np.uint64)
    if width == 8:
        payload = words[:, 0].take(rows)[:, None]
    else:
        payload = np.zeros((len(rows), 8), np.uint64)
        payload[:, : words.shape[1]] = words.take(rows, axis=0)
    return MessageFrames(batch.t_ns.take(rows), payload.view(np.uint8), batch.length.take(rows))
