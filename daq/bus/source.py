"""Defines what all buses share: source and link, losses from wire to recorder, this host's time.

Sources only read and stamp frames.  They run in separate threads; if one is kept from reading,
frames are lost in the adapter.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dbc.frames import FrameBatch, FrameFlag
from dbc.words import BumpbenchError

from ..bench.config import BusConfig
from ..runs import Losses

BLOCK_FRAMES = 2048
"""Number of frames at which a block is full; slcan counts bytes instead."""
GATHER_S = 0.01
"""Time, s, for which a source waits for more frames after the first: the cost of a block is shared
by all frames in it, and each frame still has its own time of arrival."""
LONG_GATHER_S = 0.06
"""Time, s, as `GATHER_S`, for interfaces where the kernel stamps and holds the frames in a buffer
of our size: a block of a full bus then has 540 frames."""


REPLUG = "check plug and power, then start again"
"""Advice for a bus that was lost."""


class BusError(BumpbenchError, OSError):
    """A CAN bus that cannot be opened or was lost."""


class HopLosses(NamedTuple):
    """Cumulative counts of one source since it was opened, or of all from the wires to the journal.

    The latter are stored with each block.
    """

    bus_dropped: int = 0
    """Number of frames that the interface reports as lost before they could be read."""
    bus_garbled: int = 0
    """Number of pieces of input that are not a frame."""
    restamped: int = 0
    """Number of frames with an impossible time stamp, which were stamped on arrival instead."""
    queue_dropped: int = 0
    """Number of frames that were read but not recorded because the writer was too far behind."""

    @property
    def of_a_run(self) -> Losses:
        """The lost frames, as losses of a run."""
        return Losses(self.bus_dropped, self.bus_garbled, self.queue_dropped)

    def plus(self, other: HopLosses) -> HopLosses:
        """Return the sums of two counts."""
        return HopLosses(*(a + b for a, b in zip(self, other, strict=True)))

    def since(self, before: HopLosses) -> HopLosses:
        """Return the losses since an earlier count."""
        return HopLosses(*(late - early for late, early in zip(self, before, strict=True)))


@dataclass(frozen=True, slots=True)
class LinkFacts:
    """State of the link to one bus; a source that fails is opened again (`Link`)."""

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
    losses: HopLosses
    """Sum over all sources opened until now."""
    interface_down: bool = False
    """True if a source is open on an interface that was taken down."""


class FrameSource(Protocol):
    """A bus read in blocks.

    `read` and `close` belong to one thread at a time; `losses` may be called from any.
    """

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames received; wait up to `timeout_s` for the first.

        Raises BusError if the bus is lost; earlier calls have returned all frames read before.
        """

    def losses(self) -> HopLosses:
        """Return the losses since the source was opened; by default none."""
        return HopLosses()

    def close(self) -> None:
        """Release the interface, if there is one; never raises."""
        return  # mypy takes an empty body for an abstract method


def wire_bits(frames: FrameBatch) -> NDArray[np.float64]:
    """Return the estimated nominal bit times that each frame takes on the wire, (n,).

    bench.toml has no data bit rate: fast data of FD frames are assumed four times as fast.
    """
    data_bits = np.where(frames.flags & np.uint16(FrameFlag.REMOTE), 0.0, 8.0 * frames.length)
    fast = frames.flags & np.uint16(FrameFlag.BITRATE_SWITCH)
    if np.count_nonzero(fast):
        data_bits /= np.where(fast, 4, 1)
    is_extended = frames.flags & np.uint16(FrameFlag.EXTENDED) != 0
    # A standard frame has 47 bits in addition to its data, an extended one 67; usual payloads need
    # one stuff bit in 30.
    return np.asarray((47 + 20 * is_extended + data_bits) * (31 / 30))


# Times of this host -------------------------------------------------------------------------------
#
# The wall clock may be set in mid-run by an hour, forward or back.  Stamps of this host are on a
# time axis that began with the wall clock and advances with the monotonic one; an event reports
# that the wall clock was set, and the measurements do not show it.


@dataclass(frozen=True, slots=True)
class Now:
    """The host's two clocks, read together at the start of a cycle of the recorder."""

    wall_ns: int
    """UTC, ns since 1970; this clock may be set at any moment."""
    monotonic_s: float
    """Monotonic time, s, from an arbitrary origin; waiting and silence are measured with it."""


