"""Watches each bus: connection, traffic, load, and the errors of its controller."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.frames import FrameBatch, FrameFlag
from dbc.words import counted

from ..bus.error_frames import ControllerState, ErrorTally, tally_error_frames
from ..bus.source import LinkFacts, SourceLosses
from ..control.messages import BusState, BusStatus
from .texts import Counts, fault

WINDOW_S = 1.0
"""Length of the window over which rates are taken, s."""
_CALM_S = 2.0
"""Time without an error, s, after which a controller that receives counts as error-active again:
many drivers do not report the change."""
_FULL_LOAD = 0.95
"""Load from which a bus counts as full: its frames of lowest priority are never sent."""
DEAD = ("disconnected", "bus_off", "interface_down", "bus_silent", "check_bitrate")
"""Codes of alarms on a bus that delivers no good frame."""


@dataclass(frozen=True, slots=True)
class _BusCycle:
    """The frames of a bus in one cycle of the recorder."""

    now_s: float  # monotonic
    good: int
    errors: int  # numbers of good frames and of error frames
    bits: float  # of the good frames on the wire
    last_ns: int  # latest time stamp until this cycle; 0 before the first


@dataclass(slots=True)
class BusWatch:
    """The history of one bus; it begins anew when another link takes its place."""

    name: str
    good_s: float
    """Monotonic time of the last good frame, s; at least that since which it is connected."""
    frame_s: float = float("inf")
    """Monotonic time of the last good frame, also before the bus was lost, s; infinite before the
    first."""
    error_s: float = float("-inf")
    """Monotonic time of the last error frame, s."""
    frames: int = 0
    error_frames: int = 0
    recent: list[_BusCycle] = field(default_factory=list)
    """Of the last cycle before the last second, and of each cycle since then."""
    last_ns: int = 0
    """Latest time stamp, ns."""
    controller: ControllerState | None = None
    """State that the controller reported last; None if it reported none."""
    tx_errors: int | None = None
    rx_errors: int | None = None
    error_text: str = ""
    """The last error frame, in words."""
    losses: SourceLosses = field(default_factory=SourceLosses)
    """Losses that the source had counted in the last cycle."""

    def advance(
        self,
        link: LinkFacts,
        batch: FrameBatch,
        bits: NDArray[np.float64],
        now_s: float,
        counts: Counts,
    ) -> None:
        """Process the frames of this bus, with their lengths on the wire; add to the counts."""
        t_ns, n = batch.t_ns, len(batch)
        error_rows = np.flatnonzero(batch.flags & np.uint16(FrameFlag.ERROR))
        good = n - len(error_rows)
        tally = tally_error_frames(batch.select(error_rows)) if len(error_rows) else None
        self.error_text = (tally.text if tally else "") or self.error_text
        steps_ns = np.diff(t_ns, prepend=self.last_ns)
        losses, before = link.losses, self.losses
        overruns = tally.overruns if tally else 0
        counts["overrun", self.name] = losses.dropped - before.dropped + overruns, ""
        counts["garbled", self.name] = losses.garbled - before.garbled, ""
        counts["time_back", self.name] = int(np.count_nonzero(steps_ns < 0)), ""
        counts["error_frames", self.name] = len(error_rows), self.error_text
        counts["bus_off", self.name] = tally.bus_off if tally else 0, self.error_text
        self.losses = losses
        if n and not self.last_ns:  # a bus has no time stamp before its first frame
            self.recent = [replace(cycle, last_ns=int(t_ns[0])) for cycle in self.recent]
        self.last_ns = int(t_ns[-1]) if n else self.last_ns
        good_bits = float(bits.sum()) - float(bits[error_rows].sum())
        old = [cycle for cycle in self.recent if cycle.now_s <= now_s - WINDOW_S]
        self.recent = self.recent[max(len(old) - 1, 0) :]
        self.recent.append(_BusCycle(now_s, good, len(error_rows), good_bits, self.last_ns))
        self.frames += good
        self.error_frames += len(error_rows)
        self.frame_s = now_s if good else self.frame_s
        self.good_s = now_s if good or not link.connected else self.good_s
        self.error_s = now_s if tally else self.error_s
        if link.connected:
            self._follow_controller(tally, error_rows, n, now_s)
        else:  # a controller that was opened again has a new state
            self.controller = self.tx_errors = self.rx_errors = None

    def _follow_controller(
        self, tally: ErrorTally | None, error_rows: NDArray[np.intp], n: int, now_s: float
    ) -> None:
        """Take the controller's state from error frames, or end it when it is disproven."""
        state_row = -1  # of the last frame that reports a state
        if tally is not None:
            if tally.state is not None:
                self.controller, state_row = tally.state, int(error_rows[tally.state_row])
            if tally.tx_errors is not None:
                self.tx_errors, self.rx_errors = tally.tx_errors, tally.rx_errors
        received_after = n - 1 - state_row > int(np.count_nonzero(error_rows > state_row))
        is_calm = now_s - self.error_s >= _CALM_S and self.good_s > self.error_s
        proven = received_after if self.controller is ControllerState.BUS_OFF else is_calm
        if self.controller is not None and proven:
            self.controller = ControllerState.ACTIVE
            self.tx_errors = self.rx_errors = None

    def status(self, link: LinkFacts, silent_s: float, now_s: float) -> BusStatus:
        """Return the status of the bus."""
        first, last, cycles = self.recent[0], self.recent[-1], self.recent[1:]
        # A replay faster than real time does not load a bus: its time stamps give the time it took.
        stamped_s = (last.last_ns - first.last_ns) * 1e-9 if first.last_ns else 0.0
        span_s = max(now_s - first.now_s, stamped_s, WINDOW_S / 10)
        state = BusState.OK
        if not link.connected:
            state = BusState.DISCONNECTED
        elif self.controller is ControllerState.BUS_OFF:
            state = BusState.BUS_OFF
        elif now_s - self.good_s >= silent_s:
            state = BusState.SILENT
        elif self.controller is ControllerState.PASSIVE:
            state = BusState.ERROR_PASSIVE
        return BusStatus(
            name=self.name,
            state=state,
            load=sum(cycle.bits for cycle in cycles) / span_s / link.bitrate,
            frames_per_s=sum(cycle.good for cycle in cycles) / span_s,
            frames=self.frames,
            error_frames=self.error_frames,
            reopened=link.reopened,
            tx_errors=self.tx_errors,
            rx_errors=self.rx_errors,
        )

    def symptoms(
        self, link: LinkFacts, status: BusStatus, silent_s: float, now_s: float
    ) -> Iterable[Finding]:
        """Yield the faulty states of the bus; counted faults are not among them."""
        name, quiet = self.name, f"{now_s - self.good_s:.1f} s"
        if status.state is BusState.DISCONNECTED:
            if link.error or now_s - link.heartbeat_s >= silent_s:  # else it is being opened
                yield fault("disconnected", name, link.error or "not connected", link.advice)
            return
        if status.state is BusState.BUS_OFF:
            yield fault("bus_off", name, self.error_text)
            return
        errors = sum(cycle.errors for cycle in self.recent)
        if link.interface_down:
            advice = f"`sudo ip link set {name.split()[-1]} up` brings it up again"
            yield fault("interface_down", name, "the interface is down", advice)
        elif status.state is BusState.SILENT and errors:
            frames = counted(errors, "error frame")
            text = f"{frames} in the last second and no good frame for {quiet}"
            yield fault("check_bitrate", name, text)
        elif status.state is BusState.SILENT:
            yield fault("bus_silent", name, f"no frame for {quiet}")
        elif status.load >= _FULL_LOAD:
            text = f"load {status.load:.0%} of {link.bitrate / 1e3:g} kbit/s"
            yield fault("bus_full", name, text)
        if self.controller is ControllerState.PASSIVE:
            text = self.error_text
            if self.tx_errors is not None:
                received = counted(self.rx_errors or 0, "receive error")
                text = f"{self.tx_errors} transmit and {received} counted"
            yield fault("error_passive", name, text)
