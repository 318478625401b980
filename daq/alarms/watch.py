"""Watches the recording: a pure fold over the cycles of a recorder, ten per second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from dbc import Codec
from dbc.frames import FrameBatch
from dbc.samples import Decoded

from ..bench.config import RecorderConfig
from ..bus.source import HopLosses, LinkFacts
from ..clocks import Now
from ..control.messages import (
    Alarm,
    BusState,
    BusStatus,
    DiskStatus,
    QueueStatus,
    StorageStatus,
)
from ..runs import Event
from ..samples.health import HealthState
from ..samples.mapping import MappedChannel
from .buses import BusWatch, advance_buses, bus_status, bus_symptoms
from .causes import Wiring, causes, dead_bus
from .debounce import Ledger
from .host import CLOCK_STEP_S, dropped_since, host_symptoms
from .inputs import Window, fault
from .messages import MessagesWatch, advance_messages, alive, message_symptoms
from .signals import SignalsWatch, advance_signals, signal_symptoms

CLOCK_STEP = "clock_step"
"""Code of the event that marks a step of the host's clock; its value is the step, s."""
_CLOCK_SHOWN_S = 3.0
QUIET_S = 0.4
"""Time without a good frame, s, from which a bus is quiet.  It is longer than the half second after
which the alarm on its messages comes, and shorter than the time for which an alarm is held after
the bus has come back."""