def read_clocks() -> Now:
    """Return the time of both clocks of this host."""
    return Now(time.time_ns(), time.monotonic())


STEP_NS = 1_000_000
"""Change of the difference of the clocks, ns, from which the wall clock counts as set; slewing
changes both clocks equally."""
QUEUED_NS = 10_000_000_000
"""Age, ns, at which an older offset is forgotten: no frame waits longer in a buffer."""


class SteadyClock:
    """A clock that starts at its construction; the whole process uses one."""

    def __init__(
        self,
        wall_ns: Callable[[], int] = time.time_ns,
        monotonic_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._wall_ns, self._monotonic_ns = wall_ns, monotonic_ns
        self._lock = threading.Lock()
        self.begin()

    def begin(self, not_before_ns: int = 0) -> None:
        """Start again from the wall clock as it is set now.

        `not_before_ns`: earliest start.  Without a battery the wall clock falls back at each boot,
        and a time must not occur twice within a recording.
        """
        with self._lock:
            monotonic_ns, self._offset_ns = self._clocks()
            self._zero_ns = max(self._offset_ns, not_before_ns - monotonic_ns)
            self._earlier_offsets = list[tuple[int, int]]()  # end, monotonic, and offset until then

    def _clocks(self) -> tuple[int, int]:
        """Return the monotonic time, and how far the wall clock is ahead of it, ns.

        On a busy machine this thread may have to wait between the two: they are then read again, up
        to a hundred times, so that the difference is exact to half of `STEP_NS`.
        """
        for _ in range(100):
            monotonic_ns = self._monotonic_ns()
            offset_ns = self._wall_ns() - monotonic_ns
            if self._monotonic_ns() - monotonic_ns < STEP_NS // 2:
                break
        return monotonic_ns, offset_ns

    def now_ns(self) -> int:
        """Return the time now, ns since 1970."""
        return self._monotonic_ns() + self._zero_ns

    def from_wall(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return stamps of the wall clock on the time axis of this clock, ns, (n,) int64.

        `wall_ns`, (n,): made within the last `QUEUED_NS`; stamps from before and after the wall
        clock was set may be mixed.
        """
        monotonic_ns, offset_ns = self._clocks()
        with self._lock:
            if abs(offset_ns - self._offset_ns) > STEP_NS:
                self._earlier_offsets.append((monotonic_ns, self._offset_ns))
                self._offset_ns = offset_ns
            if self._earlier_offsets and monotonic_ns - self._earlier_offsets[0][0] > QUEUED_NS:
                self._earlier_offsets.pop(0)
            offset_ns, zero_ns = self._offset_ns, self._zero_ns
            offsets = (offset_ns, *(offset for _, offset in self._earlier_offsets))
        if len(offsets) == 1:
            return wall_ns if offset_ns == zero_ns else wall_ns - (offset_ns - zero_ns)
        # Each stamp was made with the offset that gives the latest monotonic time not after now,
        # give or take 5 ms: the two clocks cannot be read at the same instant.
        made_ns = wall_ns[:, None] - np.array(offsets, np.int64)  # (n, offsets), monotonic
        age_ns = monotonic_ns - made_ns
        age_ns = np.where(age_ns >= -5_000_000, age_ns, np.iinfo(np.int64).max)
        likeliest = age_ns.argmin(axis=1)[:, None]
        return np.take_along_axis(made_ns, likeliest, axis=1)[:, 0] + zero_ns


STEADY_CLOCK = SteadyClock()


# Keeps one bus open for weeks ---------------------------------------------------------------------
#
# A link never raises and never ends.  With a missing adapter the recorder is degraded, but its
# start does not fail; the link tries to open an unplugged adapter until it is back.

BACK_OFF_S = (0.1, 2.0)
"""First and longest pause before a bus is opened again, s; each pause is twice the one before."""
SILENT_S = 5.0
"""Silence after the last frame, s, after which a bus is opened again: some drivers (gs_usb) hide
the error of an unplugged device, and stay silent."""
_REPORTS_LOSS = frozenset({"socketcan", "slcan", "virtual", "udp_multicast"})
"""Interfaces that report the loss of their device.  If one were opened again only because the car
is switched off, the first frames after switching on could be lost."""

OpenSource = Callable[[BusConfig, int], FrameSource]


class Link:
    """A bus that is opened again whenever it fails.

    `read` and `close` belong to one thread; `facts` and `halt` may be called from any.

    `index`: number of the bus in its frames.  `open_source`: opens the bus, or raises any exception
    (`daq.bus.interfaces.open_source`).  `clock`: monotonic time, s.
    """

    def __init__(
        self,
        config: BusConfig,
        index: int,
        open_source: OpenSource,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.config = config
        self.index = index
        self._open_source = open_source
        self._clock = clock
        self._halted = threading.Event()
        self._source: FrameSource | None = None
        self._closed_losses = HopLosses()  # of the sources that are closed
        self._pause_s = BACK_OFF_S[0]
        self._next_try_s = self._alive_s = clock()  # due next opening; last opening or frame
        self._had_frames = self._was_open = False
        name = f"{config.interface} {config.channel}".strip()
        none = HopLosses()
        self._facts = LinkFacts(name, config.bitrate, False, "", "", self._alive_s, 0, none)

    def facts(self) -> LinkFacts:
        """Return the state of the link."""
        return self._facts

    def read(self, timeout_s: float) -> FrameBatch:
        """Return the frames received; wait up to `timeout_s` for the first; empty without a source.

        A bus that is not open is opened instead; one that fails or is silent too long is closed.
        """
        frames = FrameBatch.empty()
        if self._source is None:
            self._open(timeout_s)
        else:
            try:
                frames = self._source.read(timeout_s)
            except BaseException as error:  # drivers raise anything, even SystemExit
                self._fail(error)
        now_s = self._clock()
        may_be_lost = self._had_frames and self.config.interface not in _REPORTS_LOSS
        if len(frames):
            self._had_frames, self._alive_s, self._pause_s = True, now_s, BACK_OFF_S[0]
        elif may_be_lost and now_s - self._alive_s >= SILENT_S:
            self._alive_s = now_s
            self._drop()
        down = not len(frames) and getattr(self._source, "interface_down", False)
        self._facts = replace(
            self._facts, heartbeat_s=now_s, losses=self._losses(), interface_down=down
        )
        return frames

    def halt(self) -> None:
        """End a pause between two openings."""
        self._halted.set()

    def close(self) -> None:
        """Close the bus permanently."""
        self._halted.set()
        self._drop()
        self._facts = replace(self._facts, connected=False, losses=self._closed_losses)

    def _open(self, timeout_s: float) -> None:
        """Open the bus once the pause after a failure is over; wait at most `timeout_s` for it."""
        wait_s = self._next_try_s - self._clock()
        if wait_s > 0:
            self._halted.wait(min(wait_s, timeout_s))
        if self._halted.is_set() or self._clock() < self._next_try_s:
            return
        try:
            self._source = self._open_source(self.config, self.index)
        except BaseException as error:  # drivers raise anything here, too
            self._fail(error)
            return
        self._alive_s = self._clock()
        reopened = self._facts.reopened + int(self._was_open)
        self._was_open = True
        self._facts = replace(self._facts, connected=True, error="", advice="", reopened=reopened)

    def _fail(self, error: BaseException) -> None:
        """Close the source after a failure, report why, and set the pause before it is opened."""
        self._drop()
        self._next_try_s = self._clock() + self._pause_s
        self._pause_s = min(2 * self._pause_s, BACK_OFF_S[1])
        problem, advice = repr(error), "please report this"
        if isinstance(error, BusError):
            problem, advice = error.what, error.advice
        elif isinstance(error, OSError):
            problem, advice = error.strerror or str(error), "check plug, power and driver"
        self._facts = replace(self._facts, connected=False, error=problem, advice=advice)

    def _drop(self) -> None:
        """Close the source and keep its counts."""
        if self._source is None:
            return
        self._closed_losses = self._losses()
        source, self._source = self._source, None
        with suppress(BaseException):  # an unplugged device cannot be closed properly
            source.close()

    def _losses(self) -> HopLosses:
        """Return the losses of the open source and of all that were closed."""
        if self._source is not None:
            with suppress(BaseException):
                return self._closed_losses.plus(self._source.losses())
        return self._closed_losses
