"""A recorder's turns without a recorder: healthy traffic of the shipped bench, and what spoils it.

Two buses: the bench is on the first, the second carries one foreign message.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daq.alarms.watch import Cycle, Watch
from daq.bench.config import RecorderConfig, load_bench
from daq.bus.error_frames import ErrorClass
from daq.bus.source import HopLosses, LinkFacts, Now
from daq.control.messages import Alarm, BusState, DiskStatus
from daq.runs import Event
from daq.samples.converter import HealthState, advance
from daq.samples.mapping import MappedChannel, map_channels
from dbc import Codec, FrameBatch, FrameFlag, parse_codec

START_NS = 1_800_000_000_000_000_000
TURN_S = 0.1
BENCH = load_bench(None)
CODEC = parse_codec(BENCH.dbc_text, "shipped")
MAPPED = map_channels(BENCH.channels, CODEC.messages, "shipped")
ROOMY = DiskStatus(10**12, 0, 0, 0.0)
FOREIGN_ID = 0x700


def frames(
    can_id: int, data: Sequence[bytes], t_ns: int, flags: int = 0, bus: int = 0
) -> FrameBatch:
    """Return frames 10 microseconds apart."""
    n = len(data)
    width = 8 if max(map(len, data), default=0) <= 8 else 64
    padded = b"".join(each.ljust(width, b"\0") for each in data)
    return FrameBatch(
        t_ns + np.arange(n) * 10_000,
        np.full(n, can_id, np.uint32),
        np.full(n, flags, np.uint16),
        np.full(n, bus, np.uint8),
        np.array([len(each) for each in data], np.uint8),
        np.frombuffer(padded, np.uint8).reshape(n, width),
    )


def error_frames(
    classes: ErrorClass, data: bytes, t_ns: int, bus: int = 1, n: int = 1
) -> FrameBatch:
    """Return error frames as the kernel makes them."""
    return frames(int(classes), [data] * n, t_ns, FrameFlag.ERROR, bus)


ENCODED_TURNS = 128
"""Turns after which noise and counters repeat: all numbers of frames are multiples of 256 then."""


@cache
def encoded(message: str) -> NDArray[np.uint8]:
    """Return the payloads of a message over `ENCODED_TURNS`, with noise."""
    layout = CODEC.message(message)
    assert layout.cycle_s is not None
    assert layout.counter is not None
    n = ENCODED_TURNS * round(TURN_S / layout.cycle_s)
    assert n % 256 == 0
    rng = np.random.default_rng(layout.can_id)
    given = {
        s.name: 20 * s.factor * rng.standard_normal(n)
        for s in layout.signals
        if s.name not in (layout.counter.signal, layout.crc)
    }
    return CODEC.encode(message, given, 0)


@cache
def message_turn(name: str, turn: int) -> FrameBatch:
    """Return a turn's frames of one message, from time 0."""
    message = CODEC.message(name)
    assert message.cycle_s is not None
    n = round(TURN_S / message.cycle_s)
    return replace(
        frames(message.can_id, [b""] * n, 0),
        t_ns=np.arange(n) * round(message.cycle_s * 1e9),
        length=np.full(n, message.length, np.uint8),
        data=encoded(name)[turn * n : (turn + 1) * n],
    )


@cache
def encoded_turn(turn: int) -> FrameBatch:
    """Return a turn's frames of all messages, from time 0."""
    return FrameBatch.concatenate([message_turn(m.name, turn) for m in CODEC.messages]).by_time()


