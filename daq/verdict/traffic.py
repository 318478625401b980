"""Checks that all sensor data have arrived, move, and are within the sensors' range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from dbc.finding import Finding
from dbc.words import counted, plural

from ..bench.config import Bench
from ..channels import Channel, Quantity, message_of
from ..runs import STALE_S, WHEEL_MOTION_S, Silence, longest_gap_s, longest_silence
from ..samples.clock import FASTEST
from ..samples.converter import FROZEN_S, flat_tops, longest_hold
from .window import BEFORE_S, RunWindow, Trace, kind_of
from .words import finding

LOST_SHARE = 0.02
"""Largest share of lost frames: a loose plug loses most while the car moves most, and another bump
costs only a minute."""

Times = Mapping[str, NDArray[np.int64]]
"""Time stamps, ns, by message or channel."""


def stale(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find messages that were silent, and channels without a value, for a part of the run."""
    usable = _usable(bench, window)
    messages = _best_of_message(bench, usable)
    for channel in bench.channels:  # those without a value although their frames come
        t_ns, all_ns = usable[channel.name], messages.get(_message(channel), ())
        if channel.quantity is not Quantity.UNUSED and len(t_ns) < 0.9 * len(all_ns):
            messages[channel.name] = t_ns
    silence = _silences(bench, window, messages)
    for message in window.stale:
        known = silence.get(message, Silence(0.0, 0.0, STALE_S))
        length_s = max(known.length_s, known.limit_s + STALE_S)
        silence[message] = known._replace(end_s=known.begin_s + length_s)
    if not silence:
        return
    worst = max(silence, key=lambda name: silence[name].length_s / silence[name].limit_s)
    gap_s, limit_s = silence[worst].length_s, silence[worst].limit_s
    silent = [name for name, each in silence.items() if each.is_stale]
    all_ = f"all {len(silence)} messages"
    if not silent:
        who = all_ if len(silence) > 1 else "the one message"
        text = f"{who} came; longest silence {gap_s * 1e3:.0f} ms ({worst})"
        yield finding("stale", True, gap_s, limit_s, "s", text)
        return
    who = all_ if len(silent) == len(silence) > 1 else ", ".join(silent)
    stamps = {name: _received(bench, window, name) for name in silent}
    is_mute = not any(each.is_stale for each in _silences(bench, window, stamps).values())
    fault = "without a usable value" if is_mute else "silent"
    were = plural(len(silent), "was", "were")
    text = f"{who} {were} {fault} for {gap_s:.2f} s (limit {limit_s:.2f} s)"
    failed = finding("stale", False, gap_s, limit_s, "s", text, worst)
    advice = "check the sensor, and type, checksum and factor of its signal, then bump again"
    yield replace(failed, advice=advice) if is_mute else failed


def _received(bench: Bench, window: RunWindow, name: str) -> NDArray[np.int64]:
    """Return the time stamps of a message or channel, also of samples without a usable value."""
    stamps = (
        window.channels[c.name][0]
        for c in bench.channels
        if name in (c.name, _message(c)) and c.name in window.channels
    )
    return max(stamps, key=len, default=np.empty(0, np.int64))


def _silences(bench: Bench, window: RunWindow, stamps: Times) -> dict[str, Silence]:
    """Return the longest silence of each message or channel in the run; times are from the bump."""
    span_s = -bench.trigger.pre_s, bench.trigger.post_s
    return {
        name: longest_silence((t_ns - window.bump_ns) * 1e-9, *span_s)
        for name, t_ns in stamps.items()
    }


def _usable(bench: Bench, window: RunWindow) -> dict[str, NDArray[np.int64]]:
    """Return the time stamps of the usable samples of each channel, none for one that is absent."""
    nothing = np.empty(0, np.int64), np.empty(0)
    columns = {c.name: window.channels.get(c.name, nothing) for c in bench.channels}
    return {name: t_ns[np.isfinite(value)] for name, (t_ns, value) in columns.items()}


def _best_of_message(bench: Bench, usable: Times) -> dict[str, NDArray[np.int64]]:
    """Return the time stamps of the channel with the most usable samples of each message."""
    best: dict[str, NDArray[np.int64]] = {}
    for channel in bench.channels:
        name, t_ns = _message(channel), usable[channel.name]
        if channel.quantity is not Quantity.UNUSED and len(t_ns) >= len(best.get(name, ())):
            best[name] = t_ns
    return best


def _message(channel: Channel) -> str:
    """Return the message of a channel; the channel itself if it is in none."""
    return message_of(channel.signal) or channel.name


