"""Checks that all sensor data have arrived, and are within the sensors' range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.words import counted, plural

from ..bench.config import Bench
from ..channels import Channel, Quantity, message_of
from ..samples.clock import FASTEST
from ..samples.converter import flat_tops
from ..silence import STALE_S, WHEEL_MOTION_S, Silence, longest_gap_s, longest_silence
from .window import RunWindow, Trace
from .words import finding

LOST_SHARE = 0.02
"""Largest share of lost frames: a loose plug loses most while the car moves most, and another bump
costs only a minute."""
_NO_VALUE = "check the sensor, and type, checksum and factor of its signal, then bump again"
_SPOKEN = 0.9
"""Least share of a message's samples that each healthy channel has."""


def stale(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find messages that were silent, and channels without a value, for a part of the run."""
    messages = _messages(bench.channels, window)
    poor = _poor(bench.channels, window, messages)
    silence = _silences(bench, window, {**messages, **poor})
    for message in window.stale:
        known = silence.get(message, Silence(0.0, 0.0, STALE_S))
        length_s = max(known.length_s, known.limit_s + STALE_S)
        silence[message] = known._replace(end_s=known.begin_s + length_s)
    if not silence:
        return
    worst = max(silence, key=lambda name: silence[name].length_s / silence[name].limit_s)
    gap_s, limit_s = silence[worst].length_s, silence[worst].limit_s
    silent = [name for name, found in silence.items() if found.is_stale]
    if not silent:
        who = f"all {len(silence)} messages" if len(silence) > 1 else "the one message"
        text = f"{who} came; longest silence {gap_s * 1e3:.0f} ms ({worst})"
        yield finding("stale", True, gap_s, limit_s, "s", text)
        return
    who = ", ".join(silent)
    if len(silent) == len(silence) > 1:
        who = f"all {len(silence)} messages"
    were = plural(len(silent), "was", "were")
    came = _silences(bench, window, {name: _came(name, bench, window) for name in silent})
    mute = not any(found.is_stale for found in came.values())
    what = "without a usable value" if mute else "silent"
    text = f"{who} {were} {what} for {gap_s:.2f} s (limit {limit_s:.2f} s)"
    found = finding("stale", False, gap_s, limit_s, "s", text, worst)
    yield replace(found, advice=_NO_VALUE) if mute else found


def _silences(
    bench: Bench, window: RunWindow, stamps: Mapping[str, NDArray[np.int64]]
) -> dict[str, Silence]:
    """Return the longest silence of each message or channel in the run; times are from the bump."""
    start_s, stop_s = -bench.trigger.pre_s, bench.trigger.post_s
    return {
        name: longest_silence((t_ns - window.bump_ns) * 1e-9, start_s, stop_s)
        for name, t_ns in stamps.items()
    }


def _messages(channels: tuple[Channel, ...], window: RunWindow) -> dict[str, NDArray[np.int64]]:
    """Return the time stamps of each message, none for one that is absent."""
    result: dict[str, NDArray[np.int64]] = {}
    for channel in channels:
        good = _good(channel, window)
        if channel.quantity is not Quantity.UNUSED and len(good) >= len(
            result.get(_message(channel), ())
        ):
            result[_message(channel)] = good
    return result


def _poor(
    channels: tuple[Channel, ...], window: RunWindow, messages: Mapping[str, NDArray[np.int64]]
) -> dict[str, NDArray[np.int64]]:
    """Return the time stamps of channels that have no values although their frames come."""
    used = [channel for channel in channels if channel.quantity is not Quantity.UNUSED]
    times = {
        channel.name: (_good(channel, window), messages[_message(channel)]) for channel in used
    }
    return {name: own for name, (own, all_) in times.items() if len(own) < _SPOKEN * len(all_)}


def _came(name: str, bench: Bench, window: RunWindow) -> NDArray[np.int64]:
    """Return the time stamps of a message or channel, those without a usable value too."""
    none = np.empty(0, np.int64)
    own = (c.name for c in bench.channels if name in (c.name, _message(c)))
    return max((window.channels.get(each, (none, none))[0] for each in own), key=len, default=none)


def _message(channel: Channel) -> str:
    return message_of(channel.signal) or channel.name


def _good(channel: Channel, window: RunWindow) -> NDArray[np.int64]:
    t_ns, value = window.channels.get(channel.name, (np.empty(0, np.int64), np.empty(0)))
    return t_ns[np.isfinite(value)]


def lost_frames(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare missing with received frames; judge a gap in the wheels' motion separately."""
    lost = window.losses.measured
    came = sum(len(t_ns) for t_ns in _messages(bench.channels, window).values())
    share = lost / max(lost + came, 1)
    text = f"{window.losses.words or '0 frames lost'}, {share:.1%} (limit {LOST_SHARE:.0%})"
    gap_s, limit_s, name = _early_gap(window, signals)
    if gap_s > limit_s and share <= LOST_SHARE:
        text = (
            f"no sample of {name} for {gap_s * 1e3:.0f} ms (limit {limit_s * 1e3:.0f}) while the "
            "wheels moved"
        )
        yield finding("lost_frames", False, gap_s, limit_s, "s", text, name)
        return
    yield finding("lost_frames", share <= LOST_SHARE, share, LOST_SHARE, "", text)


def _early_gap(window: RunWindow, signals: tuple[Trace, ...]) -> tuple[float, float, str]:
    worst = (0.0, longest_gap_s(0.0), "")
    for trace in signals:
        time_s = trace.time_s
        period_s = float(np.median(np.diff(time_s)))
        limit_s = longest_gap_s(period_s)
        if _message(trace.channel) in window.timed:
            time_s = _sent_by(time_s)
        first, last = np.searchsorted(time_s, [0.0, WHEEL_MOTION_S])
        times = time_s[first - 1 : last + 1]  # a trace begins before the bump
        gap_s = float(np.max(np.diff(times))) if len(times) > 1 else 0.0
        worst = max(worst, (gap_s, limit_s, trace.channel.name), key=lambda w: w[0] / w[1])
    return worst


def _sent_by(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the latest time at which each frame can have been sent: each later frame took a cycle.

    A delayed reader delivers several frames at one instant.  They are late, but as many as fit into
    the gap before them; if frames are missing, there are too few.
    """
    cycle_s = FASTEST * (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    sent_s = np.arange(len(time_s)) * cycle_s
    return np.asarray(np.minimum.accumulate((time_s - sent_s)[::-1])[::-1] + sent_s)


def overload(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find tops that were cut; on the bump itself they are harmless."""
    free_s = bench.campaign.bump_s
    cut = _cut_tops(window, signals)
    late = {name: times[times > free_s] for name, times in cut.items() if (times > free_s).any()}
    for name, times in late.items():
        text = (
            f"{name} was at the end of its range in {counted(len(times), 'sample')} "
            f"after the bump, the last at +{times[-1]:.2f} s"
        )
        yield finding("overload", False, len(times), 0.0, "", text, name)
    if not late:
        text = "no sensor at the end of its range"
        if cut:
            text = f"{', '.join(cut)}: at the end of the range on the bump only, which is harmless"
        yield finding("overload", True, 0.0, 0.0, "", text)


def _cut_tops(window: RunWindow, signals: tuple[Trace, ...]) -> Mapping[str, NDArray[np.float64]]:
    """Return the times at which each channel was at the end of its range, s since the bump."""
    result = {}
    for trace in signals:
        flat = np.zeros(len(trace.value), bool)
        for first, stop in flat_tops(trace.value):
            flat[first:stop] = True
        low, high = trace.value.min(), trace.value.max()
        if trace.channel.name in window.saturated and low < high:  # any extreme sample counts
            flat |= (trace.value == low) | (trace.value == high)
        times = trace.time_s[flat & (trace.time_s > 0.0)]
        if len(times):
            result[trace.channel.name] = times
    return result
