"""Recovers the sensor's own clock from its rolling counter or from its time stamps.

A frame is stamped when it arrives, which is later than its sample by a varying delay, from other
frames on the bus, the operating system, or a reader that reads a whole block at one instant.  The
sensor itself samples evenly.  Sample k was taken at ``a + r k``; its frame arrives at
``t_k = a + r k + d_k`` with ``d_k >= 0``.  The line that lies below all points and has the least
mean distance from them is the maximum-likelihood line for exponential delays.  For any
distribution, its error is about the smallest delay divided by the number of punctual frames,
because it only requires that some frames are punctual.  Stalls do not move it.

If the scatter is so small that it is the noise of a hardware clock, which has two sides, least
squares is better.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Converts rolling counters, which wrap, to the number of frames sent ------------------------------
#
# The time of arrival gives the number of complete wraps.  A stalled reader delivers a whole backlog
# at one instant, so a single arrival proves little: a frame's sending time is limited by the
# arrival of the frames that followed it.

FASTEST = 0.95
"""Least ratio of a sensor's true cycle to that in the DBC (free-running oscillators)."""

_SLACK_FRAMES = 2.0
_SILENCE_S = 1.0
"""Time without a frame, s, from which a counter that continues where it stopped means that the
sender paused: it is far less likely that exactly a multiple of its range was lost."""


@dataclass(frozen=True, slots=True)
class CounterSteps:
    """Numbers of frames sent between neighbouring frames."""

    step: NDArray[np.int64]
    """Number of frames sent, shape (n - 1,): 1 if none is missing, 0 for a repeated frame."""
    restarted: NDArray[np.bool_]
    """True where the sensor began to count again (more frames than can have been sent in the time),
    or paused, shape (n - 1,).  `step` then follows from the time, and is at least 1."""
    late_s: float
    """Delay of the last frame compared with the most punctual one, s."""

    @property
    def missing(self) -> int:
        """Number of frames that were sent and did not arrive; not known around a restart."""
        return int(np.maximum(self.step - 1, 0)[~self.restarted].sum())


def counter_steps(
    counter: NDArray[np.int64],
    modulus: int,
    t_ns: NDArray[np.int64],
    cycle_s: float | None,
    late_s: float = 0.0,
) -> CounterSteps:
    """Return the numbers of frames sent between neighbours.

    `counter`, (n,) int64, n > 0: values of the rolling counter, 0..modulus - 1.  `modulus`: its
    range.  `t_ns`, (n,) int64: arrival of the frames.  `cycle_s`: nominal time between two frames.
    Without it complete wraps and restarts are not detected.  `late_s`: `CounterSteps.late_s` of the
    block that ended with the first frame of this one.
    """
    step = (counter[1:] - counter[:-1]) % modulus
    if cycle_s is None or not len(step):
        return CounterSteps(step, np.zeros(len(step), bool), late_s)
    arrival = (t_ns - t_ns[0]) * 1e-9 / cycle_s  # in cycles
    # The latest time at which each can have been sent: each later frame took one cycle.
    index = np.arange(len(arrival)) * FASTEST
    latest = np.minimum.accumulate((arrival - index)[::-1])[::-1] + index
    elapsed = latest[1:] - latest[:-1]
    forgotten = (1 - FASTEST) * float(arrival[-1])  # a sensor slower than nominal is not late
    if step.min() == step.max() == 1 and elapsed.max() <= modulus / 2:  # the usual case, quickly
        phase = latest - np.arange(len(latest))
        late_cycles = float(phase[-1]) - min(float(phase.min()), float(phase[0]) - late_s / cycle_s)
        restarted = np.zeros(len(step), bool)
        return CounterSteps(step, restarted, max(late_cycles - forgotten, 0.0) * cycle_s)
    turns = np.maximum(np.rint((elapsed - step) / modulus), 0).astype(np.int64)
    paused = (step == 1) & (turns > 0) & (elapsed * cycle_s >= _SILENCE_S)
    step = step + modulus * turns
    late = _lateness(latest, step, late_s / cycle_s)
    restarted = paused | (step > elapsed + late[:-1] + _SLACK_FRAMES)
    if np.any(restarted):
        by_time = np.maximum(np.rint(elapsed), 1).astype(np.int64)
        step = np.where(restarted, by_time, step)
        late = _lateness(latest, step, late_s / cycle_s)
    return CounterSteps(step, restarted, max(float(late[-1]) - forgotten, 0.0) * cycle_s)