@dataclass(frozen=True, slots=True)
class Cycle:
    """The input of one cycle of the recorder."""

    now: Now
    """The host's clocks."""
    batch: FrameBatch
    """Frames received; may be empty."""
    decoded: Decoded | None
    """Samples of these frames; None if they were not decoded."""
    health: HealthState
    """The sensors' counters after this block."""
    links: Sequence[LinkFacts]
    """The buses, in the order of their numbers."""
    hops: HopLosses
    """Cumulative counts of losses."""
    disk: DiskStatus
    """Published status of the disk."""
    queue: QueueStatus
    """Published status of the queue."""
    storage: StorageStatus = field(default_factory=StorageStatus)
    """Counts of frames that arrived and that are stored."""
    failed: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Parts of the recorder that were switched off after errors, with reasons."""


@dataclass(frozen=True, slots=True)
class AlarmState:
    """State of the watch; the default is the initial state."""

    buses: tuple[BusStatus, ...] = ()
    """State of each bus."""
    sensors_alive: int = 0
    """Number of messages with channels of the bench that are received."""
    sensors_expected: int = 0
    """Number of messages that carry channels of the bench."""
    ledger: Ledger = field(default_factory=Ledger)
    """Alarms that last or ended recently."""
    window: Window = field(default_factory=Window)
    """Counts of the last second."""
    bus_watches: tuple[BusWatch, ...] = ()
    """History of each bus."""
    messages: MessagesWatch = field(default_factory=MessagesWatch)
    """History of the messages."""
    signals: SignalsWatch = field(default_factory=SignalsWatch)
    """History of the channels."""
    clock_offset_ns: int | None = None
    """Wall clock minus monotonic clock at the first cycle or after the last step, ns."""
    clock_step_s: float = 0.0
    """The last step of the wall clock, s."""
    clock_stepped_s: float = float("-inf")
    """Monotonic time of the last step, s."""
    queue_dropped: int = 0
    """Number of frames that the queue had dropped by the last cycle."""
    t_ns: int = 0
    """Time stamp of the last cycle's events, ns."""

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The current alarms, in order of severity."""
        return self.ledger.alarms

    @property
    def causes(self) -> tuple[Alarm, ...]:
        """The alarms for a person: one for each cause, the worst first."""
        return causes(self.alarms, self._wiring)

    @property
    def dead_bus(self) -> Alarm | None:
        """The alarm on a bus with channels of the bench that delivers no good frame."""
        return dead_bus(self.causes, self._wiring)

    @property
    def _wiring(self) -> Wiring:
        names = [bus.name for bus in self.buses]
        homes = {name: each.home for name, each in self.messages.known.items()}
        return Wiring(
            {name: names[home] for name, home in homes.items() if home < len(names)},
            {m.channel.name: m.message.name for m in self.signals.mapped},
            {
                watch.name: round(watch.frame_s * 1e9) + (self.clock_offset_ns or 0)
                for watch in self.bus_watches
                if watch.frame_s is not None and self.messages.turn_s - watch.frame_s >= QUIET_S
            },
        )

    @property
    def overloaded(self) -> tuple[str, ...]:
        """Channels that reached the end of their range since `acknowledged`."""
        return self.signals.overloaded


def watch(
    config: RecorderConfig,
    codec: Codec,
    mapped: Sequence[MappedChannel],
    state: AlarmState,
    cycle: Cycle,
) -> tuple[AlarmState, tuple[Event, ...]]:
    """Process one cycle.

    `mapped` is the same object in each cycle, as long as the bench's channels are the same; `state`
    is the result of the last call, `AlarmState()` at first.  Returns the state after the cycle, and
    events: `alarm` and `alarm_end` with the text "CODE SUBJECT: TEXT", and `clock_step`.
    """
    now_s = cycle.now.monotonic_s
    t_ns = int(cycle.batch.t_ns[-1]) if len(cycle.batch) else state.t_ns or cycle.now.wall_ns
    buses, bus_counts = advance_buses(state.bus_watches, cycle.links, cycle.batch, now_s)
    messages, message_counts = advance_messages(
        state.messages, codec, cycle.batch, cycle.decoded, cycle.health, now_s
    )
    signals, signal_counts = advance_signals(state.signals, mapped, cycle.decoded)
    dropped = dropped_since(state.queue_dropped, cycle.hops.queue_dropped)
    window = state.window.advanced(
        now_s, {**bus_counts, **message_counts, **signal_counts, **dropped}
    )
    state, events = _clock(state, cycle.now, t_ns)

    silent_s = config.silent_s
    pairs = list(zip(buses, cycle.links, strict=True))
    statuses = tuple(bus_status(each, link, silent_s, now_s) for each, link in pairs)
    healthy = [status.state in (BusState.OK, BusState.ERROR_PASSIVE) for status in statuses]
    expected = tuple(dict.fromkeys(m.message.name for m in mapped))
    names = [link.name for link in cycle.links]
    symptoms = host_symptoms(config, cycle.disk, cycle.queue, cycle.failed, cycle.storage)
    for (each, link), status in zip(pairs, statuses, strict=True):
        symptoms += bus_symptoms(each, link, status, silent_s, now_s)
    symptoms += message_symptoms(messages, codec, expected, names, healthy, now_s)
    symptoms += signal_symptoms(signals)
    if now_s - state.clock_stepped_s <= _CLOCK_SHOWN_S:
        text = f"the host's clock was set by {state.clock_step_s:+.3f} s"
        symptoms.append(fault("clock_step", "", text))
    counted = window.numbers(now_s)
    symptoms += window.symptoms(counted)
    numbers = {**counted, ("clock_step", ""): (int(now_s == state.clock_stepped_s), 1)}
    ledger, alarm_events = state.ledger.advanced(symptoms, numbers, cycle.now, t_ns)
    after = replace(
        state,
        buses=statuses,
        sensors_alive=alive(messages, expected, now_s),
        sensors_expected=len(expected),
        ledger=ledger,
        window=window,
        bus_watches=buses,
        messages=messages,
        signals=signals,
        queue_dropped=cycle.hops.queue_dropped,
        t_ns=t_ns,
    )
    return after, (*events, *alarm_events)


def acknowledged(state: AlarmState) -> AlarmState:
    """Return the state with the overload lamps off."""
    return replace(state, signals=replace(state.signals, overloaded=()))


def reconfigured(state: AlarmState) -> AlarmState:
    """Return the state for other channels; earlier counts do not raise alarms again."""
    messages = MessagesWatch(missing=state.messages.missing)
    return replace(
        state, messages=messages, signals=SignalsWatch(overloaded=state.signals.overloaded)
    )


def _clock(state: AlarmState, now: Now, t_ns: int) -> tuple[AlarmState, tuple[Event, ...]]:
    offset_ns = now.wall_ns - round(now.monotonic_s * 1e9)
    if state.clock_offset_ns is None:
        return replace(state, clock_offset_ns=offset_ns), ()
    step_s = (offset_ns - state.clock_offset_ns) * 1e-9
    if abs(step_s) <= CLOCK_STEP_S:
        return state, ()
    event = Event(t_ns, CLOCK_STEP, step_s, "the host's clock was set")
    return replace(
        state, clock_offset_ns=offset_ns, clock_step_s=step_s, clock_stepped_s=now.monotonic_s
    ), (event,)
