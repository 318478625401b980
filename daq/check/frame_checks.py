"""Checks the frames of a bench: arrival, rate and integrity of each message, foreign traffic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.crc import CRC_RULES, covered
from dbc.finding import Finding, Severity
from dbc.frames import FrameBatch, FrameFlag
from dbc.layout import MessageLayout
from dbc.samples import Decoded, Quality
from dbc.words import counted, plural

from ..bench.message_rules import CORRECT_MESSAGE
from ..bus.interfaces import wire_bits
from ..channels import Quantity
from ..samples import converter as health
from ..samples.groups import Timekeeping
from ..samples.mapping import MappedChannel
from .result import about, fail, judged, ok, warn

_RATE_WARN, RATE_FAIL = 0.02, 0.10
_LOST_FAIL = 0.01
_CLOCK_WARN, _CLOCK_FAIL = 2e-3, 0.2
_SILENT_S = 0.5
_EXTENDED_KEY = 1 << 29
_BUS_KEY = 1 << 30


@dataclass(frozen=True, slots=True)
class Arrivals:
    """The data frames of one identifier on one bus, or of one message."""

    can_id: int
    """The identifier."""
    is_extended: bool
    """True for 29 bits, false for 11."""
    t_ns: NDArray[np.int64]
    """Arrival times, ns, shape (n,)."""
    length: NDArray[np.uint8]
    """Number of bytes received, shape (n,)."""
    data: NDArray[np.uint8]
    """Payloads."""
    buses: tuple[int, ...]
    """Numbers of the buses on which they came."""

    @property
    def rate_hz(self) -> float:
        """Mean rate, Hz; 0 for fewer than two frames, or if all came at one instant."""
        span_s = float(self.t_ns[-1] - self.t_ns[0]) * 1e-9 if len(self.t_ns) > 1 else 0.0
        return (len(self.t_ns) - 1) / span_s if span_s > 0 else 0.0

    @property
    def usual_length(self) -> int:
        """The most frequent number of bytes."""
        return int(np.argmax(np.bincount(self.length)))


@dataclass(frozen=True, slots=True)
class FrameTable:
    """All traffic by message, or by bus and identifier."""

    known: dict[str, Arrivals]
    """Messages of the DBC that were received."""
    unknown: tuple[Arrivals, ...]
    """Identifiers that are not in the DBC, the most frequent first."""
    start_ns: int
    """Time stamp of the first frame, ns."""
    end_ns: int
    """Time stamp of the last frame, ns."""
    bits: Mapping[int, float]
    """Estimated number of bits on the wire of each bus."""
    frames: Mapping[int, int]
    """Number of data frames of each bus."""

    @property
    def seconds(self) -> float:
        """Time between first and last frame, s."""
        return (self.end_ns - self.start_ns) * 1e-9


def frame_table(messages: Sequence[MessageLayout], frames: FrameBatch) -> FrameTable:
    """Sort the data frames of a recording, which must not be empty, by message."""
    special = np.uint16(FrameFlag.ERROR | FrameFlag.REMOTE)
    data = frames.select((frames.flags & special) == 0)
    extended = (data.flags & np.uint16(FrameFlag.EXTENDED)) != 0
    index, _, _ = Codec(tuple(messages)).classify(data)
    stranger = index == len(messages)
    key = data.can_id.astype(np.int64) + _EXTENDED_KEY * extended
    key = np.where(
        stranger, key + _BUS_KEY * data.bus.astype(np.int64), -1 - index.astype(np.int64)
    )
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    known, unknown = {}, []
    for one, rows in zip(keys.tolist(), np.split(order, first[1:]), strict=False):
        part = data.select(rows)
        is_extended, can_id = divmod(one % _BUS_KEY, _EXTENDED_KEY)
        if one < 0:
            message = messages[-1 - one]
            is_extended, can_id = message.is_extended, message.can_id
        buses = tuple(np.unique(part.bus).tolist())
        arrivals = Arrivals(can_id, bool(is_extended), part.t_ns, part.length, part.data, buses)
        if one < 0:
            known[message.name] = arrivals
        else:
            unknown.append(arrivals)
    unknown.sort(key=lambda a: -len(a.t_ns))
    bits, number = np.bincount(data.bus, wire_bits(data)), np.bincount(data.bus)
    present = np.flatnonzero(number).tolist()
    return FrameTable(
        known,
        tuple(unknown),
        int(frames.t_ns.min()),
        int(frames.t_ns.max()),
        {bus: float(bits[bus]) for bus in present},
        {bus: int(number[bus]) for bus in present},
    )


def id_text(a: Arrivals) -> str:
    """Return an identifier as text, with a final x if it has 29 bits."""
    return f"{a.can_id:#x}" + ("x" if a.is_extended else "")


def mixed_messages(messages: Sequence[MessageLayout], frames: FrameBatch) -> tuple[str, ...]:
    """Return the messages that come on several buses, so that two sensors are read as one."""
    if not len(frames):
        return ()
    known = frame_table(messages, frames).known
    return tuple(m.name for m in messages if m.name in known and len(known[m.name].buses) > 1)


def check_messages(
    mapped: Sequence[MappedChannel], keeping: Timekeeping, table: FrameTable, decoded: Decoded
) -> list[Finding]:
    """Check every message that carries a channel or binds a sample set."""
    carriers = {sample_set.carrier[0] for sample_set in keeping.sets}
    used = {m.message.name for m in mapped if m.channel.quantity is not Quantity.UNUSED}
    names = dict.fromkeys([*(m.message.name for m in mapped), *sorted(carriers)])
    counters = health.advance(
        tuple(keeping.messages.values()), health.HealthState(), decoded
    ).counters
    lines: list[Finding] = []
    for name in names:
        message, arrivals = keeping.messages[name], table.known.get(name)
        if arrivals is None:
            verdict = Severity.ERROR if name in used | carriers else Severity.WARNING
            lines += about(f"message {name}", [_missing_line(message, table.unknown, verdict)])
            continue
        counter = counters.get(name)
        sent = len(arrivals.t_ns) + (counter.missing if counter else 0)
        found = [
            *_bus_lines(arrivals, Severity.ERROR if name in used | carriers else Severity.WARNING),
            *_rate_lines(message, arrivals, sent, table, name in keeping.clocks),
            *_length_lines(message, arrivals),
            *_checksum_lines(message, arrivals, decoded),
            *(_counter_lines(message, counter, decoded) if counter else ()),
            *_clock_lines(message, keeping, decoded),
        ]
        rate = arrivals.rate_hz * sent / len(arrivals.t_ns)
        figures = {"rate_hz": rate, "jitter_s": _jitter_s(arrivals), "frames": len(arrivals.t_ns)}
        if not found:
            reason = f"{rate:.1f} Hz, jitter {1e3 * figures['jitter_s']:.2f} ms"
            found = [ok("rate", reason)]
        lines += about(f"message {name}", found, figures)
    return lines


def _bus_lines(arrivals: Arrivals, verdict: Severity) -> list[Finding]:
    if len(arrivals.buses) == 1:
        return []
    reason = f"comes on the buses {' and '.join(map(str, arrivals.buses))}: two sensors read as one"
    advice = "describe each as a [[sensor]] with its bus; for a log, import one with --bus"
    return [judged("mixed_buses", verdict, reason, advice)]


def _missing_line(
    message: MessageLayout, unknown: Sequence[Arrivals], verdict: Severity
) -> Finding:
    width = " with 29 bits" if message.is_extended else ""
    reason = f"no frame with identifier {message.can_id:#x}{width}"
    advice = "is the sensor on, set to this identifier, and set to send?"
    alike = [
        id_text(a)
        for a in unknown
        if a.usual_length == message.length
        and (message.cycle_s is None or abs(a.rate_hz * message.cycle_s - 1) < RATE_FAIL)
    ]
    if alike:
        advice += f" {', '.join(alike[:3])} has its length and rate"
    return judged("absent", verdict, reason, advice)


def _jitter_s(arrivals: Arrivals) -> float:
    """Return the largest deviation of 99 of 100 intervals from the usual one, s."""
    if len(arrivals.t_ns) < 3:
        return 0.0
    interval = np.diff(arrivals.t_ns) * 1e-9
    return float(np.quantile(np.abs(interval - np.median(interval)), 0.99))


def _rate_lines(
    message: MessageLayout, arrivals: Arrivals, sent: int, table: FrameTable, has_time: bool
) -> list[Finding]:
    rate, found = arrivals.rate_hz * sent / len(arrivals.t_ns), []
    last_s = (table.end_ns - int(arrivals.t_ns[-1])) * 1e-9
    if last_s > max(_SILENT_S, 10 * (message.cycle_s or 0.0)):
        reason = f"silent for the last {last_s:.2f} s"
        found.append(fail("stale", reason, "check plug and power"))
    if message.cycle_s is None:
        if message.counter is not None and not has_time and rate > 0:
            reason = f"{rate:.1f} Hz; without a cycle time its counter gives no sample times"
            advice = f"state cycle_ms = {1e3 / rate:.3g} for it"
            found.append(warn("no_cycle", reason, advice))
        return found
    expected = 1 / message.cycle_s
    off = rate / expected - 1
    if abs(off) > _RATE_WARN:
        verdict = Severity.ERROR if abs(off) > RATE_FAIL else Severity.WARNING
        reason = f"{rate:.1f} Hz instead of {expected:.1f} Hz"
        advice = f"set the sensor's rate, or state cycle_ms = {1e3 / max(rate, 1e-3):.3g} for it"
        found.append(judged("rate", verdict, reason, advice))
    jitter_s = _jitter_s(arrivals)
    if message.counter is None and not has_time and jitter_s > message.cycle_s / 2:
        reason = f"frames arrive up to {1e3 * jitter_s:.2f} ms off their cycle"
        advice = "its clock fits the least delayed frames: prefer a counter or hardware stamps"
        found.append(warn("jitter", reason, advice))
    return found


def _length_lines(message: MessageLayout, arrivals: Arrivals) -> list[Finding]:
    n, short = len(arrivals.length), int(np.sum(arrivals.length < message.length))
    long = int(np.sum(arrivals.length > message.length))
    sizes = "/".join(str(v) for v in np.unique(arrivals.length[arrivals.length != message.length]))
    sizes_text = f"have {sizes} bytes; the DBC says {message.length}"
    if short:
        return [
            fail("length", f"{short} of {n} frames {sizes_text}", "correct the length, or the DBC")
        ]
    if long:
        return [
            warn("length", f"{long} of {n} frames {sizes_text}", "the excess bytes are not decoded")
        ]
    return []


def _checksum_lines(message: MessageLayout, arrivals: Arrivals, decoded: Decoded) -> list[Finding]:
    if message.crc is None:
        return []
    quality = decoded[f"{message.name}.{message.crc}"].quality
    n, bad = len(quality), int(np.sum((quality & Quality.CRC_BAD) != 0))
    if not bad:
        return []
    have = plural(bad, "has", "have")
    reason = f"{bad} of {n} frames {have} a wrong checksum ({message.crc_rule})"
    others = fitting_rules(arrivals, message.signal(message.crc).first_byte, message.length)
    if others:
        return [fail("checksum", reason, f"state crc_rule = {others[0]!r}, which matches")]
    if bad > n / 2:
        return [fail("checksum", reason, f"no rule matches ({', '.join(CRC_RULES)}): leave it out")]
    verdict = Severity.ERROR if bad > _LOST_FAIL * n else Severity.WARNING
    return [judged("checksum", verdict, reason, "check wiring and power of the sensor")]


def fitting_rules(arrivals: Arrivals, byte: int, length: int) -> list[str]:
    """Return the checksum rules that all frames of full length pass, if that cannot be chance."""
    whole = arrivals.data[arrivals.length == length]
    whole = np.unique(whole, axis=0)
    if len(whole) < 4:  # a wrong rule passes one frame in 256
        return []
    head = covered(whole, byte, length)
    return [n for n, rule in CRC_RULES.items() if np.array_equal(rule(head), whole[:, byte])]


def _counter_lines(
    message: MessageLayout, counter: health.CounterHealth, decoded: Decoded
) -> list[Finding]:
    assert message.counter is not None  # ensured by health.advance
    name = message.counter.signal
    samples = decoded[f"{message.name}.{name}"]
    value = samples.value[samples.usable]
    if len(value) > 10 and np.all(value == value[0]):
        reason = f"the counter {name} does not change from {value[0]:.0f}"
        return [fail("counter", reason, "the sensor hangs, or this is not a counter")]
    found: list[Finding] = []
    n = counter.received
    step = np.diff(value)
    if len(step) and np.any(value >= message.counter.modulus):
        reason = (
            f"the counter {name} reaches {value.max():.0f}, beyond {message.counter.modulus - 1}"
        )
        return [fail("counter", reason, "correct counter_modulus")]
    if counter.missing:
        verdict = Severity.ERROR if counter.missing > _LOST_FAIL * n else Severity.WARNING
        reason = (
            f"{counted(counter.missing, 'frame is', 'frames are')} missing "
            f"according to the counter {name} (of {n})"
        )
        advice = "frames are lost on the way, or the counter counts something else"
        found.append(judged("counter", verdict, reason, advice))
    if counter.restarts:
        reason = f"the counter {name} started again {counter.restarts} times"
        found.append(fail("counter", reason, "the sensor restarts: check its power"))
    return found


def _clock_lines(message: MessageLayout, keeping: Timekeeping, decoded: Decoded) -> list[Finding]:
    clock = keeping.clocks.get(message.name)
    if clock is None:
        return []
    samples = decoded[clock.signal]
    good = samples.usable
    stamp_s, t_s = samples.value[good] * clock.factor, samples.t_ns[good] * 1e-9
    if len(t_s) < 10 or t_s[-1] - t_s[0] <= 0:
        return []
    gap = np.diff(stamp_s) % (clock.wrap * clock.factor)
    rate = float(np.sum(gap) / (t_s[-1] - t_s[0]))
    reason = f"{clock.signal} runs {rate:.4g} times as fast as the bus's clock"
    if abs(rate - 1) > _CLOCK_FAIL:
        return [fail("clock", reason, f"correct time_unit or time_wrap; {CORRECT_MESSAGE}")]
    if abs(rate - 1) > _CLOCK_WARN:
        return [warn("clock", reason, "is the host's clock set while measuring?")]
    return []