def _lateness(
    arrival: NDArray[np.float64], step: NDArray[np.int64], late: float
) -> NDArray[np.float64]:
    phase = arrival - np.concatenate([[0], np.cumsum(step)])
    earliest = np.minimum(np.minimum.accumulate(phase), phase[0] - late)
    return np.asarray(phase - earliest)


# The clock ----------------------------------------------------------------------------------------

NOMINAL_TOLERANCE = 500e-6
"""Largest usual relative deviation of a quartz from the nominal cycle; a larger one is accepted
only if the data show it clearly."""

LARGEST_TOLERANCE = 1 - FASTEST

HARDWARE_SCATTER_S = 15e-6
"""Distance of quartiles, s, below which the scatter is the noise of a stamping clock and not
delays."""

_FEWEST = 20

_LATEST_SHARE = 0.9
"""Delay of nearly all frames, in cycles, from which a tick may be the next one."""
_ROUNDING_S = 1e-12
"""Difference, s, below which two heights above a line count as equal."""
_EARLY_SHARE = 0.2
"""Cycles by which a frame may come before its tick, within the accuracy of the tick."""
_PUNCTUAL_SHARE = 0.1
"""Delay, in cycles, below which a frame counts as punctual if frames come up to a cycle late."""
_MOST_AT_ONCE = 0.25
"""Share of frames at the same time as the previous one, from which the reader takes blocks."""
_MOST_GAPS = 0.1
"""Share of frames after a gap, from which the assumed clock may be twice too fast."""
_FOLLOWED_SHARE = 0.25
"""Delay, in cycles, that some frames of each stretch must not exceed if the frames follow the
clock."""
_NO_FRAME_MISSING = 1.5
"""Gap, in median gaps, below which no frame is missing between two frames."""
_SHORTEST_DELAY_S = 1e-6
"""Mean delay below the resolution of all stamps, s."""
_UNSURE_END = 2
"""Number of frames at the end of a run that count as late and not as after a gap, if no further
frame follows."""
_BELIEVED_RATE = (0.8, 1.25)
"""Lowest and highest rate, seconds of the bus per second of the sensor; outside, the stated unit or
wrap is wrong."""
_JUMP_S = 0.05
_JUMP_SHARE = 0.05
"""A restart may be between two frames whose stamps and arrivals differ by more than this time, and
by more than this share of the time between them."""
_WINDOW_S = 5.0
"""Time, s, over which delays before and after a suspected restart are compared; longer than any
stall."""


@dataclass(frozen=True, slots=True)
class SensorTimes:
    """Times of the samples of one message."""

    time_s: NDArray[np.float64]
    """Time of each sample since the given origin, s, strictly increasing, shape (n,); NaN for
    repeated frames."""
    step: NDArray[np.int64]
    """Number of samples taken since the previous frame, shape (n,): 1 if none is missing, 0 for a
    repeated frame, which is not a new sample."""


def arrival_times(t_ns: NDArray[np.int64], t0_ns: int) -> SensorTimes:
    """Return the arrival times, s, made strictly increasing by nanoseconds where necessary."""
    time_s = np.asarray((t_ns - t0_ns) * 1e-9, dtype=np.float64)
    return SensorTimes(_increasing(time_s), np.ones(len(t_ns), np.int64))


def sensor_times(
    counter: NDArray[np.int64], modulus: int, t_ns: NDArray[np.int64], cycle_s: float, t0_ns: int
) -> SensorTimes:
    """Return the times at which the samples were taken, up to the smallest transmission delay.

    `counter`, (n,) int64: rolling counter of the frames, 0..`modulus` - 1.  `t_ns`, (n,) int64:
    arrival time stamps, in order of arrival.  `cycle_s`: nominal time between two samples.
    `t0_ns`: origin of the result.

    Frames may be missing.  After a restart of the sensor a new line is fitted.  The arrival times
    are returned for fewer than 20 frames, and for a counter that mostly does not change.
    """
    if len(t_ns) < _FEWEST:
        return arrival_times(t_ns, t0_ns)
    steps = counter_steps(counter, modulus, t_ns, cycle_s)
    step = np.concatenate([[1], steps.step])
    if np.mean(step == 0) > 0.5:
        return arrival_times(t_ns, t0_ns)
    index: NDArray[np.float64] = np.cumsum(step).astype(np.float64)
    arrival = np.asarray((t_ns - t0_ns) * 1e-9, np.float64)
    return _between_restarts(index, arrival, step, steps.restarted, cycle_s)


