"""Samples that are missing, mistimed, held or cut flat while the vehicle moves.

Every sample is fitted at its own time, so uneven sampling is legal and a lost frame costs no more
than its information.  The harmful faults are losing the wheels' motion, which is over in 0.2 s, a
channel that looks alive but is not, and peaks beyond the range of a sensor or its message.  On the
bump all of them are harmless: only the free decay is fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from daq.runs import Run
from daq.samples.converter import FROZEN_S, flat_tops
from daq.sessions import Session
from daq.silence import WHEEL_MOTION_S, longest_gap_s
from dbc.finding import Finding, Severity
from dbc.samples import Quality
from dbc.words import counted

from ..decays.decay import Record
from ..decays.onset import GUARD_S, decay_start_s
from ..decays.usable import frozen
from .finding import listed

LOST_SHARE = 0.1
"""Share of lost samples that must have a cause (bus load, a loose plug), which the bump itself may
trigger."""
JITTER_S = 1e-4
"""Scatter of time stamps, s, in which the acceleration of a wheel changes by about the noise of its
sensor."""
_MOSTLY = 0.5
"""Share of samples stamped on arrival above which no clock was found for their message."""
_EVEN = 0.12  # of the period; times without a clock scatter by 0.2 or more


def sample_findings(session: Session, records: Sequence[Record]) -> Iterator[Finding]:
    """Yield findings on the samples of the accepted runs.

    `session`: as recorded; rejected runs do not count.  `records`: those of its runs, as they are
    fitted.
    """
    runs = session.accepted
    starts_s = {record.label: decay_start_s(record) - GUARD_S for record in records}
    yield from _timing(runs, records)
    groups = [(f"{g.name} in {run.label}", g) for run in runs for g in run.groups]
    backwards = [place for place, g in groups if (np.diff(g.time_s) <= 0.0).any()]
    if backwards:
        yield _warning(
            "time_order",
            f"sample times do not increase: {listed(backwards)}; samples then have wrong times: "
            "sort them, remove doubles, or record again",
        )
    missing = [
        f"{c.name} in {run.label}"
        for c in session.used_channels
        for run in runs
        if not any(np.isfinite(g.values[c.name]).any() for g in run.groups if c.name in g.values)
    ]
    if missing:
        text = (
            f"channels without a sample: {listed(missing)}; these runs are fitted by the others: "
            "check sensor and plug"
        )
        yield Finding("missing_channels", Severity.NOTE, text)
    stuck = frozen(records)
    if stuck:
        yield _warning(
            "stuck_channels",
            f"holds one value for {stuck[0].longest.length_s:.2f} s (limit {FROZEN_S:g}) while the "
            f"vehicle moves: {listed(f'{hold.channel} in {hold.run}' for hold in stuck)}; these "
            "samples are not measured and bias the result: check the sensor and repeat the run",
        )
    lossy = [run for run in runs if run.losses.measured]
    if lossy:
        total = counted(sum(run.losses.measured for run in lossy), "frame")
        text = (
            f"the recorder counted {total} lost or unusable: "
            f"{listed(f'{run.losses.measured} in {run.label}' for run in lossy)}; they cost their "
            "information only, check bus load and wiring if there are many"
        )
        yield Finding("frame_losses", Severity.NOTE, text)
    tops = [
        (stop - first, f"{column[first]:.4g} {channel.unit}", f"{channel.name} in {record.label}")
        for record in records
        for r in record.recordings
        for channel, column in zip(r.group.channels, r.values.T, strict=True)
        for first, stop in flat_tops(column)
        if r.time_s[stop - 1] >= starts_s[record.label]
    ]
    tops.sort(key=lambda top: -top[0])
    if tops:
        yield _warning(
            "saturation",
            f"flat tops in the free decay, {tops[0][0]} equal samples at {tops[0][1]}, which is "
            f"not by chance: {listed(place for *_, place in tops)}; the sensor saturates and the "
            "true motion is larger: use a lower bump or a sensor with a wider range",
        )
    used = {c.name for c in session.used_channels}
    outside = [
        (int(flagged.sum()), f"{group.name} in {run.label}")
        for run in runs
        for group in run.groups
        if run.label in starts_s and used & set(group.values)
        for flagged in [(group.quality & Quality.OUT_OF_RANGE) != 0]
        if (group.time_s[flagged] >= starts_s[run.label]).any()
    ]
    if outside:
        yield _warning(
            "out_of_range",
            f"{counted(max(n for n, _ in outside), 'sample')} outside the range that the DBC "
            f"states, in the free decay: {listed(place for _, place in outside)}; a saturated "
            "sensor or a wrong DBC: check scale and range of the message, use a lower bump",
        )


def _warning(code: str, text: str) -> Finding:
    return Finding(code, Severity.WARNING, text)


class _Sampling(NamedTuple):
    """The sampling of one channel group during one free decay."""

    source: str
    """Message, or the channels without which samples are missing."""
    place: str
    """Source and run."""
    gap_s: float
    limit_s: float
    """Longest interval that reaches into the wheels' motion, and its limit."""
    jitter_s: float
    """Scatter of the time stamps about an even clock."""
    lost_share: float
    """Share of missing samples according to the intervals; 0 if these are uneven by nature."""
    arrival_sigma_s: float
    """Stated uncertainty of the lateness where the times are those of the frames' arrival; else
    infinite."""


