"""Checks the data and the motion of one run.

First the data: they arrived, move, and are within the sensors' range.  Then the motion: rest before
the bump, its size, one strike, the decay.  Each check yields a finding, also if the run passed it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import nan

import numpy as np
from numpy.typing import NDArray

from dbc.words import Finding, counted, plural

from ..bench.campaign import Method
from ..bench.config import Bench
from ..channels import SI_UNITS, Channel, Quantity, message_of
from ..runs import WHEEL_MOTION_S, longest_gap_s, longest_silence
from ..samples.clock import FASTEST, latest_sent
from ..samples.converter import FROZEN_S, flat_tops, longest_hold
from ..samples.mapping import SampleBlock, trigger_channels
from .window import BEFORE_S, RunWindow, Trace, kind_of, largest_peaks, traces
from .words import finding

LOST_RATIO = 0.02
"""Largest ratio of lost to sent frames: a loose plug loses most while the car moves most."""
WEAK_LEVELS = 2.0
"""Least ratio of the peak to the trigger's level, which a mere touch may reach."""
WEAK_NOISE = 10.0
"""Least ratio of peak to noise of the best channel, 20 dB: the identification needs as much."""
STRONG_HEIGHTS = 1.5
"""Largest ratio of the suspension's travel to the planned height of a bump: bumps of that height
move it by 0.8 to 1.0 times the height, and half more reaches bump stops and lifts wheels."""
END_RATIO = 0.15
"""Largest ratio of the motion at the end to the peak: with more motion left, the identification
would fit a wave that was cut in the middle."""
END_S = 0.5
"""Time over which the remaining motion is taken, s: half a period of a body at 1 Hz."""
STRIKE_S = 0.1
"""Duration of a strike, s: one period of the wheels, over which its energy is taken."""
STRIKE_GUARD_S = 0.25
"""Time after the bump that belongs to the same strike, s: a wheel in the air lands in it."""
STRIKE_RATIO = 0.25
"""Ratio of envelopes, second strike to first; on the hubs the body's swing shows less."""
_GRID_S = 0.005
"""Step of the times at which the envelope of a strike is taken, s."""

_SLOW = tuple(q for q in SI_UNITS if q is not Quantity.HUB_ACCELERATION)
"""Quantities that show the swing of the body: all but the acceleration of hubs."""


# The data -----------------------------------------------------------------------------------------


