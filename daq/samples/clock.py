"""Recovers the sensor's own clock from its rolling counter or from its time stamps.

A frame is stamped when it arrives, which is later than its sample by a varying delay, from other
frames on the bus, the operating system, or a reader that reads a whole block at one instant.  The
sensor itself samples evenly.  Sample k was taken at ``a + r k``; its frame arrives at
``t_k = a + r k + d_k`` with ``d_k >= 0``.  The line that lies below all points and has the least
mean distance from them is the maximum-likelihood line for exponential delays.  For any
distribution, its error is about the smallest delay divided by the number of punctual frames,
because it only requires that some frames are punctual.  Stalls do not move it.
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


@dataclass(frozen=True, slots=True)
class CounterSteps:
    """Numbers of frames sent between neighbouring frames."""

    step: NDArray[np.int64]
    """Number of frames sent, shape (n - 1,): 1 if none is missing, 0 for a repeated frame."""
    restarted: NDArray[np.bool_]
    """True where the sensor began to count again (more frames than can have been sent in the time),
    or paused, shape (n - 1,).  `step` then follows from the time, and is at least 1."""
    last_delay_s: float
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
    delay_before_s: float = 0.0,
) -> CounterSteps:
    """Return the numbers of frames that a sensor sent between neighbouring received ones.

    `counter`, (n,) int64, n > 0: values of the rolling counter, 0..modulus - 1.  `modulus`: its
    range.  `t_ns`, (n,) int64: arrival of the frames.  `cycle_s`: nominal time between two frames.
    Without it complete wraps and restarts are not detected.  `delay_before_s`: `last_delay_s` of
    the block that ended with the first frame of this one.
    """
    step = (counter[1:] - counter[:-1]) % modulus
    if cycle_s is None or not len(step):
        return CounterSteps(step, np.zeros(len(step), bool), delay_before_s)
    arrival_cycles = (t_ns - t_ns[0]) * 1e-9 / cycle_s  # in cycles, as all times below
    delay_before = delay_before_s / cycle_s
    sent_cycles = latest_sent(arrival_cycles, FASTEST)
    elapsed_cycles = sent_cycles[1:] - sent_cycles[:-1]
    wraps = np.maximum(np.rint((elapsed_cycles - step) / modulus), 0).astype(np.int64)
    # Time without a frame, s, from which a counter that continues where it stopped means that the
    # sender paused: it is far less likely that exactly a multiple of its range was lost.
    paused = (step == 1) & (wraps > 0) & (elapsed_cycles * cycle_s >= 1.0)
    step = step + modulus * wraps
    delay = _delays(sent_cycles, step, delay_before)
    # A counter may be two frames ahead of the time without a restart.
    restarted = paused | (step > elapsed_cycles + delay[:-1] + 2.0)
    if np.any(restarted):
        steps_by_time = np.maximum(np.rint(elapsed_cycles), 1).astype(np.int64)
        step = np.where(restarted, steps_by_time, step)
        delay = _delays(sent_cycles, step, delay_before)
    drift = (1 - FASTEST) * float(arrival_cycles[-1])  # of the slowest sensor: it is no delay
    return CounterSteps(step, restarted, max(float(delay[-1]) - drift, 0.0) * cycle_s)


def latest_sent(arrival: NDArray[np.float64], shortest_cycle: float) -> NDArray[np.float64]:
    """Return the latest time at which each frame can have been sent, (n,), in any unit of time.

    A frame was sent at least `shortest_cycle` before the next one was, and so on until the frame
    of the earliest arrival: a delayed reader delivers several frames at one instant.
    """
    since_first = np.arange(len(arrival)) * shortest_cycle
    # The delay of each frame is at most that of any later one: a minimum from the end.
    delay = np.minimum.accumulate((arrival - since_first)[::-1])[::-1]
    return np.asarray(delay + since_first)


def _delays(
    sent_cycles: NDArray[np.float64], step: NDArray[np.int64], delay_before: float
) -> NDArray[np.float64]:
    """Return the delays of frames after the most punctual one until then, (n,); all in cycles."""
    phase = sent_cycles - np.concatenate([[0], np.cumsum(step)])
    most_punctual = np.minimum(np.minimum.accumulate(phase), phase[0] - delay_before)
    return np.asarray(phase - most_punctual)


# The clock ----------------------------------------------------------------------------------------

NOMINAL_TOLERANCE = 500e-6
"""Largest usual relative deviation of a quartz from the nominal cycle; a larger one is accepted
only if the data show it clearly."""

LARGEST_TOLERANCE = 1 - FASTEST

_FEWEST = 20  # frames to which a clock is fitted, and frames of a stretch

_PUNCTUAL_CYCLES = 0.1
"""Delay, in cycles, below which a frame counts as punctual although others are cycles late."""
_WINDOW_S = 5.0
"""Time, s, over which delays around a suspected restart are compared; longer than any stall."""


@dataclass(frozen=True, slots=True)
class SensorTimes:
    """Times of the samples of one message."""

    time_s: NDArray[np.float64]
    """Time of each sample since the origin, s, increasing, shape (n,); NaN for repeated frames."""
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
    if np.mean(step == 0) > 0.5:  # the counter mostly stands still
        return arrival_times(t_ns, t0_ns)
    index: NDArray[np.float64] = np.cumsum(step).astype(np.float64)
    arrival_s = np.asarray((t_ns - t0_ns) * 1e-9, np.float64)
    return _times_between_restarts(index, arrival_s, step, steps.restarted, cycle_s)


def _times_between_restarts(
    sensor_time: NDArray[np.float64],
    arrival_s: NDArray[np.float64],
    step: NDArray[np.int64],
    restarted: NDArray[np.bool_],
    unit_s: float,
) -> SensorTimes:
    """Return the times from a line for each part between restarts; NaN for repeated frames.

    `sensor_time`, (n,): number of the sample, or the sensor's own time, in units of `unit_s`.
    """
    is_sample = step > 0
    time_s = np.full(len(arrival_s), np.nan)
    for part in np.split(np.arange(len(arrival_s)), np.flatnonzero(restarted) + 1):
        rows = part[is_sample[part]]
        time_s[rows] = _fitted_times(sensor_time[rows], arrival_s[rows], unit_s)
    time_s[is_sample] = _increasing(time_s[is_sample])
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
    arrival_s: NDArray[np.float64] = np.asarray((t_ns - t0_ns) * 1e-9, dtype=np.float64)
    gap_s = np.diff(arrival_s)
    median_s = float(np.median(gap_s))
    if not median_s > 0.0:
        return arrival_times(t_ns, t0_ns)
    # If frames of another sensor delay some frames, the median gap may belong to a clock that is a
    # sixteenth too fast and of which every sixteenth frame is missing; the mean of the gaps in
    # which no frame is missing does not.
    mean_s = float(np.mean(gap_s[gap_s < 1.5 * median_s]))
    punctual = [_punctual_ticks(arrival_s, rough_s) for rough_s in (median_s, mean_s)]
    clocks = [clock for clock in (*punctual, _consecutive_ticks(arrival_s)) if clock is not None]
    best = min(clocks, key=lambda clock: clock.unlikeliness, default=None)
    if best is None:
        return arrival_times(t_ns, t0_ns)
    step = np.concatenate([[1], np.diff(best.index)]).astype(np.int64)
    return SensorTimes(_increasing(_fitted_times(best.index, arrival_s, best.cycle_s)), step)


@dataclass(frozen=True, slots=True)
class _Ticks:
    """An even clock that may have sent the frames of a run."""

    index: NDArray[np.float64]
    """Number of the tick of each frame, shape (n,)."""
    delay_s: NDArray[np.float64]
    """Delay of each frame after its tick, s, shape (n,)."""
    cycle_s: float

    @property
    def unlikeliness(self) -> float:
        """Negative logarithm of the likelihood for exponential delays, up to a constant.

        Each gap in the ticks may be after any of the n frames, which divides the likelihood by n.
        """
        n = len(self.index)
        mean_s = max(float(np.mean(self.delay_s)), 1e-6)  # no time stamp is finer than 1 us
        return float(n * np.log(mean_s) + np.sum(np.diff(self.index) > 1) * np.log(n))

    @property
    def latest_stretch_cycles(self) -> float:
        """Least delay in a stretch of 20 to 40 frames, in cycles: the largest of all stretches.

        If one frame has a wrong tick, all later frames have one too, and are later than before.
        """
        stretches = np.array_split(self.delay_s, len(self.delay_s) // _FEWEST)
        return max(float(stretch.min()) for stretch in stretches) / self.cycle_s


def _punctual_ticks(arrival_s: NDArray[np.float64], rough_s: float) -> _Ticks | None:
    """Return the tick of each frame, if frames come less than a cycle late.

    `rough_s`: the approximate cycle of the first frames, s.
    """
    ticks = _ticks(arrival_s, rough_s)
    # At most one frame in 20 may come so late, in cycles, that its tick may be the next one.
    is_too_late = np.quantile(ticks.delay_s, 0.95) > 0.9 * ticks.cycle_s
    n_gaps = np.count_nonzero(np.diff(ticks.index) > 1)
    # Delay, in cycles, below which each stretch has a frame if they follow the clock.
    follows_clock = ticks.latest_stretch_cycles < 0.25
    # Number of gaps for each frame, from which the assumed clock may be twice too fast.
    may_be_too_fast = n_gaps > 0.1 * len(ticks.index)
    return None if is_too_late or not follows_clock or may_be_too_fast else ticks


def _ticks(arrival_s: NDArray[np.float64], rough_s: float) -> _Ticks:
    """Return the even clock that most of the frames follow, less than a cycle later.

    The median gap is wrong by a part of the scatter, so the clock is fitted to the first frames and
    then to a quarter more frames in each step.  A frame that seems to come after the next tick was
    sent before this tick if a later frame was: frames of one message do not overtake each other.
    """
    n_fitted, cycle_s = _FEWEST, rough_s
    since_s = arrival_s - arrival_s[0]
    start_s = float(np.min(since_s[:n_fitted] - cycle_s * np.rint(since_s[:n_fitted] / cycle_s)))
    while True:
        fitted_s = since_s[:n_fitted]
        count = np.arange(len(fitted_s))
        # Number of ticks without a frame before each.  A frame may seem to come up to 0.2 cycles
        # before its tick, within the accuracy of the tick.
        skipped = np.floor((fitted_s - start_s) / cycle_s + 0.2) - count
        ticks = _fitted_ticks(np.minimum.accumulate(skipped[::-1])[::-1] + count, fitted_s, cycle_s)
        if n_fitted >= len(since_s):
            return ticks
        cycle_s = ticks.cycle_s
        start_s = float(fitted_s[0] - ticks.delay_s[0] - cycle_s * ticks.index[0])
        n_fitted += n_fitted // 4


def _fitted_ticks(
    index: NDArray[np.float64], arrival_s: NDArray[np.float64], rough_s: float
) -> _Ticks:
    """Return the clock whose ticks of these numbers are just before the arrivals."""
    from_middle: NDArray[np.float64] = index - index.mean()
    middle_s, cycle_s = lower_line(from_middle, arrival_s, rough_s, LARGEST_TOLERANCE)
    return _Ticks(index, arrival_s - middle_s - cycle_s * from_middle, cycle_s)


def _consecutive_ticks(arrival_s: NDArray[np.float64]) -> _Ticks | None:
    """Return the tick of each frame and the cycle, if a frame for each tick explains the arrivals.

    Then some of any 20 to 40 consecutive frames are punctual; after a missing frame all would be
    late by a cycle.  A reader that takes blocks of frames delays even the first frame of each
    block, by the same time in the whole run, which cannot be detected.
    """
    # The first and the last frame may be late by several cycles, which changes their distance.
    since_s = arrival_s - arrival_s[0]
    rough_s = float(since_s[-1]) / (len(since_s) - 1)
    is_at_once = np.diff(arrival_s) < _PUNCTUAL_CYCLES * rough_s
    # If more than a quarter of the frames come with the previous one, the reader takes blocks.
    if not rough_s > 0.0 or np.mean(is_at_once) > 0.25:
        return None
    ticks = _fitted_ticks(np.arange(len(since_s), dtype=np.float64), since_s, rough_s)
    return ticks if ticks.latest_stretch_cycles < _PUNCTUAL_CYCLES else None


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
    if len(t_ns) < _FEWEST:
        return arrival_times(t_ns, t0_ns)
    arrival_s: NDArray[np.float64] = np.asarray((t_ns - t0_ns) * 1e-9, dtype=np.float64)
    gap_s = np.diff(stamp_s) % wrap_s
    elapsed_s: NDArray[np.float64] = np.diff(arrival_s)
    gap_s += wrap_s * np.maximum(np.rint((elapsed_s - gap_s) / wrap_s), 0)  # complete wraps
    restarted = _restarts(gap_s, elapsed_s, arrival_s)
    spacing_s = gap_s[(gap_s > 0) & ~restarted]
    if len(spacing_s) < len(gap_s) / 3:  # two thirds of the frames repeat a stamp
        return arrival_times(t_ns, t0_ns)
    # A microsecond around a restart, so that the times of samples increase.
    gap_s = np.where(restarted, np.maximum(elapsed_s, 1e-6), gap_s)
    cycle_s = float(np.median(spacing_s))
    step = np.where(gap_s > 0, np.maximum(np.rint(gap_s / cycle_s), 1), 0).astype(np.int64)
    step = np.concatenate([[1], step])
    sensor_s = np.concatenate([[0.0], np.cumsum(gap_s)])
    return _times_between_restarts(sensor_s, arrival_s, step, restarted, unit_s=1.0)


def _restarts(
    gap_s: NDArray[np.float64], elapsed_s: NDArray[np.float64], arrival_s: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return a mask of the neighbours between which the sensor began to count time again, (n - 1,).

    `gap_s`, `elapsed_s`, (n - 1,): time between neighbours by the sensor's stamps and by arrival.
    `arrival_s`, (n,).  A restart may be where both differ by more than a threshold.  It is one if
    the least delay of the frames within `_WINDOW_S` before differs by more than the threshold from
    that of the frames within `_WINDOW_S` after: after late frames, later ones are punctual again.
    """
    restarted = np.zeros(len(gap_s), np.bool_)
    # A restart may be between two frames whose stamps and arrivals differ by more than this time,
    # and by more than this share of the time between them.
    threshold_s = 0.05 + 0.05 * elapsed_s
    delay_s = np.concatenate([[0.0], np.cumsum(elapsed_s - gap_s)])  # after that of the first frame
    first_comparable = 0  # frame after the last restart, across which delays cannot be compared
    for i in np.flatnonzero(np.abs(elapsed_s - gap_s) > threshold_s).tolist():
        begin = max(first_comparable, int(np.searchsorted(arrival_s, arrival_s[i] - _WINDOW_S)))
        end = int(np.searchsorted(arrival_s, arrival_s[i + 1] + _WINDOW_S, "right"))
        shift_s = float(np.min(delay_s[i + 1 : end]) - np.min(delay_s[begin : i + 1]))
        if abs(shift_s) > threshold_s[i]:
            restarted[i] = True
            first_comparable = i + 1
    return restarted


