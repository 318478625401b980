"""Watches buses, channels and messages, and yields their faults of each cycle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.codec import Decoded, MessageLayout, Quality, Samples
from dbc.frames import FrameBatch, FrameFlag
from dbc.words import Finding, counted

from ..bus.error_frames import ControllerState, ErrorClass, ErrorFrame, error_frames_of
from ..bus.source import LinkFacts
from ..channels import LARGEST
from ..control.messages import BusState, BusStatus
from ..samples.converter import HealthState
from ..samples.mapping import MappedChannel
from .texts import Counts, fault

# Watches each bus: connection, traffic, load, and the errors of its controller --------------------

WINDOW_S = 1.0
"""Length of the window over which rates are taken, s."""
DEAD = ("disconnected", "bus_off", "interface_down", "bus_silent", "check_bitrate")
"""Codes of alarms on a bus that delivers no good frame."""


@dataclass(frozen=True, slots=True)
class _BusCycle:
    """The frames of a bus in one cycle of the recorder."""

    now_s: float  # monotonic time of the cycle
    n_good: int  # good frames
    n_errors: int  # error frames
    bits: float  # of the good frames on the wire
    last_ns: int  # latest time stamp until this cycle; 0 before the first


@dataclass(slots=True)
class BusWatch:
    """The history of one bus; it begins anew when another link takes its place."""

    link: LinkFacts
    """State of the link in the last cycle."""
    good_s: float
    """Monotonic time of the last good frame, s; at least that since which it is connected."""
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

    def advance(
        self,
        link: LinkFacts,
        batch: FrameBatch,
        bits: NDArray[np.float64],
        now_s: float,
        counts: Counts,
    ) -> None:
        """Add the frames of this bus to its history, and their faults to the counts.

        `bits`: length of each frame on the wire.
        """
        t_ns = batch.t_ns
        error_rows = np.flatnonzero(batch.flags & np.uint16(FrameFlag.ERROR))
        n_errors = len(error_rows)
        n_good = len(batch) - n_errors
        errors = error_frames_of(batch.select(error_rows)) if n_errors else []
        if errors:
            self.error_text, self.error_s = errors[-1].text, now_s
        losses, earlier = link.losses, self.link.losses
        overruns = sum(error.overrun for error in errors)
        bus_off = sum(ErrorClass.BUS_OFF in error.classes for error in errors)
        counts["overrun", link.name] = losses.bus_dropped - earlier.bus_dropped + overruns, ""
        counts["garbled", link.name] = losses.bus_garbled - earlier.bus_garbled, ""
        counts["error_frames", link.name] = n_errors, self.error_text
        counts["bus_off", link.name] = bus_off, self.error_text
        self.link = link
        if len(t_ns) and not self.last_ns:  # a bus has no time stamp before its first frame
            self.recent = [replace(cycle, last_ns=int(t_ns[0])) for cycle in self.recent]
        self.last_ns = int(t_ns[-1]) if len(t_ns) else self.last_ns
        good_bits = float(bits.sum()) - float(bits[error_rows].sum())
        n_old = sum(cycle.now_s <= now_s - WINDOW_S for cycle in self.recent)
        self.recent = self.recent[max(n_old - 1, 0) :]  # the last of the old ones begins the window
        self.recent.append(_BusCycle(now_s, n_good, n_errors, good_bits, self.last_ns))
        self.frames += n_good
        self.error_frames += n_errors
        self.good_s = now_s if n_good or not link.connected else self.good_s
        if link.connected:
            self._follow_controller(errors, now_s)
        else:  # a controller that was opened again has a new state
            self.controller = self.tx_errors = self.rx_errors = None

    def _follow_controller(self, errors: list[ErrorFrame], now_s: float) -> None:
        """Set the controller's state from error frames, or to active when good frames prove it."""
        for error in errors:
            self.controller = error.state or self.controller
            if error.tx_errors is not None:
                self.tx_errors, self.rx_errors = error.tx_errors, error.rx_errors
        receives = self.good_s > self.error_s  # good frames in a later cycle than the last error
        # Time without an error, s, after which a controller that receives counts as error-active
        # again: many drivers do not report the change.
        is_calm = now_s - self.error_s >= 2.0
        if self.controller and receives and (is_calm or self.controller is ControllerState.BUS_OFF):
            self.controller = ControllerState.ACTIVE
            self.tx_errors = self.rx_errors = None

    def status(self, silent_s: float, now_s: float) -> BusStatus:
        """Return the status of the bus, which is silent after `silent_s` without a good frame."""
        begin, end, cycles = self.recent[0], self.recent[-1], self.recent[1:]
        # By time stamps too: a replay faster than real time does not load a bus.
        stamped_s = (end.last_ns - begin.last_ns) * 1e-9 if begin.last_ns else 0.0
        span_s = max(now_s - begin.now_s, stamped_s, WINDOW_S / 10)
        state = BusState.OK
        if not self.link.connected:
            state = BusState.DISCONNECTED
        elif self.controller is ControllerState.BUS_OFF:
            state = BusState.BUS_OFF
        elif now_s - self.good_s >= silent_s:
            state = BusState.SILENT
        elif self.controller is ControllerState.PASSIVE:
            state = BusState.ERROR_PASSIVE
        return BusStatus(
            name=self.link.name,
            state=state,
            load=sum(cycle.bits for cycle in cycles) / span_s / self.link.bitrate,
            frames_per_s=sum(cycle.n_good for cycle in cycles) / span_s,
            frames=self.frames,
            error_frames=self.error_frames,
            reopened=self.link.reopened,
            tx_errors=self.tx_errors,
            rx_errors=self.rx_errors,
        )

    def symptoms(self, status: BusStatus, silent_s: float, now_s: float) -> Iterable[Finding]:
        """Yield the faulty states of the bus; counted faults are not among them.

        A bus that is disconnected or off has no other fault.
        """
        link, name, silence = self.link, self.link.name, f"{now_s - self.good_s:.1f} s"
        if status.state is BusState.DISCONNECTED:
            if link.error or now_s - link.heartbeat_s >= silent_s:  # else it is being opened
                yield fault("disconnected", name, link.error or "not connected", link.advice)
            return
        if status.state is BusState.BUS_OFF:
            yield fault("bus_off", name, self.error_text)
            return
        n_errors = sum(cycle.n_errors for cycle in self.recent[1:])
        if link.interface_down:
            advice = f"`sudo ip link set {name.split()[-1]} up` brings it up again"
            yield fault("interface_down", name, "the interface is down", advice)
        elif status.state is BusState.SILENT and n_errors:
            frames = counted(n_errors, "error frame")
            text = f"{frames} in the last second and no good frame for {silence}"
            yield fault("check_bitrate", name, text)
        elif status.state is BusState.SILENT:
            yield fault("bus_silent", name, f"no frame for {silence}")
        # Load from which a bus counts as full: its frames of lowest priority are never sent.
        elif status.load >= 0.95:
            text = f"load {status.load:.0%} of {link.bitrate / 1e3:g} kbit/s"
            yield fault("bus_full", name, text)
        if self.controller is ControllerState.PASSIVE:
            text = self.error_text
            if self.tx_errors is not None:
                received = counted(self.rx_errors or 0, "receive error")
                text = f"{self.tx_errors} transmit and {received} counted"
            yield fault("error_passive", name, text)


