"""Defines decoded samples: the values of signals at the time stamps of their frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray


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