def lost_frames(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare missing with received frames; judge a gap in the wheels' motion separately."""
    lost = window.losses.measured
    came = sum(map(len, _best_of_message(bench, _usable(bench, window)).values()))
    share = lost / max(lost + came, 1)
    gap_s, limit_s, name = 0.0, longest_gap_s(0.0), ""
    for trace in signals:
        time_s = trace.time_s
        allowed_s = longest_gap_s(float(np.median(np.diff(time_s))))
        if _message(trace.channel) in window.timed:
            time_s = _latest_sent(time_s)
        first, last = np.searchsorted(time_s, [0.0, WHEEL_MOTION_S])
        gaps_s = np.diff(time_s[first - 1 : last + 1])  # a trace begins before the bump
        widest_s = float(np.max(gaps_s, initial=0.0))
        if widest_s / allowed_s > gap_s / limit_s:
            gap_s, limit_s, name = widest_s, allowed_s, trace.name
    if gap_s > limit_s and share <= LOST_SHARE:
        text = (
            f"no sample of {name} for {gap_s * 1e3:.0f} ms (limit {limit_s * 1e3:.0f}) while the "
            "wheels moved"
        )
        yield finding("lost_frames", False, gap_s, limit_s, "s", text, name)
        return
    text = f"{window.losses.words or '0 frames lost'}, {share:.1%} (limit {LOST_SHARE:.0%})"
    yield finding("lost_frames", share <= LOST_SHARE, share, LOST_SHARE, "", text)


def _latest_sent(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the latest time at which each frame can have been sent: each later frame took a cycle.

    A delayed reader delivers several frames at one instant.  They are late, but as many as fit into
    the gap before them; if frames are missing, there are too few.
    """
    cycle_s = FASTEST * (time_s[-1] - time_s[0]) / (len(time_s) - 1)
    sent_s = np.arange(len(time_s)) * cycle_s
    return np.asarray(np.minimum.accumulate((time_s - sent_s)[::-1])[::-1] + sent_s)


def overload(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find tops that were cut; on the bump itself they are harmless."""
    cut = []
    passed = True
    for trace in signals:
        flat = np.zeros(len(trace.value), bool)
        for first, stop in flat_tops(trace.value):
            flat[first:stop] = True
        low, high = trace.value.min(), trace.value.max()
        if trace.name in window.saturated and low < high:  # any extreme sample counts
            flat |= (trace.value == low) | (trace.value == high)
        times_s = trace.time_s[flat & (trace.time_s > 0.0)]
        cut += [trace.name] if len(times_s) else []
        times_s = times_s[times_s > bench.campaign.bump_s]
        if len(times_s):
            passed = False
            text = (
                f"{trace.name} was at the end of its range in {counted(len(times_s), 'sample')} "
                f"after the bump, the last at +{times_s[-1]:.2f} s"
            )
            yield finding("overload", False, len(times_s), 0.0, "", text, trace.name)
    if passed:
        text = "no sensor at the end of its range"
        if cut:
            text = f"{', '.join(cut)}: at the end of the range on the bump only, which is harmless"
        yield finding("overload", True, 0.0, 0.0, "", text)


def frozen(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find channels that held one value: by the rule with which the identification omits a run.

    Each bump moves the suspensions and the body up and down, so a channel that is constant is
    compared with others of its quantity.  Where all of them are constant although others move,
    each sample should change.  A rate of roll or pitch may be silent by symmetry.
    """
    holds = [longest_hold(t.time_s, t.value, -BEFORE_S, bench.campaign.bump_s) for t in signals]
    all_constant = all(hold.constant for hold in holds)
    stuck = []
    for trace, hold in zip(signals, holds, strict=True):
        # Share of samples at which a healthy channel changes, NaN if that is unknown.
        kind, changes = kind_of(trace.channel), hold.rest_rate
        if hold.constant or np.isnan(changes):
            rates = [
                other.decay_rate
                for t, other in zip(signals, holds, strict=True)
                if kind_of(t.channel) == kind and other.decay_rate > 0.0
            ]
            without_others = nan if all_constant else 1.0
            changes = nan if kind.startswith("rad") else max(rates, default=without_others)
        if hold.is_frozen(changes):
            stuck.append((hold.length_s, trace.name))
    if not stuck:
        text = f"no sensor held one value for {FROZEN_S:g} s"
        yield finding("frozen", True, 0.0, FROZEN_S, "s", text)
        return
    length_s, worst = max(stuck)
    names = ", ".join(name for _, name in stuck)
    text = f"{names} held one value for {length_s:.2f} s (limit {FROZEN_S:.2f} s)"
    yield finding("frozen", False, length_s, FROZEN_S, "s", text, worst)