def _between_restarts(
    index: NDArray[np.float64],
    arrival: NDArray[np.float64],
    step: NDArray[np.int64],
    restarted: NDArray[np.bool_],
    cycle_s: float,
) -> SensorTimes:
    """Return the times from a line for each part between restarts; NaN for repeated frames."""
    fresh = step > 0
    time_s = np.full(len(arrival), np.nan)
    for rows in np.split(np.arange(len(arrival)), np.flatnonzero(restarted) + 1):
        rows = rows[fresh[rows]]
        time_s[rows] = _fitted(index[rows], arrival[rows], cycle_s)
    time_s[fresh] = _increasing(time_s[fresh])
    return SensorTimes(time_s, step)


def even_times(t_ns: NDArray[np.int64], t0_ns: int) -> SensorTimes:
    """Return the times at which samples of a message without counter were taken, if it is periodic.

    Each frame belongs to a tick of an even clock that it follows by less than a cycle; the clock is
    then fitted as with a counter.  If frames come later than that, none may be missing: the run
    then has a frame for each tick.  Frames that are not periodic have their arrival times.

    `t_ns`, (n,) int64: arrival time stamps, in order of arrival.  `t0_ns`: origin of the result.
    """
    if len(t_ns) < _FEWEST:
        return arrival_times(t_ns, t0_ns)
    arrival: NDArray[np.float64] = np.asarray((t_ns - t0_ns) * 1e-9, dtype=np.float64)
    best = min(_possible_ticks(arrival), key=lambda ticks: ticks.unlikeliness, default=None)
    if best is None:
        return arrival_times(t_ns, t0_ns)
    step = np.concatenate([[1], np.diff(best.index)]).astype(np.int64)
    return SensorTimes(_increasing(_fitted(best.index, arrival, best.cycle_s)), step)


@dataclass(frozen=True, slots=True)
class _Ticks:
    """An even clock that may have sent the frames of a run."""

    index: NDArray[np.float64]
    """Number of the tick of each frame, shape (n,)."""
    late_s: NDArray[np.float64]
    """Delay of each frame after its tick, s, shape (n,)."""
    cycle_s: float
    """Time between two ticks, s."""

    @property
    def unlikeliness(self) -> float:
        """The unlikeliness of a clock: from late frames, and from each gap with its place.

        For exponential delays it is the negative logarithm of the likelihood, up to a constant.
        """
        n = len(self.index)
        mean_s = max(float(np.mean(self.late_s)), _SHORTEST_DELAY_S)
        return float(n * np.log(mean_s) + np.sum(np.diff(self.index) > 1) * np.log(n))


def _possible_ticks(arrival: NDArray[np.float64]) -> list[_Ticks]:
    """Return the clocks that explain the arrivals of a run.

    If frames of another sensor delay some frames, the median gap may belong to a clock that is a
    sixteenth too fast and of which every sixteenth frame is missing; the mean gap does not.
    """
    gap = np.diff(arrival)
    median_s = float(np.median(gap))
    if not median_s > 0.0:
        return []
    mean_s = float(np.mean(gap[gap < _NO_FRAME_MISSING * median_s]))
    tried = (_punctual_ticks(arrival, median_s), _punctual_ticks(arrival, mean_s))
    return [ticks for ticks in (*tried, _all_ticks(arrival)) if ticks is not None]


def _punctual_ticks(arrival: NDArray[np.float64], cycle_s: float) -> _Ticks | None:
    """Return the tick of each frame, if frames come less than a cycle late.

    `cycle_s`: the approximate cycle of the first frames.
    """
    index, late_s, cycle_s = _ticks(arrival, cycle_s)
    late = np.quantile(late_s, 0.95) > _LATEST_SHARE * cycle_s
    gaps = np.flatnonzero(np.diff(index) > 1)
    follows = _latest_stretch_s(late_s) < _FOLLOWED_SHARE * cycle_s
    if late or not follows or len(gaps) > _MOST_GAPS * len(index):
        return None
    if len(gaps) and gaps[0] >= len(index) - 1 - _UNSURE_END:
        index = np.arange(len(index), dtype=np.float64)  # late, and not after the only gap
    return _Ticks(index, late_s, cycle_s)


