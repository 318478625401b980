"""Detects effects of a sensor's converter: cut tops, values that do not change, coarse steps.

Bench check, alarms, verdict and identification use them, and so agree about the same samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dbc.codec import DecodeCounts, Decoded, MessageLayout

from ..channels import TIME_DERIVATIVE, Quantity
from ..runs import Losses
from .clock import counter_steps

FINE_STEP = {"m/s2": 0.05, "rad/s": 0.01, "rad/s2": 0.05}
"""Converter steps by unit, SI, below which the sensor's own noise changes every sample."""


def flat_tops(value: NDArray[np.float64]) -> tuple[tuple[int, int], ...]:
    """Return the flat tops of a record, each as its first sample and the one after its last.

    A flat top is at an extreme of the record, has a steep side at each end, and is longer than
    noise makes it by chance.

    `value`, (n,) float64: one channel of one run, evenly sampled, in any unit; finite.
    """
    change = np.flatnonzero(np.diff(value))
    first_row, stop_row = change[:-1] + 1, change[1:] + 1  # of plateaus with steps on both sides
    if not len(first_row):
        return ()
    lowest, highest = value.min(), value.max()
    n_samples = stop_row - first_row
    is_extreme = (value[first_row] == lowest) | (value[first_row] == highest)
    if not (is_extreme & (n_samples > 1)).any():  # true of most channels, which need no sorting
        return ()
    sorted_steps = np.diff(np.sort(value))
    # Number of converter steps by which a signal must jump into a flat top and out of it: a
    # parabola that stays within one step for three samples leaves it by three, four with rounding.
    jump = 4.5 * sorted_steps[sorted_steps > 0.0].min()
    step_in = np.abs(value[first_row] - value[first_row - 1])
    step_out = np.abs(value[stop_row] - value[stop_row - 1])
    # Rate of repeats of a value reached by a steep step, where nothing is cut (rule of succession).
    is_steep_inside = (step_in > jump) & ~is_extreme
    repeats = (np.sum(n_samples[is_steep_inside] > 1) + 1) / (np.sum(is_steep_inside) + 2)
    # Probability below which equal samples are no chance: a campaign has about 10,000 extremes.
    is_unlikely = n_samples * repeats ** (n_samples - 1.0) < 1e-6
    is_flat = is_extreme & (np.minimum(step_in, step_out) > jump) & is_unlikely
    return tuple(zip(first_row[is_flat].tolist(), stop_row[is_flat].tolist(), strict=True))


def _change_rate(value: NDArray[np.float64]) -> float:
    """Return the changes of value per sample, 0..1; NaN for fewer than 20 samples."""
    return float(np.mean(np.diff(value) != 0.0)) if len(value) >= 20 else float("nan")


def is_stuck(n_equal: int, healthy_rate: float = 1.0) -> bool:
    """Return whether a value was held for too many samples.

    `n_equal`: number of consecutive equal samples.  `healthy_rate`: changes per sample of this
    channel when it is healthy, 0..1; 1 if its noise is above its steps.  False if that is NaN.
    """
    # If one sample in two changes, 20 expected changes fail to occur once in 500 million.
    return bool(n_equal * healthy_rate >= 20.0)


def is_fine(quantity: Quantity, unit: str, step: float) -> bool:
    """Return whether a sensor's noise is above its steps, so that it never holds a value.

    `quantity` and `unit`: of the channel, SI.  Displacements do not have this noise: a
    potentiometer rests on one value.  `step`: of the converter, in `unit`; 0 for floating point.
    """
    return TIME_DERIVATIVE.get(quantity, 0) > 0 and step < FINE_STEP[unit]


# Finds the longest time for which a channel held one value while the vehicle moved ----------------
#
# Verdict and identification use one rule: the desk leaves out no run that the bench accepted.

FROZEN_S = 0.2
"""Time, s, after which a constant channel is frozen, not saturated: two periods of the wheels."""


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """Longest hold of one value by one channel in one run."""

    n_equal: int
    """Number of its samples."""
    length_s: float
    """Its length, s; 0 if none that begins before +0.5 s of the decay reaches into it."""
    rest_rate: float
    """Changes of value per sample at rest, 0..1; NaN if there are too few samples."""
    decay_rate: float
    """Changes of value per sample in the decay, 0..1; NaN if there are too few samples."""
    constant: bool
    """True if the channel has one value in the whole run."""

    def is_frozen(self, healthy_rate: float) -> bool:
        """Return whether the hold is too long to be chance; `healthy_rate`: as of `is_stuck`."""
        return self.length_s >= FROZEN_S and is_stuck(self.n_equal, healthy_rate)


