"""Checks that all sensor data have arrived, move, and are within the sensors' range."""

from __future__ import annotations

from collections.abc import Iterator
from math import nan

import numpy as np
from numpy.typing import NDArray

from dbc.words import Finding, counted, plural

from ..bench.config import Bench
from ..channels import Channel, Quantity, message_of
from ..runs import WHEEL_MOTION_S, longest_gap_s, longest_silence
from ..samples.clock import FASTEST
from ..samples.converter import FROZEN_S, flat_tops, longest_hold
from .window import BEFORE_S, RunWindow, Trace, kind_of
from .words import finding

LOST_SHARE = 0.02
"""Largest share of lost frames: a loose plug loses most while the car moves most, and another bump
costs only a minute."""


def stale(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Find messages that were silent, and channels without a value, for a part of the run."""
    messages = _best_of_message(bench, window)
    for channel in bench.channels:  # those without a value although their frames come
        t_ns = _usable_ns(window, channel)
        all_ns = messages.get(_message(channel), ())
        if channel.quantity is not Quantity.UNUSED and len(t_ns) < 0.9 * len(all_ns):
            messages[channel.name] = t_ns
    span_s = -bench.trigger.pre_s, bench.trigger.post_s
    silence = {
        name: longest_silence((t_ns - window.bump_ns) * 1e-9, *span_s)
        for name, t_ns in messages.items()
    }
    if not silence:
        return
    worst = max(silence, key=lambda name: silence[name].length_s / silence[name].limit_s)
    gap_s, limit_s = silence[worst].length_s, silence[worst].limit_s
    silent = [name for name, each in silence.items() if each.is_stale]
    all_ = f"all {len(silence)} messages"
    if silent:
        who = all_ if len(silent) == len(silence) > 1 else ", ".join(silent)
        were = plural(len(silent), "was", "were")
        text = f"{who} {were} silent or without a usable value for {gap_s:.2f} s"
        text += f" (limit {limit_s:.2f} s)"
        yield finding("stale", False, gap_s, limit_s, "s", text, worst)
    else:
        who = all_ if len(silence) > 1 else "the one message"
        text = f"{who} came; longest silence {gap_s * 1e3:.0f} ms ({worst})"
        yield finding("stale", True, gap_s, limit_s, "s", text)


def _usable_ns(window: RunWindow, channel: Channel) -> NDArray[np.int64]:
    """Return the time stamps of a channel's usable samples."""
    t_ns, value = window.channels.get(channel.name, (np.empty(0, np.int64), np.empty(0)))
    return t_ns[np.isfinite(value)]


def _best_of_message(bench: Bench, window: RunWindow) -> dict[str, NDArray[np.int64]]:
    """Return the time stamps of the channel with the most usable samples of each message."""
    best: dict[str, NDArray[np.int64]] = {}
    for channel in bench.channels:
        name, t_ns = _message(channel), _usable_ns(window, channel)
        if channel.quantity is not Quantity.UNUSED and len(t_ns) >= len(best.get(name, ())):
            best[name] = t_ns
    return best


def _message(channel: Channel) -> str:
    """Return the message of a channel; the channel itself if it is in none."""
    return message_of(channel.signal) or channel.name


def lost_frames(bench: Bench, window: RunWindow, signals: tuple[Trace, ...]) -> Iterator[Finding]:
    """Compare missing with received frames; judge a gap in the wheels' motion separately."""
    lost = window.losses.measured
    came = sum(map(len, _best_of_message(bench, window).values()))
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
