"""Checks a bench: frames, DBC and bench.toml must agree, and the sensors must read correctly.

Pure: from the frames of a few seconds of rest to a report.  Each line is OK, WARN or FAIL with a
reason and, where possible, advice.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.codec import Decoded, Quality, Samples
from dbc.frames import FrameBatch
from dbc.units import G_M_S2
from dbc.words import Finding, Severity, counted, plural, printable

from ..bench.config import Bench
from ..bench.sensors import SampleSet
from ..channels import ON_BODY, Quantity
from ..runs import SampleGroup
from ..samples.converter import is_fine, is_stuck
from ..samples.mapping import (
    MappedChannel,
    mapped_channels,
    sample_groups,
    timekeeping,
    trigger_channels,
)
from .frame_checks import FAIL, OK, WARN, Fault, check_buses, check_messages, findings, frame_table
from .propose import ASK

WORDS = {OK: "OK", WARN: "WARN", FAIL: "FAIL"}
"""Words for the severities, printed and sent to the terminal."""


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of a bench check."""

    seconds: float
    """Time from the first frame to the last, s."""
    frames: int
    lines: tuple[Finding, ...]
    """On buses, messages, sample sets, the trigger, open questions and channels, in this order."""

    @property
    def verdict(self) -> Severity:
        """The worst of all lines."""
        return max((line.severity for line in self.lines), default=OK)


def check_bench(bench: Bench, codec: Codec, frames: FrameBatch, today: date) -> CheckReport:
    """Return the report on a bench at rest.

    `frames`: a few seconds of traffic while the car stands still, in order of arrival.  `today`:
    for the age of calibrations.  Raises InputError if a channel does not fit the DBC.
    """
    mapped = mapped_channels(bench, codec)
    if not len(frames):
        advice = "check power, wiring, termination and bit rate; start sensors that need a command"
        line = Finding("no_frames", FAIL, "no frame was received", "bus", advice)
        return CheckReport(0.0, 0, (line,))
    decoded = codec.decode(frames)
    keeping = timekeeping(bench, codec)
    table = frame_table(codec.messages, frames)
    lines = check_buses(table, decoded.counts.error_frames, bench.buses)
    lines += check_messages(mapped, keeping, table, decoded)
    groups = {g.name: g for g in sample_groups(mapped, decoded, keeping, int(frames.t_ns[0]))}
    lines += [_set_line(s, groups[s.name]) for s in bench.sample_sets if s.name in groups]
    if not trigger_channels(bench.channels, bench.campaign.method):
        advice = "add a hub_acceleration or a body_acceleration"
        lines.append(Finding("trigger", FAIL, "no channel can trigger", "trigger", advice))
    ask_advice = "find the answer, correct the lines next to it if necessary, and delete the mark"
    lines += [
        Finding("ask", WARN, f"asks: {printable(ask, 160)}", f"bench.toml:{number}", ask_advice)
        for number, line in enumerate(bench.text.splitlines(), start=1)
        for _, mark, ask in [line.partition(ASK)]
        if mark
    ]
    for channel in mapped:
        lines += check_channel(channel, decoded, bench.calibration.max_age_days, today)
    return CheckReport(table.seconds, len(frames), tuple(lines))


def _set_line(sample_set: SampleSet, group: SampleGroup) -> Finding:
    """Return the line on a sample set: its rate, and the samples that lack a frame."""
    n = len(group.time_s)
    missing = int(np.count_nonzero(group.quality & np.uint8(Quality.MISSING)))
    rate_hz = (n - 1) / float(group.time_s[-1] - group.time_s[0]) if n > 1 else 0.0
    severity, text, advice = OK, f"{n} samples at {rate_hz:.1f} Hz", ""
    if missing > 0.01 * n + 2:  # the first and the last set may be incomplete
        severity = FAIL if missing > n / 2 else WARN
        text = f"{missing} of {n} samples {plural(missing, 'lacks', 'lack')} a frame"
        advice = f"are {', '.join(sample_set.messages)} sent at one rate, in one burst?"
    subject, figures = group.name, {"samples": n, "incomplete": missing, "rate_hz": rate_hz}
    return Finding("sample_set", severity, text, f"sample set {subject}", advice, figures=figures)