def longest_hold(
    time_s: NDArray[np.float64], value: NDArray[np.float64], rest_end_s: float, decay_start_s: float
) -> Hold:
    """Return the longest hold of a channel in a run.

    `time_s`, `value`: its samples, (n,) float64, n at least 1.  `rest_end_s`, `decay_start_s`: end
    of the rest before the bump, and start of the decay, on the axis of `time_s`.
    """
    last_rows = np.flatnonzero(np.diff(value, append=np.nan) != 0.0)
    first_rows = np.concatenate([[0], last_rows[:-1] + 1])
    # A hold counts if it reaches into the decay and begins before half a second of it is over:
    # after that, a coarse sensor may stay at one step of its converter.
    is_in_decay = (time_s[last_rows] > decay_start_s) & (time_s[first_rows] < decay_start_s + 0.5)
    length_s = np.where(is_in_decay, time_s[last_rows] - time_s[first_rows], 0.0)
    longest = int(length_s.argmax())
    return Hold(
        n_equal=int(last_rows[longest] - first_rows[longest]) + 1,
        length_s=float(length_s[longest]),
        rest_rate=_change_rate(value[time_s < rest_end_s]),
        decay_rate=_change_rate(value[time_s >= decay_start_s]),
        constant=bool(np.all(value == value[0])),
    )


# Counts the frames that did not become samples, as a pure fold over decoded blocks ----------------
#
# Frames with a wrong checksum have no reliable counter: they are counted as `crc_bad`, and because
# the next good counter then skips them, they are subtracted from the missing frames.  A repeated
# counter means a repeated frame, not a loss.  A counter that jumps further than the time allows
# means that the sensor restarted: the losses are then not known and not counted (`restarts` counts
# these cases).


@dataclass(frozen=True, slots=True)
class CounterHealth:
    """History of one message's counter."""

    last_value: int | None = None
    """Last reliable counter value; None before the first."""
    t_ns: int = 0
    """Arrival time of that frame, ns."""
    last_delay_s: float = 0.0
    """Delay of that frame, s (`CounterSteps.last_delay_s`)."""
    unreadable: int = 0
    """Number of frames with a wrong checksum since then."""
    received: int = 0
    """Number of frames with a good counter."""
    missing: int = 0
    """Number of frames that were sent and did not arrive."""
    restarts: int = 0


@dataclass(frozen=True, slots=True)
class HealthState:
    """State of the fold; the default is the initial state."""

    counters: Mapping[str, CounterHealth] = field(default_factory=dict)
    """Counters of the received messages that have one."""
    counts: Losses = field(default_factory=Losses)
    """Total numbers of frames that could not be decoded."""

    @property
    def losses(self) -> Losses:
        """Totals so far, without losses before decoding."""
        missing = sum(counter.missing for counter in self.counters.values())
        return replace(self.counts, counter_gaps=missing)


def advance(messages: Sequence[MessageLayout], state: HealthState, decoded: Decoded) -> HealthState:
    """Return the state after one decoded block.

    `messages`: the codec's messages.  `state`: result of the previous call; `HealthState()` at
    first.  `decoded`: the block, frames in order of arrival.
    """
    counters = dict(state.counters)
    for message in messages:
        counter_name = f"{message.name}.{message.counter.signal}" if message.counter else ""
        if counter_name in decoded.samples and len(decoded.samples[counter_name].t_ns):
            counters[message.name] = _counter_health(message, counters.get(message.name), decoded)
    added = Losses(**{name: getattr(decoded.counts, name) for name in DecodeCounts.__slots__})
    return HealthState(counters, losses_added(state.counts, added))


def _counter_health(
    message: MessageLayout, earlier: CounterHealth | None, decoded: Decoded
) -> CounterHealth:
    """Return the history of a message's counter after a block with at least one of its frames.

    Frames with a wrong checksum between two good ones look missing, and are subtracted.
    """
    assert message.counter is not None  # ensured by the caller
    samples = decoded[f"{message.name}.{message.counter.signal}"]
    health = earlier or CounterHealth()
    rows = np.flatnonzero(samples.usable)  # of the frames whose counter can be read
    if not len(rows):
        unreadable = health.unreadable + len(samples.usable)
        return replace(health, unreadable=0 if health.last_value is None else unreadable)
    first, last = int(rows[0]), int(rows[-1])
    unreadable_between = last - first + 1 - len(rows)  # two frames that can be read
    value, t_ns = samples.value[rows].astype(np.int64), samples.t_ns[rows]
    if health.last_value is not None:
        unreadable_between += health.unreadable + first
        value = np.concatenate([[health.last_value], value])
        t_ns = np.concatenate([[health.t_ns], t_ns])
    steps = counter_steps(
        value, message.counter.modulus, t_ns, message.cycle_s, health.last_delay_s
    )
    return CounterHealth(
        last_value=int(value[-1]),
        t_ns=int(t_ns[-1]),
        last_delay_s=steps.last_delay_s,
        unreadable=len(samples.usable) - 1 - last,
        received=health.received + len(rows),
        missing=health.missing + max(steps.missing - unreadable_between, 0),
        restarts=health.restarts + int(np.count_nonzero(steps.restarted)),
    )


def losses_added(some: Losses, others: Losses) -> Losses:
    """Return the sums of two counts, field by field."""
    return Losses(*(getattr(some, name) + getattr(others, name) for name in Losses.__slots__))
