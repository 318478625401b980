"""Decoded samples: the values of signals at the time stamps of their frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray


class Quality(IntFlag):
    """Faults of a sample; 0 is a good one.  Stored in session files."""

    COUNTER_GAP = 1
    """At least one frame of this message is missing before this one."""
    CRC_BAD = 2
    """The checksum in the payload does not fit: the value must not be used."""
    SENTINEL = 4
    """The raw value is a named code ("not available"), not a measurement."""
    OUT_OF_RANGE = 8
    """Outside the range that the DBC states."""
    INTERPOLATED = 16
    """Not measured here but computed from neighbours."""
    MISSING = 32
    """The frame is too short to hold the signal, or its selector says another one is there."""


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


@dataclass(frozen=True, slots=True)
class DecodeCounts:
    """How many frames of a batch could not be decoded, by reason."""

    unknown_id: int
    wrong_length: int
    crc_bad: int
    error_frames: int
    remote_frames: int


@dataclass(frozen=True, slots=True)
class Decoded:
    """All that a batch of frames says."""

    samples: Mapping[str, Samples]
    """Signals of the messages that occur in the batch.  Signals of one (not multiplexed) message
    share one `t_ns` array."""
    counts: DecodeCounts
    """Numbers of frames that were not decoded."""

    def __getitem__(self, signal: str) -> Samples:
        return self.samples[signal]
