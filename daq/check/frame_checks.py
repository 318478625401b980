"""Checks the frames of a bench: load and silence of buses; arrival and integrity of messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dbc import Codec
from dbc.codec import CRC_RULES, Decoded, MessageLayout, Quality, covered
from dbc.frames import FrameBatch, FrameFlag
from dbc.words import Finding, Severity, counted, plural

from ..bench.config import BusConfig
from ..bench.sensors import CORRECT_MESSAGE
from ..bus.source import wire_bits
from ..channels import Quantity
from ..samples import converter as health
from ..samples.mapping import MappedChannel, Timekeeping

OK, WARN, FAIL = Severity.NOTE, Severity.WARNING, Severity.ERROR
Fault = tuple[str, Severity, str, str]
"""Code, severity, text and advice of a finding."""
RATE_FAIL = 0.10
"""Relative deviation of a rate from the cycle that fails."""
_LOST_FAIL = 0.01
"""Ratio of lost or unusable frames to all frames that fails."""
_EXTENDED_KEY, _BUS_KEY = 1 << 29, 1 << 30
"""Weights of the flag of 29 bits and of the bus in a key that is otherwise the identifier."""


def findings(
    subject: str, faults: Iterable[Fault], figures: Mapping[str, float] | None = None
) -> list[Finding]:
    """Return a finding for each fault of one subject; all have the same figures."""
    return [
        Finding(code, severity, text, subject, advice, figures=figures or {})
        for code, severity, text, advice in faults
    ]


@dataclass(frozen=True, slots=True)
class Arrivals:
    """The data frames of one identifier on one bus, or of one message."""

    can_id: int
    is_extended: bool
    """True for 29 bits, false for 11."""
    frames: FrameBatch
    """At least one, in order of arrival."""

    @property
    def buses(self) -> tuple[int, ...]:
        """Numbers of the buses on which they came."""
        return tuple(np.unique(self.frames.bus).tolist())

    @property
    def rate_hz(self) -> float:
        """Mean rate, Hz; 0 for one frame, or if all came at one instant."""
        span_s = float(self.frames.t_ns[-1] - self.frames.t_ns[0]) * 1e-9
        return (len(self.frames) - 1) / span_s if span_s > 0 else 0.0

    @property
    def jitter_s(self) -> float:
        """Largest deviation of 99 of 100 intervals from the usual one, s; 0 for one interval."""
        if len(self.frames) < 3:
            return 0.0
        interval_s = np.diff(self.frames.t_ns) * 1e-9
        return float(np.quantile(np.abs(interval_s - np.median(interval_s)), 0.99))

    def __str__(self) -> str:
        """Return the identifier in hexadecimal, with an x behind it if it has 29 bits."""
        return f"{self.can_id:#x}" + ("x" if self.is_extended else "")


@dataclass(frozen=True, slots=True)
class FrameTable:
    """All traffic by message, or by bus and identifier."""

    known: dict[str, Arrivals]
    """Messages of the DBC that were received."""
    unknown: tuple[Arrivals, ...]
    """Identifiers that are not in the DBC, the most frequent first."""
    data: FrameBatch
    """All frames but error and remote ones, in order of arrival."""
    end_ns: int
    """Time of the last frame of any kind, ns."""
    seconds: float
    """Time from the first frame of any kind to the last, s."""


def frame_table(messages: Sequence[MessageLayout], frames: FrameBatch) -> FrameTable:
    """Return the data frames of a recording by message, unknown ones by bus and identifier.

    `frames`: at least one, of any kind.
    """
    no_data = np.uint16(FrameFlag.ERROR | FrameFlag.REMOTE)
    data = frames.select((frames.flags & no_data) == 0)
    is_extended = (data.flags & np.uint16(FrameFlag.EXTENDED)) != 0
    message_index = Codec(tuple(messages)).classify(data).astype(np.int64)
    frame_keys = data.can_id + _EXTENDED_KEY * is_extended + _BUS_KEY * data.bus.astype(np.int64)
    # Unknown frames keep this key; those of message i have the key -1 - i.
    frame_keys = np.where(message_index == len(messages), frame_keys, -1 - message_index)
    by_key = np.argsort(frame_keys, kind="stable")
    keys, begins = np.unique(frame_keys[by_key], return_index=True)
    known, unknown = {}, []
    # Not strict: without data frames there is no key, but one empty part.
    for key, rows in zip(keys.tolist(), np.split(by_key, begins[1:]), strict=False):
        same_key = data.select(rows)
        arrivals = Arrivals(int(same_key.can_id[0]), bool(is_extended[rows[0]]), same_key)
        if key < 0:
            known[messages[-1 - key].name] = arrivals
        else:
            unknown.append(arrivals)
    unknown.sort(key=lambda arrivals: -len(arrivals.frames))
    end_ns, seconds = int(frames.t_ns.max()), float(np.ptp(frames.t_ns)) * 1e-9
    return FrameTable(known, tuple(unknown), data, end_ns, seconds)


def mixed_messages(messages: Sequence[MessageLayout], frames: FrameBatch) -> tuple[str, ...]:
    """Return the messages that come on several buses, so that two sensors are read as one."""
    known = frame_table(messages, frames).known if len(frames) else {}
    return tuple(m.name for m in messages if m.name in known and len(known[m.name].buses) > 1)


# The buses ----------------------------------------------------------------------------------------


def check_buses(table: FrameTable, error_frames: int, buses: Sequence[BusConfig]) -> list[Finding]:
    """Return lines on each bus as a whole: load, error frames, unknown identifiers."""
    lines = []
    for number, bus in enumerate(buses):
        subject, data = f"bus {bus.label}", table.data.on_buses({number})
        if len(buses) == 1:  # logs number a single bus in different ways
            subject, data = "bus", table.data
        if not len(data):
            text = f"no frame in {table.seconds:.2f} s"
            advice = "check the bus's plug, power and bit rate"
            lines.append(Finding("silent", FAIL, text, subject, advice))
            continue
        most_bits = bus.bitrate * table.seconds
        load = float(np.sum(wire_bits(data))) / most_bits if most_bits > 0 else 0.0
        text = f"{counted(len(data), 'frame')} in {table.seconds:.2f} s"
        text += f", about {100 * load:.0f} % of the bit rate"
        severity, advice = OK, ""
        if load > 0.8:
            advice = "a full bus delays and loses frames: lower the rates or use two buses"
            severity = WARN
        figures = {"frames": len(data), "seconds": table.seconds, "load": load}
        lines.append(Finding("load", severity, text, subject, advice, figures=figures))
    if error_frames:
        advice = "check termination (60 ohm between the wires), bit rate and plugs"
        text = counted(error_frames, "error frame")
        lines.append(Finding("error_frames", WARN, text, "bus", advice))
    if unknown := table.unknown:
        shown = ", ".join(f"{each} ({each.rate_hz:.0f} Hz)" for each in unknown[:6])
        more = f" and {len(unknown) - 6} more" if len(unknown) > 6 else ""
        are = counted(len(unknown), "identifier is", "identifiers are")
        advice = "foreign devices, or the DBC of another bus"
        text = f"{are} not in the DBC: {shown}{more}"
        figures = {"unknown": len(unknown)}
        lines.append(Finding("unknown_id", WARN, text, "bus", advice, figures=figures))
    return lines


# The messages -------------------------------------------------------------------------------------


def check_messages(
    mapped: Sequence[MappedChannel], keeping: Timekeeping, table: FrameTable, decoded: Decoded
) -> list[Finding]:
    """Return lines on every message that carries a channel or numbers the samples of a set."""
    carriers = {sample_set.carrier[0] for sample_set in keeping.sets}
    used = {m.message.name for m in mapped if m.channel.quantity is not Quantity.UNUSED} | carriers
    messages = tuple(keeping.messages.values())
    counters = health.advance(messages, health.HealthState(), decoded).counters
    lines: list[Finding] = []
    for name in dict.fromkeys([*(m.message.name for m in mapped), *sorted(carriers)]):
        message, arrivals = keeping.messages[name], table.known.get(name)
        worst = FAIL if name in used else WARN
        if arrivals is None:
            width = " with 29 bits" if message.is_extended else ""
            text = f"no frame with identifier {message.can_id:#x}{width}"
            advice = "is the sensor on, set to this identifier, and set to send?"
            lines.append(Finding("absent", worst, text, f"message {name}", advice))
            continue
        counter, received = counters.get(name), len(arrivals.frames)
        rate_hz = arrivals.rate_hz * (received + (counter.missing if counter else 0)) / received
        faults = [
            *_rate_faults(message, arrivals, rate_hz, table, name in keeping.clocks),
            *_content_faults(message, arrivals, decoded),
            *(_counter_faults(message, counter, decoded) if counter else ()),
            *_clock_faults(message, keeping, decoded),
        ]
        if len(arrivals.buses) > 1:
            buses = " and ".join(map(str, arrivals.buses))
            advice = "describe each as a [[sensor]] with its bus; for a log, import one with --bus"
            text = f"comes on the buses {buses}: two sensors read as one"
            faults.insert(0, ("mixed_buses", FAIL, text, advice))
        faults = [(code, min(s, worst), text, advice) for code, s, text, advice in faults]
        if not faults:
            text = f"{rate_hz:.1f} Hz, jitter {1e3 * arrivals.jitter_s:.2f} ms"
            faults = [("rate", OK, text, "")]
        figures = {"rate_hz": rate_hz, "jitter_s": arrivals.jitter_s, "frames": received}
        lines += findings(f"message {name}", faults, figures)
    return lines


def _rate_faults(
    message: MessageLayout, arrivals: Arrivals, rate_hz: float, table: FrameTable, has_time: bool
) -> Iterator[Fault]:
    """Yield the faults of silence, of the rate against the cycle time, and of a missing cycle time.

    `rate_hz`: with the frames that the counter shows as missing.  `has_time`: its frames state
    their time, so that its counter needs no cycle time.
    """
    silent_s = (table.end_ns - int(arrivals.frames.t_ns[-1])) * 1e-9
    if silent_s > max(0.5, 10 * (message.cycle_s or 0.0)):  # longer than any jitter
        yield "stale", FAIL, f"silent for the last {silent_s:.2f} s", "check plug and power"
    state_cycle = f"state cycle_ms = {1e3 / rate_hz:.3g} for it" if rate_hz else "check its power"
    if message.cycle_s is None:
        if message.counter is not None and not has_time and rate_hz > 0:
            text = f"{rate_hz:.1f} Hz; without a cycle time its counter gives no sample times"
            yield "no_cycle", WARN, text, state_cycle
    elif (deviation := abs(rate_hz * message.cycle_s - 1)) > 0.02:  # no clock is so bad
        text = f"{rate_hz:.1f} Hz instead of {1 / message.cycle_s:.1f} Hz"
        severity = FAIL if deviation > RATE_FAIL else WARN
        yield "rate", severity, text, f"set the sensor's rate, or {state_cycle}"


def _content_faults(
    message: MessageLayout, arrivals: Arrivals, decoded: Decoded
) -> Iterator[Fault]:
    """Yield the faults of length and checksum."""
    length = arrivals.frames.length
    sizes = "/".join(map(str, np.unique(length[length != message.length])))
    n_short, n_long = np.sum(length < message.length), np.sum(length > message.length)
    of_frames = f"of {len(length)} frames have {sizes} bytes; the DBC says {message.length}"
    if n_short:
        yield "length", FAIL, f"{n_short} {of_frames}", "correct the length, or the DBC"
    elif n_long:
        yield "length", WARN, f"{n_long} {of_frames}", "the excess bytes are not decoded"
    if message.crc is None:
        return
    quality = decoded[f"{message.name}.{message.crc}"].quality
    n_checked, n_wrong = len(quality), int(np.sum((quality & Quality.CRC_BAD) != 0))
    if not n_wrong:
        return
    severity, advice = FAIL, f"no rule matches ({', '.join(CRC_RULES)}): leave it out"
    matching = fitting_rules(arrivals, message.signal(message.crc).first_byte, message.length)
    if matching:
        advice = f"state crc_rule = {matching[0]!r}, which matches"
    elif n_wrong <= n_checked / 2:  # the stated rule is right, and some frames are damaged
        severity = FAIL if n_wrong > _LOST_FAIL * n_checked else WARN
        advice = "check wiring and power of the sensor"
    have = plural(n_wrong, "has", "have")
    text = f"{n_wrong} of {n_checked} frames {have} a wrong checksum ({message.crc_rule})"
    yield "checksum", severity, text, advice


def fitting_rules(arrivals: Arrivals, byte: int, length: int) -> list[str]:
    """Return the checksum rules that all frames of full length pass, if that cannot be chance.

    `byte`: position of the checksum in the payload.  `length`: full length, bytes.
    """
    frames = arrivals.frames
    payloads = np.unique(frames.data[frames.length == length], axis=0)
    if len(payloads) < 4:  # a wrong rule passes one frame in 256, four by chance in 256**4
        return []
    covered_bytes, stated = covered(payloads, byte, length), payloads[:, byte]
    return [name for name, rule in CRC_RULES.items() if np.array_equal(rule(covered_bytes), stated)]


def _counter_faults(
    message: MessageLayout, counter: health.CounterHealth, decoded: Decoded
) -> Iterator[Fault]:
    """Yield the faults of a rolling counter: constant or too large; else with gaps, restarted."""
    assert message.counter is not None  # ensured by health.advance
    name, modulus = f"the counter {message.counter.signal}", message.counter.modulus
    samples = decoded[f"{message.name}.{message.counter.signal}"]
    value = samples.value[samples.usable]
    if len(value) > 10 and np.all(value == value[0]):
        text = f"{name} does not change from {value[0]:.0f}"
        yield "counter", FAIL, text, "the sensor hangs, or this is not a counter"
        return
    if len(value) > 1 and np.any(value >= modulus):
        text = f"{name} reaches {value.max():.0f}, beyond {modulus - 1}"
        yield "counter", FAIL, text, "correct counter_modulus"
        return
    if counter.missing:
        are = counted(counter.missing, "frame is", "frames are")
        text = f"{are} missing according to {name} (of {counter.received})"
        severity = FAIL if counter.missing > _LOST_FAIL * counter.received else WARN
        advice = "frames are lost on the way, or the counter counts something else"
        yield "counter", severity, text, advice
    if counter.restarts:
        text = f"{name} started again {counted(counter.restarts, 'time')}"
        yield "counter", FAIL, text, "the sensor restarts: check its power"


def _clock_faults(
    message: MessageLayout, keeping: Timekeeping, decoded: Decoded
) -> Iterator[Fault]:
    """Yield the fault of a sensor's time that runs faster or slower than that of the bus.

    Nothing for a message without a time, or with fewer than ten usable ones.
    """
    clock = keeping.clocks.get(message.name)
    if clock is None:
        return
    samples = decoded[clock.signal]
    sensor_time, t_ns = samples.value[samples.usable], samples.t_ns[samples.usable]
    if len(t_ns) < 10 or t_ns[-1] <= t_ns[0]:
        return
    bus_s = float(t_ns[-1] - t_ns[0]) * 1e-9
    sensor_s = float(np.sum(np.diff(sensor_time) % clock.wrap)) * clock.factor
    ratio = sensor_s / bus_s
    if abs(ratio - 1) > 0.2:  # no clock is so bad: the unit or the wrap is wrong
        text = f"{clock.signal} runs {ratio:.4g} times as fast as the bus's clock"
        yield "clock", FAIL, text, f"correct time_unit or time_wrap; {CORRECT_MESSAGE}"
