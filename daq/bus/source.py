"""The protocol of a frame source, and the losses counted between the wire and the recorder.

Sources only read and stamp: they run in threads of their own, and anything that keeps one from
reading loses frames in the adapter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from dbc.frames import FrameBatch

BLOCK_FRAMES = 2048
"""Most frames that a source returns at once."""
GATHER_S = 0.01
"""Seconds for which a source waits for more after the first frame: the cost of a block is shared by
all frames in it, and each still has the stamp of its own arrival."""
LONG_GATHER_S = 0.06
"""The same where the kernel stamps and holds frames meanwhile, in a buffer of our size: a block
then has 540 frames of a full bus."""


@dataclass(frozen=True, slots=True)
class SourceLosses:
    """Losses of a source since it was opened."""

    dropped: int = 0
    """Frames that the interface reports as lost before they could be read."""
    garbled: int = 0
    """Pieces of input that are not a frame."""
    restamped: int = 0
    """Frames with an impossible time stamp, which were stamped on arrival instead."""

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
    """Frames read but not recorded because the writer was too far behind."""

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """The counts in this order; `dataclasses.astuple` takes ten times as long."""
        return self.bus_dropped, self.bus_garbled, self.restamped, self.queue_dropped

    def since(self, before: HopLosses) -> HopLosses:
        """Return what was lost since an earlier count."""
        lost = zip(self.counts, before.counts, strict=True)
        return HopLosses(*(now - then for now, then in lost))


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """State of the link to one bus; a source that fails is opened again (`daq.bus.link`)."""

    name: str
    """Name of the bus for the operator."""
    bitrate: int
    """As configured, bit/s."""
    connected: bool
    """True while a source is open."""
    error: str
    """Why none is open; empty while connected."""
    advice: str
    """Advice for the operator; empty while connected."""
    heartbeat_s: float
    """Monotonic time of the reader's last cycle, s; before the first, of its creation."""
    reopened: int
    """Number of times the bus came back."""
    losses: SourceLosses
    """Sum over all sources opened until now."""
    interface_down: bool = False
    """True if a source is open on an interface that somebody took down."""


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