def _samplings(runs: Iterable[Run], records: Sequence[Record]) -> list[_Sampling]:
    """Return the sampling of each recording with more than two samples."""
    run_of = {run.label: run for run in runs}
    periods: dict[tuple[str, ...], list[float]] = {}
    parts = []
    for record in records:
        run, start = run_of[record.label], decay_start_s(record)
        for recording in record.recordings:
            time = recording.time_s - start
            # The sample before the decay too: a gap may begin on the bump.
            time = time[max(int(np.searchsorted(time, 0.0)) - 1, 0) :]
            if len(time) > 2:
                names = tuple(channel.name for channel in recording.group.channels)
                periods.setdefault(names, []).append(float(np.median(np.diff(time))))
                parts.append((run, recording.group, names, time))
    result = []
    for run, channels, names, time in parts:
        group = next(g for g in run.groups if g.name == channels.name)
        lacking = [n for n in names if not np.isfinite(group.values[n]).all()]
        source = listed(lacking) if 0 < len(lacking) < len(names) else group.name
        arrival_s = (group.t_ns - run.t0_ns) * 1e-9
        by_arrival = len(run.frames) > 0 and np.mean(group.time_s == arrival_s) > _MOSTLY
        sigma_s = channels.delay_sigma_s if by_arrival else np.inf
        period_s = float(np.median(periods[names]))
        intervals_s = np.diff(time)
        steps = np.maximum(np.rint(intervals_s / period_s), 1.0)
        jitter_s = float(np.std(intervals_s - steps * period_s) / np.sqrt(2.0))
        lost = float(np.sum(steps - 1.0)) if jitter_s < _EVEN * period_s else 0.0
        sampling = _Sampling(
            source,
            f"{source} in {run.label}",
            float(intervals_s[time[:-1] < WHEEL_MOTION_S].max(initial=0.0)),
            longest_gap_s(period_s),
            jitter_s,
            lost / (lost + len(time)),
            sigma_s,
        )
        result.append(sampling)
    return result


def _timing(runs: Iterable[Run], records: Sequence[Record]) -> Iterator[Finding]:
    """Yield findings on gaps, lost samples and times of arrival."""
    samplings = _samplings(runs, records)
    bad = sorted((s for s in samplings if s.gap_s > s.limit_s), key=lambda s: -s.gap_s)
    if bad:
        yield _warning(
            "gaps",
            f"no sample for {bad[0].gap_s * 1e3:.0f} ms (limit {bad[0].limit_s * 1e3:.0f}) in the "
            f"first {WHEEL_MOTION_S:g} s after the bump: {listed(s.place for s in bad)}; the "
            "wheels' motion is over by then, so these runs say little of wheels and tyres: repeat "
            "them",
        )
    poor = sorted((s for s in samplings if s.lost_share > 0.0), key=lambda s: -s.lost_share)
    bad = [s for s in poor if s.lost_share > LOST_SHARE]
    if bad:
        yield _warning(
            "lost_samples",
            f"{bad[0].lost_share:.0%} of the samples are missing (limit {LOST_SHARE:.0%}): "
            f"{listed(s.place for s in bad)}; if they are lost when the vehicle moves most, the "
            "result is biased: check bus load, cable and plugs and repeat these runs",
        )
    elif poor:
        text = (
            f"up to {100 * poor[0].lost_share:.2g}% of the samples are missing (limit "
            f"{LOST_SHARE:.0%}): {listed(s.place for s in poor)}; they cost their information and "
            "nothing else"
        )
        yield Finding("lost_samples", Severity.NOTE, text)
    late = [s for s in samplings if s.jitter_s > max(JITTER_S, s.arrival_sigma_s)]
    if late:
        worst_s = max(s.jitter_s for s in late)
        yield _warning(
            "arrival_times",
            f"the samples of {listed(s.source for s in late)} have the times at which their frames "
            f"arrived, and these scatter by {worst_s * 1e3:.2f} ms, more than is stated of their "
            "lateness: the true times are not known; give the message a rolling counter or a time "
            "stamp, or state delay_sigma_s",
        )