def _ticks(
    arrival: NDArray[np.float64], cycle_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return the tick of an even clock that sent each frame, its lateness, and the cycle.

    The median gap is wrong by a part of the scatter, so the clock is fitted to the first frames and
    then to a quarter more frames in each step.  A frame that seems to come after the next tick was
    sent before this tick if a later frame was: frames of one message do not overtake each other.
    """
    n = _FEWEST
    since = arrival - arrival[0]
    start_s = float(np.min(since[:n] - cycle_s * np.rint(since[:n] / cycle_s)))
    while True:
        count = np.arange(min(n, len(since)))
        part = since[:n]
        lost = np.floor((part - start_s) / cycle_s + _EARLY_SHARE) - count
        index = np.asarray(np.minimum.accumulate(lost[::-1])[::-1] + count, np.float64)
        middle = float(index.mean())
        k = np.asarray(index - middle, np.float64)
        low, cycle_s = lower_line(k, part, cycle_s, LARGEST_TOLERANCE)
        start_s = low - cycle_s * middle
        if n >= len(since):
            return index, np.asarray(part - start_s - cycle_s * index, np.float64), cycle_s
        n += n // 4


def _all_ticks(arrival: NDArray[np.float64]) -> _Ticks | None:
    """Return the tick of each frame and the cycle, if a frame for each tick explains the arrivals.

    Then some of any 20 to 40 consecutive frames are punctual; after a missing frame all would be
    late by a cycle.  A reader that takes blocks of frames delays even the first frame of each
    block, by the same time in the whole run, which cannot be detected.
    """
    # The first and the last frame may be late by several cycles, which changes their distance.
    rough_s = float(arrival[-1] - arrival[0]) / (len(arrival) - 1)
    if not rough_s > 0.0 or np.mean(np.diff(arrival) < _PUNCTUAL_SHARE * rough_s) > _MOST_AT_ONCE:
        return None
    index: NDArray[np.float64] = np.arange(len(arrival), dtype=np.float64)
    k = index - index.mean()
    start, cycle_s = lower_line(k, arrival - arrival[0], rough_s, LARGEST_TOLERANCE)
    late_s = arrival - arrival[0] - start - cycle_s * k
    if _latest_stretch_s(late_s) >= _PUNCTUAL_SHARE * cycle_s:
        return None
    return _Ticks(index, late_s, cycle_s)


def _latest_stretch_s(late_s: NDArray[np.float64]) -> float:
    """Return the largest delay, s, of the most punctual of 20 to 40 consecutive frames.

    If one frame has a wrong tick, all later frames have one too, and are later than those before.
    """
    parts = np.array_split(late_s, len(late_s) // _FEWEST)
    return max(float(part.min()) for part in parts)


def stamped_times(
    stamp_s: NDArray[np.float64], wrap_s: float, t_ns: NDArray[np.int64], t0_ns: int
) -> SensorTimes:
    """Return the times at which the samples were taken, from the time stamps of their sensor.

    `stamp_s`, (n,) float64: the sensor's time, s; starts again from 0 at `wrap_s`.  `t_ns`, (n,)
    int64: arrival time stamps, in order of arrival.  `t0_ns`: origin of the result.

    Samples need not be evenly spaced; `SensorTimes.step` counts in the most usual spacing.  After a
    restart of the sensor a new line is fitted.  The arrival times are returned for fewer than 20
    frames, and for stamps that do not run with the time of the bus.
    """
    arrival: NDArray[np.float64] = np.asarray((t_ns - t0_ns) * 1e-9, dtype=np.float64)
    if len(t_ns) < _FEWEST:
        return arrival_times(t_ns, t0_ns)
    gap = np.diff(stamp_s) % wrap_s
    elapsed: NDArray[np.float64] = np.diff(arrival)
    gap += wrap_s * np.maximum(np.rint((elapsed - gap) / wrap_s), 0)
    restarted = _restarts(gap, elapsed, arrival)
    usual = gap[(gap > 0) & ~restarted]
    if len(usual) < len(gap) / 3:
        return arrival_times(t_ns, t0_ns)
    rate = float(np.sum(elapsed[~restarted]) / np.sum(gap[~restarted]))
    if not _BELIEVED_RATE[0] < rate < _BELIEVED_RATE[1]:
        return arrival_times(t_ns, t0_ns)
    gap = np.where(restarted, np.maximum(elapsed, 1e-6), gap)
    cycle_s = float(np.median(usual))
    step = np.where(gap > 0, np.maximum(np.rint(gap / cycle_s), 1), 0).astype(np.int64)
    step = np.concatenate([[1], step])
    sensor_s = np.concatenate([[0.0], np.cumsum(gap)])
    return _between_restarts(sensor_s, arrival, step, restarted, 1.0)


def _restarts(
    gap: NDArray[np.float64], elapsed: NDArray[np.float64], arrival: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return a mask of the neighbours between which the sensor began to count time again.

    After late frames the following frames return to the line of punctual ones; after a restart none
    does.
    """
    restarted = np.zeros(len(gap), np.bool_)
    late = np.concatenate([[0.0], np.cumsum(elapsed - gap)])
    first = 0
    for i in np.flatnonzero(np.abs(elapsed - gap) > _JUMP_S + _JUMP_SHARE * elapsed).tolist():
        start = max(first, int(np.searchsorted(arrival, arrival[i] - _WINDOW_S)))
        end = int(np.searchsorted(arrival, arrival[i + 1] + _WINDOW_S, "right"))
        shift = float(np.min(late[i + 1 : end]) - np.min(late[start : i + 1]))
        if abs(shift) > _JUMP_S + _JUMP_SHARE * float(elapsed[i]):
            restarted[i] = True
            late[i + 1 :] -= late[i + 1] - late[i]
            first = i + 1
    return restarted


def _fitted(
    index: NDArray[np.float64], arrival: NDArray[np.float64], cycle_s: float
) -> NDArray[np.float64]:
    if len(index) < _FEWEST:
        return arrival
    k = index - index.mean()
    origin = arrival[0]
    y = arrival - origin
    start, rate = lower_line(k, y, cycle_s, NOMINAL_TOLERANCE)
    if abs(rate / cycle_s - 1) > 0.999 * NOMINAL_TOLERANCE:  # otherwise the free line is the same
        free_start, free_rate = lower_line(k, y, cycle_s, LARGEST_TOLERANCE)
        if np.mean(y) - start > 2 * (np.mean(y) - free_start):  # k has mean 0: the mean distances
            start, rate = free_start, free_rate
    late = y - rate * k  # from any origin: only its scatter counts
    low, middle, high = np.quantile(late, [0.25, 0.5, 0.75]).tolist()
    if high - low < HARDWARE_SCATTER_S:
        punctual = np.abs(late - middle) <= max(5 * (high - low), 1e-6)
        rate, start = np.polyfit(k[punctual], y[punctual], 1).tolist()
    return np.asarray(origin + start + rate * k)


def lower_line(
    k: NDArray[np.float64], y: NDArray[np.float64], cycle_s: float, tolerance: float
) -> tuple[float, float]:
    """Return the line below all points with the least mean distance from them.

    The mean distance is convex in the slope, and the best line is the edge of the lower convex hull
    above the mean of k.  It is found by cutting planes: one end of a chord between a point left and
    a point right of the mean is replaced by the point furthest below the chord, until there is none
    below it.

    `k`, (n,) float64: abscissae with mean 0.  `y`, (n,) float64: ordinates.  `cycle_s` and
    `tolerance`: the slope is kept within ``cycle_s (1 +- tolerance)``.  Returns start and slope of
    the line ``start + slope k``.
    """
    slowest, fastest = cycle_s * (1 + tolerance), cycle_s * (1 - tolerance)
    left, right = int(np.argmin(y - fastest * k)), int(np.argmin(y - slowest * k))
    if k[left] >= 0:
        return float(y[left] - fastest * k[left]), fastest
    if k[right] <= 0:
        return float(y[right] - slowest * k[right]), slowest
    while True:
        slope = float((y[right] - y[left]) / (k[right] - k[left]))
        height = y - slope * k
        lowest = int(np.argmin(height))
        # Points on one line differ by rounding, and each would in turn be the lowest, without end.
        if height[lowest] >= min(height[left], height[right]) - _ROUNDING_S:
            return float(height[lowest]), slope
        if k[lowest] < 0:
            left = lowest
        else:
            right = lowest


def _increasing(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    if np.all(np.diff(time_s) > 0):
        return time_s
    ns = np.arange(len(time_s)) * 1e-9
    return np.asarray(np.maximum.accumulate(time_s - ns) + ns)
