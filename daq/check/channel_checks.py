"""Checks the channels of a bench: the readings of the sensors while the car stands still.

An accelerometer that points upwards reads +1 g at rest, whatever its name in the DBC: this proves
unit, axis and sign together.  Rates read zero at rest, and travels read zero at ride height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import date

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding, Severity
from dbc.layout import SignalLayout
from dbc.samples import Decoded, Quality, Samples
from dbc.units import G_M_S2, known_si, to_si
from dbc.words import counted, plural

from ..channels import ON_BODY, Channel, Quantity
from ..samples.converter import is_fine, is_stuck
from ..samples.groups import Timekeeping
from ..samples.mapping import MappedChannel
from .result import about, fail, judged, ok, warn

VERTICAL = frozenset({Quantity.BODY_ACCELERATION, Quantity.HUB_ACCELERATION})
RATES = frozenset({Quantity.PITCH_RATE, Quantity.ROLL_RATE})
TURNS = frozenset({Quantity.PITCH_ACCELERATION, Quantity.ROLL_ACCELERATION})

_GRAVITY_TOLERANCE = 0.06
"""Cosine of 20 degrees, the largest acceptable tilt."""
_NONE_G = 0.06
_SCALE_TOLERANCE = 0.08
_QUIETEST = 2e-3
"""Lowest noise of accelerometers for cars, m/s2: one with less noise is scaled wrong."""
_SLOWEST_HZ = 50.0
_GUESSED_M = 0.3
_BLOCK_S = 0.1


@dataclass(frozen=True, slots=True)
class _Limits:
    """The limits of a kind of sensor at rest, SI."""

    noise: float
    """Largest usual noise of one sample."""
    motion: float
    """Largest slow motion of a car at rest."""
    zero: float
    """Largest reading at rest that needs no tare."""
    absurd: float
    """Largest possible reading at rest: above it unit or scale is wrong."""


_BODY = _Limits(0.5, 0.5, math.inf, math.inf)
_HUB = _Limits(2.0, 1.0, math.inf, math.inf)
_RATE = _Limits(0.02, 0.05, 0.035, 0.5)
_TURN = _Limits(0.5, 0.5, 1.0, 20.0)
_DISPLACEMENT = _Limits(2e-3, 5e-3, 0.03, 1.0)


def _limits(quantity: Quantity) -> _Limits:
    if quantity in VERTICAL:
        return _BODY if quantity is Quantity.BODY_ACCELERATION else _HUB
    if quantity in RATES:
        return _RATE
    return _TURN if quantity in TURNS else _DISPLACEMENT


@dataclass(frozen=True, slots=True)
class _Rest:
    """A channel at rest, SI: level, noise of a sample, slow motion, and the unit to print."""

    level: float
    noise: float
    motion: float
    unit: str

    @property
    def text(self) -> str:
        """The level to two digits of the noise, with its unit."""
        if not self.noise:
            return f"{self.level:.4g} {self.unit}"
        places = max(0, 1 - math.floor(math.log10(self.noise)))
        return f"{round(self.level, places) + 0.0:.{places}f} {self.unit}"  # -0.0 becomes 0


def check_channel(
    mapped: MappedChannel,
    keeping: Timekeeping,
    decoded: Decoded,
    calibration_days: int,
    today: date,
) -> list[Finding]:
    """Check one channel.

    `keeping`: which messages belong together.  `decoded`: traffic at rest.  `calibration_days` and
    `today`: a calibration older than this number of days gives a warning.  Returns a line with the
    reading, unless something fails; and a line for each fault.
    """
    channel = mapped.channel
    found = _calibration_lines(channel, calibration_days, today)
    samples = decoded.samples.get(channel.signal)
    subject = f"channel {channel.name}"
    if samples is None or not len(samples.t_ns):
        verdict = Severity.WARNING if channel.quantity is Quantity.UNUSED else Severity.ERROR
        reason = f"no sample of {channel.signal}"
        found.append(judged("no_sample", verdict, reason, f"see message {mapped.message.name}"))
        return about(subject, found)
    signal = mapped.signal
    value = mapped.values(samples)
    finite = np.isfinite(value)
    found += _validity_lines(samples, value, signal)
    if not finite.any():
        return about(subject, found)
    rest = _rest(value[finite], samples.t_ns[finite], channel.unit)
    rate = _rate_hz(samples.t_ns)
    figures = {"level": rest.level, "noise": rest.noise, "motion": rest.motion, "rate_hz": rate}
    stuck = _stuck_lines(mapped, signal, samples.value[finite], value[finite])
    found += stuck
    if channel.quantity is not Quantity.UNUSED and all(each.passed for each in stuck):
        found += _rest_lines(mapped, rest)
        if channel.quantity in VERTICAL:
            found += _gravity_lines(mapped, rest, len(value), _siblings(mapped, keeping, decoded))
        if rate < _SLOWEST_HZ and rate > 0:
            reason = f"{rate:.0f} Hz is slow: wheels hop at 10 to 15 Hz"
            advice = "ask the sensor for 100 Hz or more"
            found.append(warn("slow", reason, advice))
    if channel.quantity in ON_BODY and channel.position_sigma_m >= _GUESSED_M:
        reason = f"its position is a guess (+-{channel.position_sigma_m:g} m)"
        advice = "measure x_m and y_m from the middle of the front axle"
        found.append(warn("position", reason, advice))
    wrong = [each for each in found if each.severity is not Severity.NOTE]
    if all(each.passed for each in wrong):
        proof = "".join(f", {each.text}" for each in found if each.severity is Severity.NOTE)
        reason = f"{rest.text} at rest, noise {rest.noise:.2g}, {rate:.0f} Hz{proof}"
        wrong.insert(0, ok("rest", reason))
    return about(subject, wrong, figures)


def _rate_hz(t_ns: NDArray[np.int64]) -> float:
    span_s = float(np.ptp(t_ns)) * 1e-9
    return (len(t_ns) - 1) / span_s if span_s > 0 else 0.0


def _rest(value: NDArray[np.float64], t_ns: NDArray[np.int64], unit: str) -> _Rest:
    """Describe a channel at rest by statistics that a single knock does not change."""
    jump = np.sort(np.diff(value) ** 2)
    most = jump[: len(jump) - len(jump) // 100]
    noise = math.sqrt(float(np.mean(most)) / 2) if len(most) else 0.0
    block = (t_ns - t_ns[0]) // round(_BLOCK_S * 1e9)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    means = np.add.reduceat(value, starts) / np.diff(np.append(starts, len(value)))
    low, high = np.quantile(means, [0.05, 0.95])
    return _Rest(float(np.median(value)), noise, float(high - low), unit)


def _calibration_lines(channel: Channel, days: int, today: date) -> list[Finding]:
    if not channel.calibrated:
        return []
    age = (today - date.fromisoformat(channel.calibrated)).days
    which = f" (serial number {channel.serial_number})" if channel.serial_number else ""
    if age < 0:
        reason = f"calibrated on {channel.calibrated}, which is in the future{which}"
        return [warn("calibration", reason, "correct calibrated, or the clock of this computer")]
    if age > days:
        reason = f"calibrated on {channel.calibrated}, {counted(age, 'day')} ago{which}"
        advice = f"have it calibrated; the limit is {counted(days, 'day')}"
        return [warn("calibration", reason, advice)]
    return []


_UNUSABLE_BECAUSE = {
    Quality.CRC_BAD: "the checksum does not match",
    Quality.SENTINEL: "the sensor says that it has no value",
    Quality.MISSING: "the frames are too short to hold it",
}


def _validity_lines(
    samples: Samples, value: NDArray[np.float64], signal: SignalLayout
) -> list[Finding]:
    n, found = len(value), []
    for bit, why in _UNUSABLE_BECAUSE.items():
        count = int(np.sum((samples.quality & bit) != 0))
        if count:
            verdict = Severity.ERROR if count > n / 2 else Severity.WARNING
            reason = f"{count} of {n} samples {plural(count, 'is', 'are')} unusable: {why}"
            found.append(judged("unusable", verdict, reason, "see its message"))
    usable = samples.usable
    odd = int(np.sum(usable & ~np.isfinite(value)))
    if odd:
        reason = f"{odd} of {n} samples {plural(odd, 'is no number', 'are not numbers')}"
        found.append(fail("no_number", reason, "check the DBC's type"))
    outside = int(np.sum(usable & ((samples.quality & Quality.OUT_OF_RANGE) != 0)))
    if outside:
        verdict = Severity.ERROR if outside > n / 2 else Severity.WARNING
        limits = f"{signal.minimum:g} to {signal.maximum:g} {signal.unit}"
        reason = f"{outside} of {n} samples {plural(outside, 'is', 'are')} outside {limits}"
        advice = "check the sensor, or the range and factor in the DBC"
        found.append(judged("out_of_range", verdict, reason, advice))
    if not signal.is_float and signal.length > 1:
        low, high = signal.span
        at_end = int(np.sum(usable & ((samples.value <= low) | (samples.value >= high))))
        # Many unsigned signals are zero at rest, and a constant signal is reported elsewhere.
        if at_end and np.ptp(samples.value[usable]) > 0:
            verdict = Severity.ERROR if at_end > n / 100 else Severity.WARNING
            reason = (
                f"{at_end} of {n} samples {plural(at_end, 'is', 'are')} at the end of its range "
                f"({low:g} to {high:g})"
            )
            advice = "it saturates, or reports that it has no value"
            found.append(judged("overload", verdict, reason, advice))
    return found


def _stuck_lines(
    mapped: MappedChannel,
    signal: SignalLayout,
    raw: NDArray[np.float64],
    value: NDArray[np.float64],
) -> list[Finding]:
    if np.ptp(value) > 0 or not is_stuck(len(value)):
        return []
    quantity = mapped.channel.quantity
    reason = f"stuck: all {len(value)} samples are {value[0]:.6g} {mapped.channel.unit}"
    fine = is_fine(quantity, mapped.channel.unit, mapped.step)
    at_end = not signal.is_float and signal.length > 1 and raw[0] in signal.span and raw[0] != 0
    if fine or at_end:
        return [fail("stuck", reason, "the sensor is dead, frozen or not started")]
    if quantity is Quantity.UNUSED:
        return []
    return [warn("stuck", reason, "move it: does it change?")]


def _rest_lines(mapped: MappedChannel, rest: _Rest) -> list[Finding]:
    channel, found = mapped.channel, []
    limits = _limits(channel.quantity)
    if rest.motion > limits.motion:
        reason = f"moves by {rest.motion:.2g} {rest.unit}: not at rest"
        advice = "let the car stand still and check again"
        found.append(warn("motion", reason, advice))
    if rest.noise > limits.noise:
        reason = f"noise {rest.noise:.2g} {rest.unit} is more than the usual {limits.noise:g}"
        advice = "check mounting, cable and unit; stop the engine"
        found.append(warn("noise", reason, advice))
    away = abs(rest.level)
    if away > limits.absurd:
        reason = f"reads {rest.level:.4g} {rest.unit} at rest, which is impossible"
        advice = _other_unit(mapped, rest.level, limits.absurd)
        found.append(fail("level", reason, advice))
    elif away > limits.zero:
        reason = f"reads {rest.level:.4g} {rest.unit} at rest instead of 0"
        tare = rest.level + channel.tare
        advice = f"set tare = {tare:.5g} at ride height"
        found.append(warn("tare", reason, advice))
    return found


def _other_unit(mapped: MappedChannel, level: float, absurd: float) -> str:
    for unit in ("mm", "um") if mapped.channel.unit == "m" else ("deg/s", "mrad/s"):
        si = to_si(unit)
        if si.unit == mapped.channel.unit and abs(level / mapped.factor * si.factor) < absurd / 2:
            return f'is its unit {unit}? state signal_unit = "{unit}"'
    return "correct signal_unit, the factor in the DBC, or tare"


_SCALES = (
    (1 / G_M_S2, "g"),
    (G_M_S2, "m/s2"),
    (1e-3, ""),
    (1e3, ""),
    (1e-3 / G_M_S2, ""),
    (1e-3 * G_M_S2, ""),
    (1e3 / G_M_S2, ""),
    (1e3 * G_M_S2, "mm/s2"),
)
"""Factors by which wrong units change gravity, with the unit that each factor would prove."""


def _gravity_lines(
    mapped: MappedChannel, rest: _Rest, n: int, siblings: dict[str, float]
) -> list[Finding]:
    """Judge unit, axis and sign by gravity."""
    channel = mapped.channel
    share = (rest.level + channel.tare) / G_M_S2
    observation = f"reads {rest.level:.4g} m/s2 at rest"
    flip = f"set sign = {-channel.sign:.0f}"
    if abs(share - 1) < _GRAVITY_TOLERANCE:
        return [ok("gravity", "+1 g")]
    if abs(share + 1) < _GRAVITY_TOLERANCE:
        return [fail("gravity", f"{observation}: upside down", flip)]
    sure = 5 * rest.noise / math.sqrt(n)
    for factor, unit in _SCALES:
        fits = abs(abs(share) / factor - 1) < _SCALE_TOLERANCE
        if abs(share) < _NONE_G:
            fits &= rest.noise < _QUIETEST and abs(share) * G_M_S2 > sure
        if fits:
            turn = f" and {flip}" if share < 0 else ""
            setting = f'signal_unit = "{unit}"' if unit else f"gain = {channel.gain / factor:.6g}"
            reason = f"{observation}: {factor:.4g} times gravity, so its unit is wrong"
            return [fail("gravity", reason, f"state {setting}{turn}")]
    if abs(share) < 0.5:
        upright = [(name, value) for name, value in siblings.items() if abs(abs(value) - 1) < 0.1]
        if upright:
            name, value = upright[0]
            turn = "" if value > 0 else " with sign = -1"
            reason = f"{observation}, but {name} {value:+.2f} g: the wrong axis"
            return [fail("gravity", reason, f'take signal = "{name}"{turn}')]
    if abs(share) < _NONE_G:
        return [ok("gravity", "no gravity (AC-coupled, or tared in the sensor)")]
    tilt = math.degrees(math.acos(min(abs(share), 1.0)))
    angle = f", tilted by {tilt:.0f} degrees" if tilt else ""
    verdict = Severity.ERROR if abs(abs(share) - 1) > 0.3 else Severity.WARNING
    return [
        judged(
            "gravity",
            verdict,
            f"{observation}{angle}, or its scale is wrong",
            "mount it upright, or correct gain",
        )
    ]


def _siblings(mapped: MappedChannel, keeping: Timekeeping, decoded: Decoded) -> dict[str, float]:
    """Return the readings of the other accelerations of the same sensor, in g.

    Signals count as one sensor if they are in one sample set, one message, or messages of one
    sender.
    """
    carrier = mapped.message
    names = {carrier.name}
    for sample_set in keeping.sets:
        if carrier.name in sample_set.messages:
            names.update(sample_set.messages)
    names.update(
        m.name for m in keeping.messages.values() if m.senders and m.senders == carrier.senders
    )
    found = {}
    for message in (keeping.messages[name] for name in sorted(names)):
        for signal in message.signals:
            name = f"{message.name}.{signal.name}"
            samples = decoded.samples.get(name)
            if name == mapped.channel.signal or samples is None or signal.is_multiplexed:
                continue
            si = known_si(signal.unit)
            value = samples.value[samples.usable]
            if si is not None and si.unit == "m/s2" and len(value):
                found[name] = si.factor * float(np.median(value)) / G_M_S2
    return found
