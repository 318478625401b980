"""Converts rolling counters, which wrap, to the number of frames sent.

A counter states the number of frames sent modulo its range; the time of arrival gives the number of
complete wraps.  A frame arrives when it was sent or later, and a stalled reader delivers a whole
backlog at one instant, so a single arrival proves little: a frame's sending time is limited by the
arrival of the frames that followed it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    if step.min() == step.max() == 1 and elapsed.max() <= modulus / 2:  # the usual case
        phase = latest - np.arange(len(latest))
        earliest = min(float(phase.min()), float(phase[0]) - late_s / cycle_s)
        whole = np.zeros(len(step), bool)
        return CounterSteps(step, whole, _kept_late(float(phase[-1]) - earliest, arrival, cycle_s))
    turns = np.maximum(np.rint((elapsed - step) / modulus), 0).astype(np.int64)
    paused = (step == 1) & (turns > 0) & (elapsed * cycle_s >= _SILENCE_S)
    step = step + modulus * turns
    late = _lateness(latest, step, late_s / cycle_s)
    restarted = paused | (step > elapsed + late[:-1] + _SLACK_FRAMES)
    if np.any(restarted):
        by_time = np.maximum(np.rint(elapsed), 1).astype(np.int64)
        step = np.where(restarted, by_time, step)
        late = _lateness(latest, step, late_s / cycle_s)
    return CounterSteps(step, restarted, _kept_late(float(late[-1]), arrival, cycle_s))


def _kept_late(late: float, arrival: NDArray[np.float64], cycle_s: float) -> float:
    forgotten = (1 - FASTEST) * float(arrival[-1])  # a sensor slower than nominal is not late
    return max(late - forgotten, 0.0) * cycle_s


def _lateness(
    arrival: NDArray[np.float64], step: NDArray[np.int64], late: float
) -> NDArray[np.float64]:
    phase = arrival - np.concatenate([[0], np.cumsum(step)])
    earliest = np.minimum(np.minimum.accumulate(phase), phase[0] - late)
    return np.asarray(phase - earliest)
