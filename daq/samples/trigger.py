"""Detects bumps, as a pure fold over blocks of the trigger channels.

Each channel has a level of rest (gravity and offset are in the signal), which is the mean over the
last slot of data time.  A *slot* is `TriggerConfig.rest_s` long and aligned to the time stamps, so
the result does not depend on how the data were cut into blocks.  Only the frames give the time.

The fold waits until every channel has rested for `rest_s`, is then armed, finds the onset of the
bump, ends the run `post_s` later and waits again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ..bench.config import TriggerConfig
from ..runs import Event
from .mapping import SampleBlock

BUMP = "bump"
RUN_END = "run_end"
CLOCK_STEP = "clock_step"
UNPLANNED = "unplanned_"
"""Prefix of the code of a bump, and of its end, for which no run was armed."""


class TriggerPhase(StrEnum):
    """Phase of the fold in the course of a run."""

    WAITING = "waiting"
    ARMED = "armed"
    RUNNING = "running"


@dataclass(frozen=True, slots=True)
class ChannelRest:
    """Level and rest of one trigger channel."""

    quiet_since_ns: int
    """Time of the last sample away from rest (or of the first sample), ns."""
    slot: int
    """Number of the present slot: time stamp over `rest_s`."""
    first_value: float
    """First sample of all, which is the level until a slot is complete."""
    rest_level: float = float("nan")
    """Mean of the last complete slot; NaN until then."""
    total: float = 0.0
    count: int = 0
    """Sum and number of the samples of the present slot."""
    last_side: int = 0
    """+1 or -1 if the last sample was far above or below rest (`TriggerConfig.level`), else 0."""
    last_ns: int = 0

    def rested(self, now_ns: int, rest_ns: int, since_ns: int = 0) -> bool:
        """Return whether the channel has rested for `rest_ns`, of the time since `since_ns`."""
        known = not np.isnan(self.rest_level)
        return known and now_ns - max(self.quiet_since_ns, since_ns) >= rest_ns


@dataclass(frozen=True, slots=True)
class TriggerState:
    """State of the fold; the default is the initial state."""

    phase: TriggerPhase = TriggerPhase.WAITING
    since_ns: int = 0
    """Time at which the phase began, ns; in a run, the time of the bump."""
    now_ns: int | None = None
    """Latest time stamp so far, ns; None before the first."""
    channels: Mapping[str, ChannelRest] = field(default_factory=dict)
    """The trigger channels received so far."""


def advance(
    config: TriggerConfig, state: TriggerState, block: SampleBlock
) -> tuple[TriggerState, tuple[Event, ...]]:
    """Return the state after one block of samples, and events.

    `state`: result of the previous call; `TriggerState()` at first.  `block`: new samples of each
    channel in order of arrival, SI.  Values that are not finite are skipped; the channels may have
    different clocks and any of them may be absent.  Returns the state after the block, and events:
    `bump` at the first of two consecutive samples that leave rest on the same side; `run_end` at
    ``t_bump + post_s`` when the data have passed it; `clock_step` if the time stamps went back.
    """
    finite = {
        name: (t_ns[is_finite], value[is_finite])
        for name, (t_ns, value) in block.items()
        if (is_finite := np.isfinite(value)).any()
    }
    if not finite:
        return state, ()
    events: list[Event] = []
    latest_ns = max(int(t_ns[-1]) for t_ns, _ in finite.values())
    # Stamps that go back by more than a second mean that a clock was set, and not late frames.
    if state.now_ns is not None and latest_ns < state.now_ns - 1_000_000_000:
        events.append(Event(latest_ns, CLOCK_STEP, (latest_ns - state.now_ns) * 1e-9))
        state = TriggerState()
    if not state.channels:
        state = replace(state, since_ns=min(int(t_ns[0]) for t_ns, _ in finite.values()))
    slot_ns = round(config.rest_s * 1e9)
    slots = {name: t_ns // slot_ns for name, (t_ns, _) in finite.items()}
    for slot in np.unique(np.concatenate(list(slots.values()))).tolist():
        slot_block = {
            name: (t_ns[rows], value[rows])
            for name, (t_ns, value) in finite.items()
            if (rows := slots[name] == slot).any()
        }
        state = _advance_slot(config, state, slot, slot_block, events)
    return state, tuple(events)


def not_at_rest(config: TriggerConfig, state: TriggerState) -> tuple[str, ...]:
    """Return the names of the trigger channels that now prevent arming; none if it does not wait.

    `state`: from `advance`.
    """
    if state.phase is not TriggerPhase.WAITING or state.now_ns is None:
        return ()
    now_ns, rest_ns = state.now_ns, round(config.rest_s * 1e9)
    return tuple(
        name for name, channel in state.channels.items() if not channel.rested(now_ns, rest_ns)
    )


def pre_trigger_full(config: TriggerConfig, state: TriggerState, kept_since_ns: int) -> bool:
    """Return whether the samples kept since a time reach `pre_s` back from the latest one."""
    return state.now_ns is not None and state.now_ns - kept_since_ns >= round(config.pre_s * 1e9)


def _advance_slot(
    config: TriggerConfig, state: TriggerState, slot: int, block: SampleBlock, events: list[Event]
) -> TriggerState:
    """Return the state after the samples of one slot; adds what happened in it to `events`."""
    slot_ns = round(config.rest_s * 1e9)
    channels = dict(state.channels)
    for name, channel in state.channels.items():
        if channel.slot < slot:  # the mean of the last slot becomes the level
            rest_level = channel.total / channel.count if channel.count else channel.rest_level
            channels[name] = replace(channel, slot=slot, rest_level=rest_level, total=0.0, count=0)
    now_ns = slot * slot_ns
    has_rested = all(c.rested(now_ns, slot_ns, state.since_ns) for c in channels.values())
    if state.phase is TriggerPhase.WAITING and channels and has_rested:
        state = replace(state, phase=TriggerPhase.ARMED, since_ns=now_ns)
    onsets = []
    for name, (t_ns, value) in block.items():
        earlier = channels.get(name) or ChannelRest(int(t_ns[0]), slot, float(value[0]))
        channels[name], onset_ns, size = _excursion(
            earlier, t_ns, value, config.level, state.since_ns
        )
        if onset_ns is not None:
            onsets.append((onset_ns, name, size))
    latest_ns = max(int(t_ns[-1]) for t_ns, _ in block.values())
    now_ns = latest_ns if state.now_ns is None else max(state.now_ns, latest_ns)
    state = replace(state, now_ns=now_ns, channels=channels)
    if state.phase is TriggerPhase.ARMED and onsets:
        onset_ns, name, size = min(onsets)
        events.append(Event(onset_ns, BUMP, size, name))
        state = replace(state, phase=TriggerPhase.RUNNING, since_ns=onset_ns)
    end_ns = state.since_ns + round(config.post_s * 1e9)
    if state.phase is TriggerPhase.RUNNING and now_ns >= end_ns:
        events.append(Event(end_ns, RUN_END))
        state = replace(state, phase=TriggerPhase.WAITING, since_ns=end_ns)
    return state


def _excursion(
    channel: ChannelRest,
    t_ns: NDArray[np.int64],
    value: NDArray[np.float64],
    threshold: float,
    since_ns: int,
) -> tuple[ChannelRest, int | None, float]:
    """Return the channel after these samples, and time and size of the first onset, if any.

    `threshold`: deviation from rest, in the channel's unit, above which a sample is away from it.
    One sample away from rest is not yet motion (a spike); two on the same side are: the onset is
    the first of them, at `since_ns` or later, and its size is the deviation of the second.
    """
    rest_level = channel.first_value if np.isnan(channel.rest_level) else channel.rest_level
    deviation = value - rest_level
    side = np.where(np.abs(deviation) > threshold, np.sign(deviation), 0.0).astype(np.int8)
    previous_side = np.concatenate([[channel.last_side], side[:-1]])
    previous_ns = np.concatenate([[channel.last_ns], t_ns[:-1]])
    moving = np.flatnonzero((side != 0) & (side == previous_side))
    after = replace(
        channel,
        total=channel.total + float(value.sum()),
        count=channel.count + len(value),
        last_side=int(side[-1]),
        last_ns=int(t_ns[-1]),
        quiet_since_ns=int(t_ns[moving[-1]]) if len(moving) else channel.quiet_since_ns,
    )
    onset_rows = moving[previous_ns[moving] >= since_ns]
    if not len(onset_rows):
        return after, None, 0.0
    return after, int(previous_ns[onset_rows[0]]), float(deviation[onset_rows[0]])