# Watches each channel: without a value, or at the end of its range --------------------------------


class ChannelRange:
    """Range of a channel: that of its bits, or that of the DBC if it is narrower.

    A 16-bit sensor that measures up to 4 g stops there.
    """

    def __init__(self, mapped: MappedChannel) -> None:
        signal, channel = mapped.signal, mapped.channel
        self.name, self.signal = channel.name, channel.signal
        self.low, self.high = signal.span
        if signal.limits is not None:
            least, most = signal.limits
            self.low, self.high = max(self.low, least), min(self.high, most)
        self.text = f"{self.low:g} to {self.high:g} {signal.unit}".rstrip()
        if signal.length == 1:  # a switch is always at one end
            self.low, self.high = -math.inf, math.inf
        gain = abs(mapped.factor * channel.scale)
        self.largest = LARGEST / gain if gain else math.inf
        """Largest magnitude of a reading (`daq.channels.LARGEST`), in the signal's unit."""

    def count(self, samples: Samples, counts: Counts) -> None:
        """Count the samples of a cycle without a value, and those at the end of the range."""
        value, is_usable = samples.value, samples.usable
        is_possible = np.abs(value) <= self.largest  # False where it is not a number
        is_good = is_usable & is_possible
        if not is_good.all():
            is_sentinel = samples.quality & np.uint8(Quality.SENTINEL) != 0
            n_without_value = np.count_nonzero(is_sentinel | (is_usable & ~is_possible))
            counts["no_value", self.name] = int(n_without_value), ""
            value = value[is_good]
        # Many unsigned signals are zero at rest.
        is_at_end = ((value <= self.low) | (value >= self.high)) & (value != 0)
        counts["saturated", self.name] = int(np.count_nonzero(is_at_end)), self.text


# Watches each message: arrival, length, checksum; and frames that no DBC describes ----------------


def _timeout_s(layout: MessageLayout) -> float:
    """Return the longest silence of a message that is not a fault, s: five periods.

    Cycles of the recorder are 0.1 or 0.3 s apart, so silence under 0.5 s may only be a late block.
    If the DBC states no period, it is 2 s.
    """
    return max(5.0 * layout.cycle_s, 0.5) if layout.cycle_s else 2.0


@dataclass(slots=True)
class _LastFrame:
    """When and where the last frame of a message came."""

    layout: MessageLayout
    seen_s: float
    """Monotonic time of the cycle with it, s."""
    bus: int
    """Number of the bus from which it came."""