def _fitted_times(
    sensor_time: NDArray[np.float64], arrival_s: NDArray[np.float64], unit_s: float
) -> NDArray[np.float64]:
    """Return the times of the samples of one part, s, (n,), on the line below the arrivals.

    Returns the arrivals of fewer than 20 samples, and of a clock that runs too far beside `unit_s`
    to be an oscillator of that cycle.  `sensor_time`: as in `_times_between_restarts`, increasing.
    """
    if len(sensor_time) < _FEWEST:
        return arrival_s
    from_middle = sensor_time - sensor_time.mean()
    origin_s = arrival_s[0]
    since_s = arrival_s - origin_s
    middle_s, rate = lower_line(from_middle, since_s, unit_s, NOMINAL_TOLERANCE)
    if abs(rate / unit_s - 1) > 0.999 * NOMINAL_TOLERANCE:  # else wider limits change nothing
        wide_middle_s, wide_rate = lower_line(from_middle, since_s, unit_s, LARGEST_TOLERANCE)
        if abs(wide_rate / unit_s - 1) > 0.999 * LARGEST_TOLERANCE:  # unit or cycle is stated wrong
            return arrival_s
        # Believed only if it halves the mean delay, which is this because `from_middle` has mean 0.
        if np.mean(since_s) - middle_s > 2 * (np.mean(since_s) - wide_middle_s):
            middle_s, rate = wide_middle_s, wide_rate
    return np.asarray(origin_s + middle_s + rate * from_middle)