# The channels: the readings of the sensors while the car stands still -----------------------------


_GRAVITY_TOLERANCE = 0.06
"""Largest relative deviation from 1 g: a tilt of 20 degrees, the largest acceptable, has it."""
_NO_GRAVITY_G = 0.06
"""Reading at rest, g, below which an accelerometer shows no gravity."""


class _Limits(NamedTuple):
    """The limits of a kind of sensor at rest, SI."""

    noise: float
    """Largest usual noise of one sample."""
    motion: float
    """Largest slow motion of a car at rest."""
    zero: float = math.inf
    """Largest reading at rest that needs no tare."""
    absurd: float = math.inf
    """Largest possible reading at rest: above it unit or scale is wrong."""


_LIMITS = {
    Quantity.BODY_ACCELERATION: _Limits(0.5, 0.5),
    Quantity.HUB_ACCELERATION: _Limits(2.0, 1.0),
    Quantity.PITCH_RATE: _Limits(0.02, 0.05, 0.035, 0.5),
    Quantity.ROLL_RATE: _Limits(0.02, 0.05, 0.035, 0.5),
    Quantity.PITCH_ACCELERATION: _Limits(0.5, 0.5, 1.0, 20.0),
    Quantity.ROLL_ACCELERATION: _Limits(0.5, 0.5, 1.0, 20.0),
}


@dataclass(frozen=True, slots=True)
class _Rest:
    """A channel at rest, SI: level, noise of a sample, and slow motion."""

    level: float
    noise: float
    motion: float


def check_channel(
    mapped: MappedChannel, decoded: Decoded, calibration_days: int, today: date
) -> list[Finding]:
    """Return a line with the reading of a channel, unless something fails; and one for each fault.

    `decoded`: traffic at rest.  `calibration_days` and `today`: a calibration older than this
    number of days gives a warning.
    """
    channel, subject = mapped.channel, f"channel {mapped.channel.name}"
    faults: list[Fault] = []
    age = (today - date.fromisoformat(channel.calibrated)).days if channel.calibrated else 0
    if age > calibration_days:
        device = f" (serial number {channel.serial_number})" if channel.serial_number else ""
        text = f"calibrated on {channel.calibrated}, {counted(age, 'day')} ago{device}"
        advice = f"have it calibrated; the limit is {counted(calibration_days, 'day')}"
        faults.append(("calibration", WARN, text, advice))
    samples = decoded.samples.get(channel.signal)
    if samples is None or not len(samples.t_ns):
        severity = WARN if channel.quantity is Quantity.UNUSED else FAIL
        text, advice = f"no sample of {channel.signal}", f"see message {mapped.message.name}"
        return findings(subject, [*faults, ("no_sample", severity, text, advice)])
    value = mapped.values(samples)
    finite = np.isfinite(value)
    faults += _validity_faults(mapped, samples, value)
    if not finite.any():
        return findings(subject, faults)
    rest = _rest(value[finite], samples.t_ns[finite])
    span_s = float(np.ptp(samples.t_ns)) * 1e-9
    rate_hz = (len(samples.t_ns) - 1) / span_s if span_s > 0 else 0.0
    stuck = list(_stuck_faults(mapped, samples.value[finite], value[finite]))
    faults += stuck
    gravity = ""
    if channel.quantity is not Quantity.UNUSED and not _fails(stuck):
        faults += _rest_faults(mapped, rest)
        if channel.quantity in (Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION):
            fault = _gravity(mapped, rest)
            gravity = "" if fault else ", +1 g"
            faults += [fault] if fault else []
        if 0 < rate_hz < 50.0:
            text = f"{rate_hz:.0f} Hz is slow: wheels hop at 10 to 15 Hz"
            faults.append(("slow", WARN, text, "ask the sensor for 100 Hz or more"))
    if channel.quantity in ON_BODY and channel.position_sigma_m >= 0.3:
        text = f"its position is a guess (+-{channel.position_sigma_m:g} m)"
        advice = "measure x_m and y_m from the middle of the front axle"
        faults.append(("position", WARN, text, advice))
    if not _fails(faults):
        level = f"{rest.level:.3g} {channel.unit}"
        text = f"{level} at rest, noise {rest.noise:.2g}, {rate_hz:.0f} Hz{gravity}"
        faults.insert(0, ("rest", OK, text, ""))
    figures = {"level": rest.level, "noise": rest.noise, "motion": rest.motion, "rate_hz": rate_hz}
    return findings(subject, faults, figures)


