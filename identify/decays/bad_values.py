"""Takes values that no motion shows out of a session: absurd ones, and spikes.

An absurd value comes of a wrong byte order or scale, or a defect: its square overflows, and one of
them outweighs all others in a fit.  A spike stands out from the samples on both sides, and motion
lasts many samples: a frame of zeros after a restart, a bit that flipped.  A single one at rest
moves the onset that is seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daq.channels import LARGEST
from daq.runs import Run
from daq.sessions import Session

_Array = NDArray[np.float64]
_SMALLEST = 1e-100
"""Smallest magnitude that is not taken as zero: the squares of smaller ones vanish."""
_ROUNDING = 1e-12
"""Magnitude, SI, below which a channel shows only a simulation's rounding: it is taken as zero."""
_LONGEST = 3
"""Most samples of a spike."""
_STEEP = 12.0
"""Least height in units of the usual change from one sample to the next, which is about the noise:
a lower spike hardly matters in a fit."""
_STEPS = 6.0
"""Least height in steps of the converter: one at rest changes by one or two."""
_CURVED = 6.0
"""Least height in units of the curvature on either side.  Peaks of motion that is sampled at 20 Hz
or more do not reach it, neither those of wheels that strike the bump; of 4, some do."""
_NEAR_S = 0.05
_NEAR_SAMPLES = 12
"""Length of a side: the longer of the two."""
_OTHERS = 10
"""One in so many samples of a side may belong to other spikes."""
_MOST = 0.01
"""Share of the samples above which spikes belong to the signal."""
_GAP = 1.5
"""Ratio of the time between the neighbours of a spike to the usual one above which samples are
missing there: then the motion went on meanwhile."""


@dataclass(frozen=True, slots=True)
class BadValue:
    """Values of one channel in one run that no motion shows."""

    channel: str
    run: str
    """`channel`, `run`: name and label."""
    time_s: float
    """Time of the first of them since the run's t0, s."""
    value: float
    """Its value, SI."""
    count: int = 1
    """Number of these values."""


def without_bad_values(
    session: Session,
) -> tuple[Session, tuple[BadValue, ...], tuple[BadValue, ...]]:
    """Return a session whose accepted runs miss (NaN) bad values, the absurd ones, and the spikes.

    Absurd are those above `LARGEST`, infinite ones too; tiny ones become 0.
    """
    used = {c.name for c in session.used_channels}
    absurd: list[BadValue] = []
    spiked: list[BadValue] = []

    def cleaned(run: Run, name: str, time_s: _Array, values: _Array) -> _Array:
        """Return the values of one channel; the same array if none of them is bad or tiny."""
        too_large = np.abs(values) > LARGEST  # false for NaN
        moves = bool(np.fmax.reduce(np.abs(values), initial=0.0) > _ROUNDING)
        tiny = (np.abs(values) < (_SMALLEST if moves else _ROUNDING)) & (values != 0.0)
        if too_large.any():
            first = int(np.argmax(too_large))
            count = int(np.count_nonzero(too_large))
            one = BadValue(name, run.label, float(time_s[first]), float(values[first]), count)
            absurd.append(one)
        if too_large.any() or tiny.any():
            values = np.where(too_large, np.nan, np.where(tiny, 0.0, values))
        finite = np.flatnonzero(np.isfinite(values))
        for spike in spikes(time_s[finite], values[finite]):
            first = int(finite[spike][0])
            spiked.append(BadValue(name, run.label, float(time_s[first]), float(values[first])))
            values = values.copy()
            values[finite[spike]] = np.nan
        return values

    runs = []
    for run in session.runs:
        if not run.is_accepted:
            runs.append(run)
            continue
        groups = []
        for group in run.groups:
            values = {
                name: cleaned(run, name, group.time_s, column) if name in used else column
                for name, column in group.values.items()
            }
            unchanged = all(values[name] is column for name, column in group.values.items())
            groups.append(group if unchanged else replace(group, values=values))
        unchanged = all(new is old for new, old in zip(groups, run.groups, strict=True))
        runs.append(run if unchanged else replace(run, groups=tuple(groups)))
    return replace(session, runs=tuple(runs)), tuple(absurd), tuple(spiked)


def spikes(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> list[slice]:
    """Return the samples of each spike, none if there are too many to be errors.

    `time_s`, `values`: times and values of one channel, (n,) float64, finite.
    """
    if len(values) < 2 * _NEAR_SAMPLES:
        return []
    change = np.abs(np.diff(values))
    usual_change = float(np.partition(change, len(change) // 2)[len(change) // 2])  # the median
    least = _STEEP * usual_change
    first = np.flatnonzero(change > least) + 1  # samples at which a spike may begin
    if not len(first):
        return []
    converter_step = float(change[change > 0.0].min())
    least = max(least, _STEPS * converter_step)
    if change[0] > least:
        first = np.concatenate([[0], first])
    # Beyond its ends a record goes on as it went.
    ends = [3.0 * values[i] - 2.0 * values[j] for i, j in ((1, 2), (-2, -3))]
    padded = np.concatenate([ends[:1], values, ends[1:]])
    found: list[slice] = []
    for samples in range(_LONGEST, 0, -1):
        begin = first[first + samples <= len(values)]
        inside = values[begin[:, None] + np.arange(samples)]
        sides = padded[begin[:, None] + [0, samples + 1]]
        above = inside.min(axis=1) - sides.max(axis=1)
        height = np.maximum(above, sides.min(axis=1) - inside.max(axis=1))
        for b, h in zip(begin[height > least].tolist(), height[height > least], strict=True):
            one = slice(b, b + samples)
            if any(one.start < other.stop and other.start < one.stop for other in found):
                continue
            if _is_whole(time_s, one) and h > _CURVED * _curvature(time_s, values, one):
                found.append(one)
    # A spike beside an end misleads about how the record went on there.
    starts, stops = {one.start for one in found}, {one.stop for one in found}
    found = [
        one
        for one in found
        if not (one.start == 0 and one.stop in starts)
        and not (one.stop == len(values) and one.start in stops)
    ]
    most = max(_LONGEST, _MOST * len(values))
    return found if sum(one.stop - one.start for one in found) <= most else []


def _curvature(time_s: NDArray[np.float64], values: NDArray[np.float64], spike: slice) -> float:
    """Return the larger curvature of the two sides, over the length of the spike."""
    width = spike.stop - spike.start + 1
    begin, end = np.searchsorted(
        time_s, time_s[[spike.start, spike.stop - 1]] + [-_NEAR_S, _NEAR_S]
    )
    sides = (
        values[max(min(int(begin), spike.start - _NEAR_SAMPLES), 0) : spike.start],
        values[spike.stop : max(int(end), spike.stop + _NEAR_SAMPLES)],
    )
    curved = [0.0]
    for side in sides:
        bend = np.abs(side[width:-width] - (side[: -2 * width] + side[2 * width :]) / 2.0)
        if len(bend):
            curved.append(float(np.sort(bend)[-1 - len(bend) // _OTHERS]))
    return max(curved)


def _is_whole(time_s: NDArray[np.float64], spike: slice) -> bool:
    """Return True if no samples are missing between a spike and its neighbours."""
    before, after = max(spike.start - 1, 0), min(spike.stop, len(time_s) - 1)
    period_s = np.median(np.diff(time_s))
    return bool(time_s[after] - time_s[before] <= _GAP * (after - before) * period_s)