def lower_line(
    k: NDArray[np.float64], y: NDArray[np.float64], cycle_s: float, tolerance: float
) -> tuple[float, float]:
    """Return the line below all points with the least mean distance from them.

    The mean distance is convex in the slope, and the best line is the edge of the lower convex hull
    above the mean of k.  It is found by cutting planes: one end of a chord between a point before
    and a point after the mean is replaced by the point furthest below the chord, until there is
    none below it.

    `k`, (n,) float64: abscissae with mean 0.  `y`, (n,) float64: ordinates.  The slope is kept
    within ``cycle_s (1 +- tolerance)``.  Returns start and slope of ``start + slope k``.
    """
    largest_slope, smallest_slope = cycle_s * (1 + tolerance), cycle_s * (1 - tolerance)
    before_mean = int(np.argmin(y - smallest_slope * k))
    after_mean = int(np.argmin(y - largest_slope * k))
    if k[before_mean] >= 0:
        return float(y[before_mean] - smallest_slope * k[before_mean]), smallest_slope
    if k[after_mean] <= 0:
        return float(y[after_mean] - largest_slope * k[after_mean]), largest_slope
    while True:
        slope = float((y[after_mean] - y[before_mean]) / (k[after_mean] - k[before_mean]))
        height = y - slope * k
        lowest = int(np.argmin(height))
        # Points on one line differ by rounding, and each would in turn be the lowest, without end.
        # Difference, s, below which two heights above a line count as equal.
        if height[lowest] >= min(height[before_mean], height[after_mean]) - 1e-12:
            return float(height[lowest]), slope
        if k[lowest] < 0:
            before_mean = lowest
        else:
            after_mean = lowest


def _increasing(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times, s, made strictly increasing, by steps of a nanosecond where necessary."""
    if np.all(np.diff(time_s) > 0):
        return time_s
    ns = np.arange(len(time_s)) * 1e-9
    return np.asarray(np.maximum.accumulate(time_s - ns) + ns)
