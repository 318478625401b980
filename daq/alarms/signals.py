"""Watches each channel: not a number, out of range, at the end of its range, or frozen."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from dbc.finding import Finding
from dbc.samples import UNUSABLE, Decoded, Quality, Samples
from dbc.words import counted

from ..channels import LARGEST, Quantity
from ..samples.converter import is_fine, is_stuck
from ..samples.mapping import MappedChannel
from .inputs import Count, Key, fault

_STUCK_S = 0.8
"""Time without any change, s, after which a channel of fine resolution counts as frozen."""
_STUCK_MOVING_TURNS = 3
_MOVING_STEPS = 20.0
"""Change of another channel within one cycle, in steps of the judged channel, that counts as
motion."""


@dataclass(frozen=True, slots=True)
class Limits:
    """The range and resolution of a channel."""

    low: float
    """Lowest value, in the signal's unit."""
    high: float
    """Highest value, in the signal's unit."""
    step: float
    """Smallest change, in the channel's unit."""
    is_fine: bool
    """True if the channel must show noise (`daq.samples.converter.is_fine`)."""
    range_text: str
    """The range as text."""
    largest: float = math.inf
    """Largest magnitude that any sensor shows, in the signal's unit; those above are not used."""


@dataclass(frozen=True, slots=True)
class Standing:
    """The current run of equal samples of a channel."""

    value: float
    """The signal's value."""
    since_ns: int
    """Time stamp of the run's first sample, ns."""
    samples: int
    """Number of samples in the run."""
    until_ns: int
    """Time stamp of the run's last sample, ns."""
    moving: int
    """Number of cycles within the run in which other channels moved."""


@dataclass(frozen=True, slots=True)
class SignalsWatch:
    """History of all channels; the default is the initial state."""

    mapped: Sequence[MappedChannel] = ()
    """The channels for which `limits` were made."""
    limits: Mapping[str, Limits] = field(default_factory=lambda: MappingProxyType({}))
    """Limits of the channels that are used, by name."""
    standing: Mapping[str, Standing] = field(default_factory=lambda: MappingProxyType({}))
    """Runs of equal samples of the channels that were received, by name."""
    overloaded: tuple[str, ...] = ()
    """Channels that were saturated since the last acknowledgement."""


def limits_of(mapped: MappedChannel) -> Limits:
    """Return the range and resolution of a channel.

    The range is that of its bits, or that of the DBC if it is narrower: a 16-bit sensor that
    measures up to 4 g stops there.
    """
    signal = mapped.signal
    low, high = signal.span
    least, most = signal.minimum, signal.maximum
    if least is not None and most is not None and least < most:
        low, high = max(low, least), min(high, most)
    if signal.length == 1:
        low, high = float("-inf"), float("inf")
    channel, step = mapped.channel, mapped.step
    fine = is_fine(channel.quantity, channel.unit, step)
    gain = abs(mapped.factor * channel.scale)
    largest = LARGEST / gain if gain else math.inf
    return Limits(low, high, step, fine, f"{low:g} to {high:g} {signal.unit}".rstrip(), largest)


def advance_signals(
    watch: SignalsWatch, mapped: Sequence[MappedChannel], decoded: Decoded | None
) -> tuple[SignalsWatch, dict[Key, Count]]:
    """Process a block; return the state after it and the counts of this cycle."""
    used = [m for m in mapped if m.channel.quantity is not Quantity.UNUSED]
    limits = (
        watch.limits
        if watch.mapped is mapped
        else MappingProxyType({m.channel.name: limits_of(m) for m in used})
    )
    counts: dict[Key, Count] = {}
    standing = dict(watch.standing) if watch.mapped is mapped else {}
    motion: dict[str, float] = {}
    ends: dict[str, tuple[Samples, float, float]] = {}
    for m in used:
        samples = decoded.samples.get(m.channel.signal) if decoded else None
        if samples is None or not len(samples.t_ns):
            continue
        name = m.channel.name
        low, high = float(samples.value.min()), float(samples.value.max())
        limit = limits[name]
        if not max(-low, high) <= limit.largest or samples.quality.any():  # or not a number
            samples, low, high = _sift(name, samples, limit, counts)
            if not len(samples.t_ns):
                standing.pop(name, None)
                continue
        # Many unsigned signals are zero at rest.
        if (low <= limit.low and low != 0) or (high >= limit.high and high != 0):
            value = samples.value
            at_end = np.count_nonzero(((value <= limit.low) | (value >= limit.high)) & (value != 0))
            counts["saturated", name] = Count(int(at_end), limit.range_text)
        motion[name] = (high - low) * abs(m.factor * m.channel.scale)
        ends[name] = (samples, low, high)
    for m in used:
        name = m.channel.name
        if name in ends:
            others = (
                motion[o.channel.name] > _MOVING_STEPS * limits[name].step > 0
                for o in used
                if o.channel.name in motion
                and o.channel.name != name
                and o.channel.quantity is m.channel.quantity
            )
            standing[name] = _stand(standing.get(name), *ends[name], any(others))
    lit = [*watch.overloaded, *(name for code, name in counts if code == "saturated")]
    return SignalsWatch(
        mapped, limits, MappingProxyType(standing), tuple(dict.fromkeys(lit))
    ), counts


def _sift(
    name: str, samples: Samples, limit: Limits, counts: dict[Key, Count]
) -> tuple[Samples, float, float]:
    """Count faulty samples, and return the usable ones."""
    quality, value = samples.quality, samples.value
    usable = (quality & np.uint8(UNUSABLE)) == 0
    shown = np.isfinite(value) & (np.abs(value) <= limit.largest)
    for code, rows in (
        ("no_value", (quality & np.uint8(Quality.SENTINEL)) != 0),
        ("not_a_number", usable & ~shown),
        ("out_of_range", usable & ((quality & np.uint8(Quality.OUT_OF_RANGE)) != 0)),
    ):
        if number := int(np.count_nonzero(rows)):
            counts[code, name] = Count(number, limit.range_text if code == "out_of_range" else "")
    good = np.flatnonzero(usable & shown)
    kept = Samples(samples.channel, samples.t_ns[good], value[good], quality[good])
    if not len(good):
        return kept, 0.0, 0.0
    return kept, float(kept.value.min()), float(kept.value.max())


def _stand(
    before: Standing | None, samples: Samples, low: float, high: float, others_move: bool
) -> Standing:
    last_ns, n = int(samples.t_ns[-1]), len(samples.t_ns)
    if low == high and before is not None and before.value == low:
        moving = before.moving + others_move
        return Standing(low, before.since_ns, before.samples + n, last_ns, moving)
    if low == high:
        return Standing(low, int(samples.t_ns[0]), n, last_ns, int(others_move))
    return Standing(float(samples.value[-1]), last_ns, 1, last_ns, 0)


def signal_symptoms(watch: SignalsWatch) -> list[Finding]:
    """Return the symptoms of frozen channels."""
    found = []
    for name, each in watch.standing.items():
        still_s = (each.until_ns - each.since_ns) * 1e-9
        if not is_stuck(each.samples):
            continue
        samples = counted(each.samples, "sample is", "samples in a row are")
        observation = f"{samples} {each.value:.6g}"
        if each.moving >= _STUCK_MOVING_TURNS:
            found.append(fault("stuck", name, f"{observation} while others move"))
        elif watch.limits[name].is_fine and still_s >= _STUCK_S:
            found.append(fault("stuck", name, f"{observation}: not even noise for {still_s:.1f} s"))
    return found
