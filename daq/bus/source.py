"""Defines the protocol of a frame source, and the losses between the wire and the recorder.

Sources only read and stamp frames.  They run in separate threads; if one is kept from reading,
frames are lost in the adapter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from dbc.frames import FrameBatch

from ..runs import Losses

BLOCK_FRAMES = 2048
"""Largest number of frames that a source returns at once."""
GATHER_S = 0.01
"""Time, s, for which a source waits for more frames after the first: the cost of a block is shared
by all frames in it, and each frame still has its own time of arrival."""
LONG_GATHER_S = 0.06
"""Time, s, as `GATHER_S`, for interfaces where the kernel stamps and holds the frames in a buffer
of our size: a block of a full bus then has 540 frames."""


@dataclass(frozen=True, slots=True)
class SourceLosses:
    """Losses of a source since it was opened."""

    dropped: int = 0
    """Number of frames that the interface reports as lost before they could be read."""
    garbled: int = 0
    """Number of pieces of input that are not a frame."""
    restamped: int = 0
    """Number of frames with an impossible time stamp, which were stamped on arrival instead."""

    def plus(self, other: SourceLosses) -> SourceLosses:
        """Return the sum of both."""
        return SourceLosses(
            self.dropped + other.dropped,
            self.garbled + other.garbled,
            self.restamped + other.restamped,
        )


@dataclass(frozen=True, slots=True)
class HopLosses:
    """Cumulative counts from the wires to the journal, over all sources; stored with each block."""

    bus_dropped: int = 0
    """Sum of `SourceLosses.dropped`."""
    bus_garbled: int = 0
    """Sum of `SourceLosses.garbled`."""
    restamped: int = 0
    """Sum of `SourceLosses.restamped`."""
    queue_dropped: int = 0
    """Number of frames that were read but not recorded because the writer was too far behind."""

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """The counts in the order of the fields; `dataclasses.astuple` takes ten times as long."""
        return self.bus_dropped, self.bus_garbled, self.restamped, self.queue_dropped

    @property
    def of_a_run(self) -> Losses:
        """The lost frames, as losses of a run."""
        return Losses(
            bus_dropped=self.bus_dropped,
            bus_garbled=self.bus_garbled,
            queue_dropped=self.queue_dropped,
        )

    def since(self, before: HopLosses) -> HopLosses:
        """Return the losses since an earlier count."""
        lost = zip(self.counts, before.counts, strict=True)
        return HopLosses(*(now - then for now, then in lost))


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """State of the link to one bus; a source that fails is opened again (`daq.bus.link`)."""

    name: str
    """Name of the bus for the operator."""
    bitrate: int
    """Configured bit rate, bit/s."""
    connected: bool
    """True while a source is open."""
    error: str
    """Reason why no source is open; empty while connected."""
    advice: str
    """Advice for the operator; empty while connected."""
    heartbeat_s: float
    """Monotonic time of the reader's last cycle, s; before the first, of its creation."""
    reopened: int
    """Number of times the bus came back."""
    losses: SourceLosses
    """Sum over all sources opened until now."""
    interface_down: bool = False
    """True if a source is open on an interface that was taken down."""


class FrameSource(Protocol):
    """A bus read in blocks.

    `read` and `close` belong to one thread at a time; `losses` may be called from any.
    """

    @property
    def name(self) -> str:
        """Name of the bus for the operator."""

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames received; wait up to `timeout_s` for the first.

        Raises BusError if the bus is lost.  Frames read before that have been returned.
        """

    def losses(self) -> SourceLosses:
        """Return the losses since the source was opened."""

    def close(self) -> None:
        """Release the interface; never raises."""


@runtime_checkable
class Interface(FrameSource, Protocol):
    """A source on a network interface, which can be taken down and up while it is open."""

    @property
    def interface_down(self) -> bool:
        """True if it was taken down and no frame has come since."""