def _fails(faults: Iterable[Fault]) -> bool:
    """Return whether any of some faults fails the check."""
    return any(severity is FAIL for _, severity, _, _ in faults)


def _rest(value: NDArray[np.float64], t_ns: NDArray[np.int64]) -> _Rest:
    """Return a channel's statistics at rest, none of which a single knock changes.

    `value` and `t_ns`: its finite samples, (n,), SI.  Noise comes from the steps between
    neighbours, without the largest hundredth; slow motion is the span of nine tenths of the means
    of blocks of 0.1 s.
    """
    squared_steps = np.sort(np.diff(value) ** 2)
    usual_steps = squared_steps[: len(squared_steps) - len(squared_steps) // 100]
    # The variance of a step is twice that of a sample.
    noise = math.sqrt(float(np.mean(usual_steps)) / 2) if len(usual_steps) else 0.0
    block_number = (t_ns - t_ns[0]) // 100_000_000  # blocks of 0.1 s
    block_starts = np.flatnonzero(np.diff(block_number, prepend=-1))
    block_sizes = np.diff(np.append(block_starts, len(value)))
    means = np.add.reduceat(value, block_starts) / block_sizes
    low, high = np.quantile(means, [0.05, 0.95])
    return _Rest(float(np.median(value)), noise, float(high - low))


def _validity_faults(
    mapped: MappedChannel, samples: Samples, value: NDArray[np.float64]
) -> Iterator[Fault]:
    """Yield each reason for which samples cannot be used; `value`: the same samples in SI, (n,)."""
    signal, n, usable = mapped.signal, len(value), samples.usable
    worst = WARN if mapped.channel.quantity is Quantity.UNUSED else FAIL  # it is only recorded
    low, high = signal.span
    at_end = usable & ((samples.value <= low) | (samples.value >= high))
    # A float has no end, one bit is always at one, and `_stuck_faults` reports a constant signal.
    if signal.is_float or signal.length < 2 or len(np.unique(samples.value[usable])) < 2:
        at_end[:] = False

    def flagged(bit: Quality) -> NDArray[np.bool_]:
        return np.asarray((samples.quality & bit) != 0)

    outside, limits = usable & flagged(Quality.OUT_OF_RANGE), ""
    if outside.any() and signal.limits is not None:
        limits = f"{signal.limits[0]:g} to {signal.limits[1]:g} {signal.unit}"
    no_number = usable & ~np.isfinite(value)
    see, correct = "see its message", "check the sensor, or the range and factor in the DBC"
    saturated = "it saturates, or reports that it has no value"
    range_end = f"at the end of its range ({low:g} to {high:g})"
    crc, sentinel, missing = Quality.CRC_BAD, Quality.SENTINEL, Quality.MISSING
    # Code, faulty samples, ratio to all samples above which the channel fails, state, advice.
    for code, is_faulty, failing_ratio, state, advice in (
        ("unusable", flagged(crc), 0.5, "unusable: the checksum does not match", see),
        ("unusable", flagged(sentinel), 0.5, "unusable: the sensor says it has no value", see),
        ("unusable", flagged(missing), 0.5, "unusable: the frame is too short to hold it", see),
        ("no_number", no_number, 0.0, "no number", "check the DBC's type"),
        ("out_of_range", outside, 0.5, f"outside {limits}", correct),
        ("overload", at_end, 0.01, range_end, saturated),
    ):
        count = int(np.sum(is_faulty))
        if count:
            text = f"{count} of {n} samples {plural(count, 'is', 'are')} {state}"
            yield code, worst if count > failing_ratio * n else WARN, text, advice


def _stuck_faults(
    mapped: MappedChannel, raw: NDArray[np.float64], value: NDArray[np.float64]
) -> Iterator[Fault]:
    """Yield a fault if the channel has one value, in more samples than chance allows.

    `raw`: its samples in the unit of the database; `value`: in SI; (n,) each.  A coarse sensor,
    whose step may exceed the noise at rest, gives a warning only; one that is not used nothing.
    """
    signal, quantity, unit = mapped.signal, mapped.channel.quantity, mapped.channel.unit
    if np.ptp(value) > 0 or not is_stuck(len(value)) or quantity is Quantity.UNUSED:
        return
    text = f"stuck: all {len(value)} samples are {value[0]:.6g} {unit}"
    is_integer = not signal.is_float and signal.length > 1
    is_at_end = is_integer and raw[0] in signal.span and raw[0] != 0  # 0: a usual level at rest
    if is_at_end or is_fine(quantity, unit, mapped.step):
        yield "stuck", FAIL, text, "the sensor is dead, frozen or not started"
    else:
        yield "stuck", WARN, text, "move it: does it change?"


def _rest_faults(mapped: MappedChannel, rest: _Rest) -> Iterator[Fault]:
    """Yield the faults of motion, noise and level of a channel at rest."""
    channel = mapped.channel
    limits = _LIMITS.get(channel.quantity, _Limits(2e-3, 5e-3, 0.03, 1.0))  # a displacement
    if rest.motion > limits.motion:
        text = f"moves by {rest.motion:.2g} {channel.unit}: not at rest"
        yield "motion", WARN, text, "let the car stand still and check again"
    if rest.noise > limits.noise:
        text = f"noise {rest.noise:.2g} {channel.unit} is more than the usual {limits.noise:g}"
        yield "noise", WARN, text, "check mounting, cable and unit; stop the engine"
    text = f"reads {rest.level:.4g} {channel.unit} at rest"
    if abs(rest.level) > limits.absurd:
        advice = "correct signal_unit, the factor in the DBC, or tare"
        yield "level", FAIL, f"{text}, which is impossible", advice
    elif abs(rest.level) > limits.zero:
        advice = f"set tare = {rest.level + channel.tare:.5g} at ride height"
        yield "tare", WARN, f"{text} instead of 0", advice


def _gravity(mapped: MappedChannel, rest: _Rest) -> Fault | None:
    """Return the fault in unit, sign or tilt of a vertical accelerometer; None if it reads +1 g."""
    channel = mapped.channel
    reading_g = (rest.level + channel.tare) / G_M_S2  # 1 for a sensor that is upright
    reading = f"reads {rest.level:.4g} m/s2 at rest"
    flip = f"set sign = {-channel.sign:.0f}"
    and_flip = f" and {flip}" if reading_g < 0 else ""
    if abs(reading_g - 1) < _GRAVITY_TOLERANCE:
        return None
    if abs(reading_g + 1) < _GRAVITY_TOLERANCE:
        return "gravity", FAIL, f"{reading}: upside down", flip
    # Factors by which a wrong unit in the database changes gravity, with the unit that they prove.
    units = {1 / G_M_S2: "g", G_M_S2: "m/s2", 1e3 * G_M_S2: "mm/s2"}
    for factor, unit in units.items():
        if abs(abs(reading_g) / factor - 1) < 0.08:  # a tilt of 20 degrees and an offset
            text = f"{reading}: {factor:.4g} times gravity, so its unit is wrong"
            return "gravity", FAIL, text, f'state signal_unit = "{unit}"{and_flip}'
    if abs(reading_g) < _NO_GRAVITY_G:
        text = "reads no gravity: it is AC-coupled, tared in the sensor, or not the vertical axis"
        return "gravity", WARN, text, "take the signal of the vertical axis, if it is another one"
    tilt = math.degrees(math.acos(min(abs(reading_g), 1.0)))
    angle = f"tilted by {tilt:.0f} degrees, or " if tilt else ""
    severity = FAIL if abs(reading_g - 1) > 0.3 else WARN  # 0.7 g is a tilt of 45 degrees
    side = "upside down, " if reading_g < 0 else ""
    text = f"{reading}: {side}{angle}its scale is wrong"
    return "gravity", severity, text, f"mount it upright, or correct gain{and_flip}"