def stale(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find messages that were silent, and channels without a value, for a part of the run.

    Nothing is yielded if all channels are unused.
    """
    stamps_ns = _stamps_of_messages(bench, window)  # by message, and by channel below
    for channel in bench.channels:
        t_ns = _usable_ns(window, channel)
        of_message_ns = stamps_ns.get(_message(channel), ())
        # A channel that lacks more than a tenth of its message's values is judged separately.
        if channel.quantity is not Quantity.UNUSED and len(t_ns) < 0.9 * len(of_message_ns):
            stamps_ns[channel.name] = t_ns
    span_s = -bench.trigger.pre_s, bench.trigger.post_s
    silences = {
        name: longest_silence((t_ns - window.bump_ns) * 1e-9, *span_s)
        for name, t_ns in stamps_ns.items()
    }
    if not silences:
        return
    worst = max(silences, key=lambda name: silences[name].length_s / silences[name].limit_s)
    gap_s, limit_s = silences[worst].length_s, silences[worst].limit_s
    silent = [name for name, silence in silences.items() if silence.is_stale]
    all_messages = f"all {len(silences)} messages" if len(silences) > 1 else "the one message"
    if silent:
        names = all_messages if len(silent) == len(silences) > 1 else ", ".join(silent)
        text = f"{names} {plural(len(silent), 'was', 'were')} silent or without a usable value for "
        text += f"{gap_s:.2f} s (limit {limit_s:.2f} s)"
        yield finding("stale", False, gap_s, limit_s, "s", text, worst)
    else:
        text = f"{all_messages} came; longest silence {gap_s * 1e3:.0f} ms ({worst})"
        yield finding("stale", True, gap_s, limit_s, "s", text)


def _usable_ns(window: RunWindow, channel: Channel) -> NDArray[np.int64]:
    """Return the time stamps of a channel's usable samples."""
    t_ns, value = window.channels.get(channel.name, (np.empty(0, np.int64), np.empty(0)))
    return t_ns[np.isfinite(value)]


def _stamps_of_messages(bench: Bench, window: RunWindow) -> dict[str, NDArray[np.int64]]:
    """Return by message the time stamps of that of its channels with the most usable samples."""
    stamps_ns: dict[str, NDArray[np.int64]] = {}
    for channel in bench.channels:
        name, t_ns = _message(channel), _usable_ns(window, channel)
        if channel.quantity is not Quantity.UNUSED and len(t_ns) >= len(stamps_ns.get(name, ())):
            stamps_ns[name] = t_ns
    return stamps_ns


def _message(channel: Channel) -> str:
    """Return the message of a channel; the channel itself if it is in none."""
    return message_of(channel.signal) or channel.name


def lost_frames(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare missing with received frames, and the longest gap while the wheels move.

    The gap is the finding only if it is too long although few frames are missing.
    """
    lost = window.losses.measured
    received = sum(map(len, _stamps_of_messages(bench, window).values()))
    ratio = lost / max(lost + received, 1)
    gap_s, limit_s, name = 0.0, longest_gap_s(0.0), ""  # the worst gap, relative to its limit
    for trace in signals:
        time_s = trace.time_s
        allowed_s = longest_gap_s(float(np.median(np.diff(time_s))))
        if _message(trace.channel) in window.timed:
            # A delayed reader delivers several frames at one instant, but as many as were sent.
            mean_cycle_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)
            time_s = latest_sent(time_s, FASTEST * mean_cycle_s)
        begin, end = np.searchsorted(time_s, [0.0, WHEEL_MOTION_S])
        # With one sample on either side; a trace begins before the bump.
        gaps_s = np.diff(time_s[begin - 1 : end + 1])
        widest_s = float(np.max(gaps_s, initial=0.0))
        if widest_s / allowed_s > gap_s / limit_s:
            gap_s, limit_s, name = widest_s, allowed_s, trace.name
    if gap_s > limit_s and ratio <= LOST_RATIO:
        text = f"no sample of {name} for {gap_s * 1e3:.0f} ms (limit {limit_s * 1e3:.0f}) "
        text += "while the wheels moved"
        yield finding("lost_frames", False, gap_s, limit_s, "s", text, name)
        return
    text = f"{window.losses.words or '0 frames lost'}, {ratio:.1%} (limit {LOST_RATIO:.0%})"
    yield finding("lost_frames", ratio <= LOST_RATIO, ratio, LOST_RATIO, "", text)


def overload(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find tops that were cut; on the bump itself they are harmless."""
    passed, on_bump_only = True, []
    for trace in signals:
        cut_s = _cut_s(trace, trace.name in window.saturated)
        after_bump_s = cut_s[cut_s > bench.campaign.bump_s]
        if len(after_bump_s):
            passed = False
            text = f"{trace.name} was at the end of its range in "
            text += f"{counted(len(after_bump_s), 'sample')} after the bump, "
            text += f"the last at +{after_bump_s[-1]:.2f} s"
            yield finding("overload", False, len(after_bump_s), 0.0, "", text, trace.name)
        elif len(cut_s):
            on_bump_only.append(trace.name)
    if passed:
        text = f"{', '.join(on_bump_only)}: at the end of the range on the bump only, which is "
        text = f"{text}harmless" if on_bump_only else "no sensor at the end of its range"
        yield finding("overload", True, 0.0, 0.0, "", text)


def _cut_s(trace: Trace, is_saturated: bool) -> NDArray[np.float64]:
    """Return the times since the bump began at which a trace is at the end of its range, s.

    `is_saturated`: the decoder saw samples at the end, so every extreme sample is one.
    """
    is_cut = np.zeros(len(trace.value), bool)
    for begin, stop in flat_tops(trace.value):
        is_cut[begin:stop] = True
    low, high = trace.value.min(), trace.value.max()
    if is_saturated and low < high:
        is_cut |= (trace.value == low) | (trace.value == high)
    return trace.time_s[is_cut & (trace.time_s > 0.0)]


def frozen(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find channels that held one value (`Hold.is_frozen`), as the identification does.

    The rate at which a healthy channel changes its value is that of the channel itself at rest.
    Each bump moves the suspensions and the body up and down, so for a channel that is constant, or
    has too few samples at rest, it is the largest rate of others of its quantity.  Where all of
    them are constant although others move, each sample should change.  Such a channel of roll or
    pitch, which may be silent by symmetry, is not judged.
    """
    holds = [longest_hold(t.time_s, t.value, -BEFORE_S, bench.campaign.bump_s) for t in signals]
    all_constant = all(hold.constant for hold in holds)
    rates_of_kind: dict[str, float] = {}  # largest rate of the channels that change
    for trace, hold in zip(signals, holds, strict=True):
        if hold.decay_rate > 0.0:
            kind = kind_of(trace.channel)
            rates_of_kind[kind] = max(hold.decay_rate, rates_of_kind.get(kind, 0.0))
    frozen_channels = []  # length of the hold, s, and name
    for trace, hold in zip(signals, holds, strict=True):
        kind, healthy_rate = kind_of(trace.channel), hold.rest_rate
        if hold.constant or np.isnan(healthy_rate):
            healthy_rate = rates_of_kind.get(kind, nan if all_constant else 1.0)
            if kind.startswith("rad"):
                healthy_rate = nan
        if hold.is_frozen(healthy_rate):
            frozen_channels.append((hold.length_s, trace.name))
    if not frozen_channels:
        text = f"no sensor held one value for {FROZEN_S:g} s"
        yield finding("frozen", True, 0.0, FROZEN_S, "s", text)
        return
    length_s, worst = max(frozen_channels)
    names = ", ".join(name for _, name in frozen_channels)
    text = f"{names} held one value for {length_s:.2f} s (limit {FROZEN_S:.2f} s)"
    yield finding("frozen", False, length_s, FROZEN_S, "s", text, worst)


# The motion ---------------------------------------------------------------------------------------


def of_quantity(signals: Sequence[Trace], *quantities: Quantity) -> tuple[Trace, ...]:
    """Return the traces of some quantities."""
    return tuple(trace for trace in signals if trace.channel.quantity in quantities)


def not_at_rest(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare the motion before the bump with the noise and with the motion after it."""
    largest = largest_peaks(signals)
    limits = {
        # Below three times the noise no motion can be detected; less than 3 % of the peak changes
        # no amplitude by more than 4 %.  A limit of 0 could not be divided by.
        t.name: max(3.0 * t.noise, 0.03 * largest[kind_of(t.channel)], 1e-9)
        for t in signals
    }
    worst = max(signals, key=lambda trace: trace.rest_rms / limits[trace.name])
    limit, unit = limits[worst.name], worst.channel.unit
    text = f"before the bump {worst.name} moved by {_size_text(worst.rest_rms, unit)} RMS "
    text += f"(limit {_size_text(limit, unit)})"
    passed = worst.rest_rms <= limit
    yield finding("not_at_rest", passed, worst.rest_rms, limit, unit, text, worst.name)


def _size_text(value: float, unit: str) -> str:
    """Return a value as text: lengths in mm, angles in degrees."""
    if unit == "m":
        return f"{value * 1e3:.2g} mm"
    if unit.startswith("rad"):
        return f"{np.degrees(value):.2g} deg{unit[3:]}"
    return f"{value:.2g} {unit}"


def too_weak(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare the peak with the trigger's level and, if that suffices, the swing with its noise."""
    names = {channel.name for channel in trigger_channels(bench.channels, bench.campaign.method)}
    trigger_traces = [trace for trace in signals if trace.name in names]
    if trigger_traces:
        strongest = max(trigger_traces, key=lambda trace: trace.peak)
        peak, limit = strongest.peak, WEAK_LEVELS * bench.trigger.level
        text = f"peak {peak:.1f} m/s2 on {strongest.name} (at least {limit:.1f}: "
        text += f"{WEAK_LEVELS:g} times the trigger's level)"
        yield finding("too_weak", peak >= limit, peak, limit, "m/s2", text, strongest.name)
        if peak < limit:
            return
    slow = [trace for trace in of_quantity(signals, *_SLOW) if trace.noise > 0.0]
    corners = [trace.channel.corner for trace in slow]
    is_one_axle = len({c.front for c in corners if c}) == 1 and None not in corners
    # Travels of one axle hardly show a bump at the other; hubs that swing are proof enough.
    is_proven = is_one_axle and bool(of_quantity(signals, Quantity.HUB_ACCELERATION))
    if slow and not is_proven:
        clearest = max(slow, key=lambda trace: trace.peak / trace.noise)
        ratio = clearest.peak / clearest.noise
        text = f"peak of {clearest.name} is {ratio:.0f} times its noise (at least {WEAK_NOISE:.0f})"
        passed = ratio >= WEAK_NOISE
        yield finding("too_weak", passed, ratio, WEAK_NOISE, "", text, clearest.name)


def double_bump(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find a wheel (without hub sensors: the car) that was struck again.

    Each hub is judged separately: a rear axle that passes the board after the front is struck once.
    """
    hubs = of_quantity(signals, Quantity.HUB_ACCELERATION)
    judged = hubs or of_quantity(signals, Quantity.BODY_ACCELERATION) or signals
    largest = largest_peaks(signals)
    # The push down and the release are one strike.
    guard_s = 1.0 if bench.campaign.method is Method.PUSH else STRIKE_GUARD_S
    strikes = [
        (*second_strike(trace, bench.campaign.bump_s + guard_s), trace.name)
        for trace in judged
        if trace.peak > 0.2 * largest[kind_of(trace.channel)]  # less shows no strike
    ]
    ratio, onset_s, name = max(strikes, default=(0.0, 0.0, ""))
    if ratio > STRIKE_RATIO:
        text = f"second bump at +{onset_s:.2f} s: {name} with {ratio:.0%} of the first (limit "
        text += f"{STRIKE_RATIO:.0%})"
        yield finding("double_bump", False, ratio, STRIKE_RATIO, "", text, name)
    else:
        text = f"one bump; nothing rises to more than {ratio:.0%} of it again"
        yield finding("double_bump", True, ratio, STRIKE_RATIO, "", text)


def second_strike(trace: Trace, guard_s: float) -> tuple[float, float]:
    """Return the ratio of a second strike to the first, and its time, s.

    Both are 0 if there is none, or the trace ends too early to show one.  `guard_s`: time from the
    first strike in which motion belongs to it, s.  The envelope, the RMS over `STRIKE_S`, of wheels
    that swing freely only decays: a rise is a strike.
    """
    grid_s = np.arange(0.0, trace.time_s[-1], _GRID_S)
    if len(grid_s) * _GRID_S < guard_s + 2 * STRIKE_S:
        return 0.0, 0.0
    wheel_motion = _without_body(trace)
    energy = np.concatenate([[0.0], np.cumsum(wheel_motion**2)])
    begins, ends = np.searchsorted(trace.time_s, [grid_s - STRIKE_S / 2, grid_s + STRIKE_S / 2])
    envelope = np.sqrt((energy[ends] - energy[begins]) / np.maximum(ends - begins, 1))
    # The first strike is where the envelope reaches half of its maximum; the guard follows it.
    guard_end = int(np.argmax(envelope > 0.5 * envelope.max())) + round(guard_s / _GRID_S)
    first_peak, later = float(envelope[:guard_end].max()), envelope[guard_end:]
    floor = max(3.0 * trace.noise, 0.02 * first_peak)  # a rise from less is noise
    lowest = np.maximum(np.minimum.accumulate(later), floor)  # until each time
    risen = np.where(later > 3.0 * lowest, later, 0.0)  # free wheels only decay, or beat a little
    if not risen.any():
        return 0.0, 0.0
    # The envelope looks ahead; the strike itself is where the signal reaches half of its maximum.
    onset_s, highest_s = grid_s[guard_end + np.array([np.argmax(risen > 0.0), np.argmax(risen)])]
    is_near = (trace.time_s > onset_s - STRIKE_S) & (trace.time_s < highest_s + STRIKE_S)
    size = np.where(is_near, np.abs(wheel_motion), 0.0)
    return float(risen.max() / first_peak), float(trace.time_s[np.argmax(size > size.max() / 2)])


def _without_body(trace: Trace) -> NDArray[np.float64]:
    """Return a trace without the body's motion, which is its running mean over 0.15 s.

    The trace itself if that time has fewer than three samples.
    """
    cycle_s = max(float(np.median(np.diff(trace.time_s))), 1e-4)  # frames may share one stamp
    n = round(0.15 / cycle_s)  # samples of a mean
    if n < 3:
        return trace.value
    padded = np.pad(trace.value, (n // 2, n - 1 - n // 2), mode="edge")
    return np.asarray(trace.value - np.convolve(padded, np.full(n, 1.0 / n), "valid"))


def too_strong(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare the travel of the suspension with the planned height of the bump."""
    travels = of_quantity(signals, Quantity.SUSPENSION_TRAVEL)
    if not travels:
        return
    largest = max(travels, key=lambda trace: trace.peak)
    peak, limit = largest.peak, STRONG_HEIGHTS * bench.campaign.bump_height_m
    text = f"{largest.name} moved by {peak * 1e3:.0f} mm (limit {limit * 1e3:.0f} mm: "
    text += f"{STRONG_HEIGHTS:g} times the planned height)"
    yield finding("too_strong", peak <= limit, peak, limit, "m", text, largest.name)


def not_decayed(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare the motion at the end of the run with the peak."""
    end_s = bench.trigger.post_s
    ratio, name = _remaining(signals, end_s)
    if ratio is not None:
        text = f"{ratio:.0%} of the motion left after {end_s:g} s ({name}; limit {END_RATIO:.0%})"
        yield finding("not_decayed", ratio <= END_RATIO, ratio, END_RATIO, "", text, name)


def remaining_ratio(
    channels: tuple[Channel, ...], bump_ns: int, samples: SampleBlock, now_ns: int
) -> float | None:
    """Return the ratio of the present motion to its peak, 0..1; None while the peak is too weak.

    `bump_ns` and `now_ns`: time stamps of the bump and of the latest frame.  `samples`: those of
    each channel from before the bump until now, SI.
    """
    return _remaining(traces(channels, RunWindow(bump_ns, samples)), (now_ns - bump_ns) * 1e-9)[0]


def _remaining(signals: tuple[Trace, ...], now_s: float) -> tuple[float | None, str]:
    """Return the ratio of the remaining motion to the peak, and the channel that moves most.

    None and no name if the peak is hardly above the noise (`WEAK_NOISE`).  Channels count in units
    of their noise: one that this bump hardly moves has little weight.
    """
    slow = of_quantity(signals, *_SLOW) or signals
    largest = largest_peaks(slow)
    # No sensor is taken for better than a thousandth of the peak; 1e-12 is for one that is dead.
    units = [max(t.noise, 1e-3 * largest[kind_of(t.channel)], 1e-12) for t in slow]
    peak = float(np.linalg.norm([t.peak / unit for t, unit in zip(slow, units, strict=True)]))
    if peak < WEAK_NOISE:
        return None, ""
    amplitudes = [_amplitude(t, now_s) / unit for t, unit in zip(slow, units, strict=True)]
    ratio = float(np.linalg.norm(amplitudes)) / peak
    return min(ratio, 1.0), slow[int(np.argmax(amplitudes))].name


def _amplitude(trace: Trace, now_s: float) -> float:
    """Return the amplitude of the last half period about the present level; 0 without a sample."""
    half_period = trace.part(now_s - END_S, now_s)
    if not len(half_period):
        return 0.0
    # Early in the run a mean over a period still includes the bump.
    level = float(np.mean(trace.part(now_s - 2 * END_S, now_s))) if now_s > 4 * END_S else 0.0
    power = float(np.mean((half_period - level) ** 2)) - trace.noise**2
    return float(np.sqrt(2.0 * max(power, 0.0)))


def rest_changed(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare the rest positions before and after a run, unless it began on blocks.

    The position after it is the mean over the last second.
    """
    travels = of_quantity(signals, Quantity.SUSPENSION_TRAVEL)
    if bench.campaign.method is Method.DROP or not travels:
        return
    end_s = bench.trigger.post_s
    last_seconds = [trace.part(end_s - 2 * END_S, end_s) for trace in travels]
    changes_m = [abs(float(np.mean(value))) if len(value) else 0.0 for value in last_seconds]
    change_m, name = max(changes_m), travels[int(np.argmax(changes_m))].name
    # Friction holds a car with leaf springs at 0.16 after a roll, other cars at 0.02: more is a
    # slipped weight or a person on the car.
    limit_m = 0.2 * max(trace.peak for trace in travels)
    text = f"{name} rests {change_m * 1e3:.1f} mm from where it was (limit {limit_m * 1e3:.1f} mm)"
    yield finding("rest_changed", change_m <= limit_m, change_m, limit_m, "m", text, name)
