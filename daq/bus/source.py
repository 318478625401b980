"""What a source of frames is, and the losses counted between the wire and the recorder.

Sources read and stamp, nothing else: they run in threads of their own, and whatever keeps one from
reading loses frames in the adapter.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Protocol, runtime_checkable

from dbc.frames import FrameBatch

BLOCK_FRAMES = 2048
"""A source hands over at most so many frames at a time."""
GATHER_S = 0.01
"""A source waits so long for company after the first frame: the cost of a block is spread over all
frames in it, and each still carries the stamp of its own arrival."""


@dataclass(frozen=True, slots=True)
class SourceLosses:
    """What a source has lost since it was opened."""

    dropped: int = 0
    """Frames that the interface says it lost before they could be read."""
    garbled: int = 0
    """Pieces of input that were no frame."""
    restamped: int = 0
    """Frames whose time stamp could not be true, and which were stamped on arrival instead."""


@dataclass(frozen=True, slots=True)
class HopLosses:
    """Cumulative counts from the wires to the journal, over all sources; stored with each block."""

    bus_dropped: int = 0
    bus_garbled: int = 0
    restamped: int = 0
    """`bus_dropped`, `bus_garbled`, `restamped`: sums of `SourceLosses`."""
    queue_dropped: int = 0
    """Frames read and not recorded because the writer was too far behind."""

    def since(self, before: HopLosses) -> HopLosses:
        """Return what was lost since an earlier count."""
        lost = zip(astuple(self), astuple(before), strict=True)
        return HopLosses(*(now - then for now, then in lost))


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """State of the link to one bus; a source that fails is opened again (`daq.bus.link`)."""

    name: str
    """The bus, for the operator."""
    bitrate: int
    """As configured, bit/s."""
    connected: bool
    """Whether a source is open."""
    error: str
    advice: str
    """`error`, `advice`: why none is, and what to do; empty while connected."""
    heartbeat_s: float
    """Monotonic time of the reader's last turn, s; before the first, when it was made."""
    reopened: int
    """How often the bus came back."""
    losses: SourceLosses
    """Summed over all sources so far."""
    interface_down: bool = False
    """Whether a source is open on an interface that somebody took down."""


class FrameSource(Protocol):
    """A bus to be read in blocks.

    `read` and `close` belong to one thread at a time; `losses` may be asked from any.
    """

    @property
    def name(self) -> str:
        """The bus, for messages to the operator."""

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames that are there; wait up to `timeout_s` for the first.

        Raises
        ------
        BusError
            If the bus has gone.  Frames read before that have been returned.
        """

    def losses(self) -> SourceLosses:
        """Return what was lost since the source was opened."""

    def close(self) -> None:
        """Release the interface; never raises."""


@runtime_checkable
class Interface(FrameSource, Protocol):
    """A source on a network interface, which can be taken down and up while it is open."""

    @property
    def interface_down(self) -> bool:
        """Whether it was taken down, and no frame has come since."""