class WatchedBench:
    """Turns, one after the other.

    `names`: the buses.  `codec`, `mapped`: of the shipped bench if another is not given.
    """

    def __init__(
        self,
        names: Sequence[str] = ("can0", "can1"),
        codec: Codec = CODEC,
        mapped: Sequence[MappedChannel] = MAPPED,
    ) -> None:
        self._codec = codec
        self.state = Watch(codec, mapped)
        self.events: list[tuple[float, Event]] = []
        self.turns = 0
        self.links = [
            LinkFacts(name, 1_000_000, True, "", "", 0.0, 0, HopLosses()) for name in names
        ]
        self.hops = HopLosses()
        self._health = HealthState()
        self._given = 0  # healthy turns
        self._rng = np.random.default_rng(4)

    @property
    def t_ns(self) -> int:
        """Start of the next turn."""
        return START_NS + self.turns * 100_000_000

    @property
    def now_s(self) -> float:
        """Time since the start, s."""
        return self.turns * TURN_S

    def healthy(
        self,
        without: Sequence[str] = (),
        values: Mapping[str, object] | None = None,
        motion: float = 0.0,
    ) -> FrameBatch:
        """Return a turn's frames of the bench.

        `without`: messages that are not sent.  `values`: instead of noise.  `motion`: amplitude of
        a slow oscillation of all signals, in the signals' units.
        """
        turn, self._given = self._given, self._given + 1
        if not (without or values or motion):
            whole = encoded_turn(turn % ENCODED_TURNS)
            return replace(whole, t_ns=whole.t_ns + self.t_ns)
        parts = []
        for message in CODEC.messages:
            if message.name in without:
                continue
            assert message.cycle_s is not None
            n = round(TURN_S / message.cycle_s)
            start, plain = turn * n, message_turn(message.name, turn % ENCODED_TURNS)
            stamped = replace(plain, t_ns=plain.t_ns + self.t_ns)
            changed = any(signal.startswith(f"{message.name}.") for signal in values or {})
            if not (changed or motion):
                parts.append(stamped)
                continue
            assert message.counter is not None
            swing = motion * np.sin(2 * np.pi * 2.0 * (start + np.arange(n)) * message.cycle_s)
            given = {
                s.name: swing + 20 * s.factor * self._rng.standard_normal(n)
                for s in message.signals
                if s.name not in (message.counter.signal, message.crc)
            }
            for signal, value in (values or {}).items():
                name, _, own = signal.partition(".")
                if name == message.name:
                    given[own] = np.broadcast_to(np.asarray(value, float), n)
            parts.append(replace(stamped, data=CODEC.encode(message.name, given, start)))
        return FrameBatch.concatenate(parts).by_time()

    def turn(self, *batches: FrameBatch, **facts: Any) -> tuple[Event, ...]:
        """Take one turn; without batches, a healthy one."""
        batch = FrameBatch.concatenate(batches) if batches else self.healthy()
        decoded = self._codec.decode(batch)
        self._health = advance(self._codec.messages, self._health, decoded)
        self.turns += 1
        now = Now(START_NS + self.turns * 100_000_000, 5000.0 + self.now_s)
        turn = Cycle(now, batch, decoded, self._health, self.links, self.hops, ROOMY)
        cycle = replace(turn, **facts)
        events = self.state.advance(RecorderConfig(), cycle)
        self.events += [(self.now_s, event) for event in events]
        return events

    def link(self, number: int, **facts: Any) -> None:
        """Change the facts of a link."""
        self.links[number] = replace(self.links[number], **facts)

    @property
    def alarms(self) -> list[Alarm]:
        """Those that last."""
        return list(self.state.alarms)

    def bus_state(self, number: int) -> BusState:
        """Return how a bus is doing."""
        return self.state.buses[number].state

    def alarm(self, code: str, subject: str) -> Alarm | None:
        """Return an alarm that lasts."""
        for alarm in self.state.alarms:
            if (alarm.code, alarm.subject) == (code, subject):
                return alarm
        return None

    def logged(self, code: str) -> list[str]:
        """Return the texts of all events of a code, up to the colon."""
        return [event.text.partition(":")[0] for _, event in self.events if event.code == code]


def foreign(bench: WatchedBench, n: int = 5) -> FrameBatch:
    """Return a turn of the second bus."""
    return frames(FOREIGN_ID, [bytes(8)] * n, bench.t_ns, bus=1)


def both(bench: WatchedBench) -> tuple[FrameBatch, FrameBatch]:
    """Return a healthy turn of both buses."""
    return bench.healthy(), foreign(bench)


def saturating(bench: WatchedBench) -> FrameBatch:
    """Return a turn of the bench in which four samples of the first hub reach 16.3835 g."""
    values = np.zeros(100)
    values[:4] = 16.3835
    return bench.healthy(values={"HUB_Front.acc_fl": values})