class Traffic:
    """The history of all traffic by identifier.

    `expected`: messages that carry channels of the bench.  `missing`: number of frames by message
    that are missing already by their counters; it is kept up to date.
    """

    def __init__(self, codec: Codec, expected: Sequence[str], missing: dict[str, int]) -> None:
        self._codec, self._expected, self._missing = codec, expected, missing
        self._began_s: float | None = None  # monotonic time of the first frames
        self._known: dict[str, _LastFrame] = {}
        self._unknown_s: dict[str, float] = {}  # monotonic time of the last frame, by identifier

    def advance(
        self,
        batch: FrameBatch,
        decoded: Decoded | None,
        health: HealthState,
        now_s: float,
        counts: Counts,
    ) -> None:
        """Remember which messages came in a block; add to the counts their faults."""
        for bus, can_id, is_extended, length, n_frames in _kinds_of_frames(batch):
            layout = self._codec.find(can_id, is_extended, bus)
            if layout is None:
                self._unknown_s[f"{can_id:#x}{'x' if is_extended else ''}"] = now_s
                continue
            self._known[layout.name] = _LastFrame(layout, now_s, bus)
            if length != layout.length:
                earlier, _ = counts.get(("wrong_length", layout.name), (0, ""))
                lengths = f"{counted(length, 'byte')}; the DBC says {layout.length}"
                counts["wrong_length", layout.name] = earlier + n_frames, lengths
        # An identifier is present for 2 s after its last frame.
        self._unknown_s = {k: s for k, s in self._unknown_s.items() if now_s - s <= 2.0}
        if decoded is not None and decoded.counts.crc_bad:
            for message in self._codec.messages:
                samples = decoded.samples.get(f"{message.name}.{message.crc}")
                if message.crc and samples is not None:
                    bad = np.count_nonzero(samples.quality & np.uint8(Quality.CRC_BAD))
                    counts["crc_bad", message.name] = int(bad), ""
        for name, counter in health.counters.items():
            counts["counter_gap", name] = counter.missing - self._missing.get(name, 0), ""
            self._missing[name] = counter.missing
        if self._began_s is None and len(batch):
            self._began_s = now_s

    def symptoms(self, delivers: Sequence[bool], now_s: float) -> Iterator[Finding]:
        """Yield the faulty states of the traffic: nothing of the DBC, or silent messages.

        `delivers`: True for each bus with good frames now; messages of another one are not named,
        because the alarm is on the bus.  `now_s`: monotonic time, s.
        """
        delivering = [number for number, has_frames in enumerate(delivers) if has_frames]
        waited_s = now_s - self._began_s if self._began_s is not None else 0.0
        # Before the first of the DBC's messages counts as missing, after 1 s.
        if self._unknown_s and not self._known and waited_s >= 0.8:
            # An alarm names six identifiers at most.
            identifiers = ", ".join(list(self._unknown_s)[:6])
            text = f"no frame of a message of the DBC in {waited_s:.1f} s, but {identifiers}"
            yield fault("none_of_dbc", "", text)
            return
        for name, last in self._known.items():
            silent_s, cycle_s = now_s - last.seen_s, last.layout.cycle_s
            # A message that no channel needs has ended, not failed, after 60 s of silence.
            is_watched = name in self._expected or (cycle_s and silent_s <= 60.0)
            is_late = silent_s > _timeout_s(last.layout)
            if is_watched and is_late and last.bus in delivering:
                due = f"; one is due every {1e3 * cycle_s:.3g} ms" if cycle_s else ""
                yield fault("stale", name, f"no frame for {silent_s:.1f} s{due}")
        for name in self._expected:
            layout = self._codec.message(name)
            is_due = layout.bus in delivering if layout.bus is not None else bool(delivering)
            # The first frame of a message may take at least a second.
            if name not in self._known and is_due and waited_s > max(_timeout_s(layout), 1.0):
                text = f"no frame since the recorder started to listen ({waited_s:.0f} s)"
                yield fault("stale", name, text)

    def buses(self) -> set[int]:
        """Return the numbers of the buses from which the expected messages came last."""
        return {self._known[name].bus for name in self._expected if name in self._known}

    def alive(self, now_s: float) -> int:
        """Return the number of expected messages that are received."""
        received = [self._known[name] for name in self._expected if name in self._known]
        return sum(now_s - last.seen_s <= _timeout_s(last.layout) for last in received)


def _kinds_of_frames(batch: FrameBatch) -> list[tuple[int, int, bool, int, int]]:
    """Return bus, identifier, whether it is extended, length and number of like data frames."""
    no_data = np.uint16(FrameFlag.ERROR | FrameFlag.REMOTE)
    data = batch.select((batch.flags & no_data) == 0)
    is_extended = data.flags & np.uint16(FrameFlag.EXTENDED) != 0
    # One number for the four, by which frames are sorted once; an identifier has 29 bits.
    kinds = (data.length.astype(np.int64) << 8 | data.bus) << 1 | is_extended
    _, rows, numbers = np.unique(kinds << 29 | data.can_id, return_index=True, return_counts=True)
    columns = data.bus[rows], data.can_id[rows], is_extended[rows], data.length[rows], numbers
    return list(zip(*(column.tolist() for column in columns), strict=True))
