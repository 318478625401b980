"""Samples that are missing, mistimed, held or cut flat while the vehicle moves.

Every sample is fitted at its own time, so uneven sampling is legal and a lost frame costs no more
than its information.  The harmful faults are losing the wheels' motion, which is over in 0.2 s, a
channel that looks alive but is not, and peaks beyond the range of a sensor or its message.  On the
bump all of them are harmless: only the free decay is fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.runs import Run, SampleGroup
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
    stretches = _stretches(runs, records)
    yield from _gaps(stretches)
    yield from _lost(stretches)
    yield from _by_arrival_times(stretches)
    groups = [(f"{g.name} in {run.label}", g) for run in runs for g in run.groups]
    backwards = [place for place, g in groups if (np.diff(g.time_s) <= 0.0).any()]
    if backwards:
        text = (
            f"sample times do not increase: {listed(backwards)}; samples then have wrong "
            "times: sort them, remove doubles, or record again"
        )
        yield Finding("time_order", Severity.WARNING, text)
    yield from _missing(runs, session)
    held = frozen(records)
    if held:
        places = listed(f"{hold.channel} in {hold.run}" for hold in held)
        text = (
            f"holds one value for {held[0].longest.length_s:.2f} s (limit {FROZEN_S:g}) while the "
            f"vehicle moves: {places}; these samples are not measured and bias the result: check "
            "the sensor and repeat the run"
        )
        yield Finding("stuck_channels", Severity.WARNING, text)
    yield from _losses(runs)
    yield from _flat(records)
    yield from _out_of_range(session, records)


@dataclass(frozen=True, slots=True)
class _Stretch:
    """The sampling of one channel group during one free decay."""

    source: str
    """Message, or the channels without which samples are missing."""
    run: str
    time_s: NDArray[np.float64]
    """Times of usable samples, from just before the decay, s since its start, shape (n,)."""
    period_s: float
    """The group's median interval over all runs."""
    arrival_sigma_s: float | None = None
    """Stated uncertainty of the lateness, s, where the times are those of the frames' arrival; else
    None."""

    @property
    def place(self) -> str:
        return f"{self.source} in {self.run}"

    @property
    def longest_early_s(self) -> float:
        """The longest interval that reaches into the wheels' motion."""
        early = np.diff(self.time_s)[self.time_s[:-1] < WHEEL_MOTION_S]
        return float(early.max(initial=0.0))

    @property
    def jitter_s(self) -> float:
        """Scatter of the time stamps about an even clock."""
        intervals_s = np.diff(self.time_s)
        steps = np.maximum(np.rint(intervals_s / self.period_s), 1.0)
        return float(np.std(intervals_s - steps * self.period_s) / np.sqrt(2.0))

    @property
    def lost_share(self) -> float:
        """Share of missing samples according to the intervals; 0 if these are uneven by nature."""
        if not self.jitter_s < _EVEN * self.period_s:
            return 0.0
        steps = np.rint(np.diff(self.time_s) / self.period_s)
        lost = float(np.sum(np.maximum(steps - 1.0, 0.0)))
        return lost / (lost + len(self.time_s))


def _stretches(runs: Sequence[Run], records: Sequence[Record]) -> list[_Stretch]:
    found: list[tuple[tuple[str, ...], _Stretch]] = []
    run_of = {run.label: run for run in runs}
    for record in records:
        run, start = run_of[record.label], decay_start_s(record)
        for recording in record.recordings:
            group = next(g for g in run.groups if g.name == recording.group.name)
            names = tuple(channel.name for channel in recording.group.channels)
            time = recording.time_s - start
            # The sample before the decay too: a gap may begin on the bump.
            time = time[max(int(np.searchsorted(time, 0.0)) - 1, 0) :]
            if len(time) > 2:
                lacking = [n for n in names if not np.isfinite(group.values[n]).all()]
                source = listed(lacking) if 0 < len(lacking) < len(names) else group.name
                sigma_s = recording.group.delay_sigma_s if _by_arrival(run, group) else None
                period_s = float(np.median(np.diff(time)))
                found.append((names, _Stretch(source, run.label, time, period_s, sigma_s)))
    periods: dict[tuple[str, ...], list[float]] = {}
    for names, one in found:
        periods.setdefault(names, []).append(one.period_s)
    return [
        _Stretch(
            one.source, one.run, one.time_s, float(np.median(periods[names])), one.arrival_sigma_s
        )
        for names, one in found
    ]


def _by_arrival(run: Run, group: SampleGroup) -> bool:
    """Return whether a group from a bus has the times at which its frames arrived."""
    arrival_s = (group.t_ns - run.t0_ns) * 1e-9
    return len(run.frames) > 0 and bool(np.mean(group.time_s == arrival_s) > _MOSTLY)


def _gaps(stretches: Sequence[_Stretch]) -> Iterator[Finding]:
    bad = [s for s in stretches if s.longest_early_s > longest_gap_s(s.period_s)]
    bad.sort(key=lambda s: -s.longest_early_s)
    if bad:
        text = (
            f"no sample for {bad[0].longest_early_s * 1e3:.0f} ms (limit "
            f"{longest_gap_s(bad[0].period_s) * 1e3:.0f}) in the first {WHEEL_MOTION_S:g} s after "
            f"the bump: {listed(s.place for s in bad)}; the wheels' motion is over by then, so "
            "these runs say little of wheels and tyres: repeat them"
        )
        yield Finding("gaps", Severity.WARNING, text)


def _lost(stretches: Sequence[_Stretch]) -> Iterator[Finding]:
    poor = sorted((s for s in stretches if s.lost_share > 0.0), key=lambda s: -s.lost_share)
    bad = [s for s in poor if s.lost_share > LOST_SHARE]
    if bad:
        text = (
            f"{bad[0].lost_share:.0%} of the samples are missing (limit {LOST_SHARE:.0%}): "
            f"{listed(s.place for s in bad)}; if they are lost when the vehicle moves most, "
            "the result is biased: check bus load, cable and plugs and repeat these runs"
        )
        yield Finding("lost_samples", Severity.WARNING, text)
    elif poor:
        text = (
            f"up to {100 * poor[0].lost_share:.2g}% of the samples are missing (limit "
            f"{LOST_SHARE:.0%}): {listed(s.place for s in poor)}; they cost their information and "
            "nothing else"
        )
        yield Finding("lost_samples", Severity.NOTE, text)


def _by_arrival_times(stretches: Sequence[_Stretch]) -> Iterator[Finding]:
    late = [
        s
        for s in stretches
        if s.arrival_sigma_s is not None and s.jitter_s > max(JITTER_S, s.arrival_sigma_s)
    ]
    if late:
        worst_s = max(s.jitter_s for s in late)
        text = (
            f"the samples of {listed(s.source for s in late)} have the times at which their "
            f"frames arrived, and these scatter by {worst_s * 1e3:.2f} ms, more than is stated of "
            "their lateness: the true times are not known; give the message a rolling counter or "
            "a time stamp, or state delay_sigma_s"
        )
        yield Finding("arrival_times", Severity.WARNING, text)


def _missing(runs: Sequence[Run], session: Session) -> Iterator[Finding]:
    present = {
        (name, run.label)
        for run in runs
        for group in run.groups
        for name, values in group.values.items()
        if np.isfinite(values).any()
    }
    wanted = [(c.name, run.label) for c in session.used_channels for run in runs]
    missing = [f"{name} in {label}" for name, label in wanted if (name, label) not in present]
    if missing:
        text = (
            f"channels without a sample: {listed(missing)}; these runs are fitted by the others: "
            "check sensor and plug"
        )
        yield Finding("missing_channels", Severity.NOTE, text)


def _losses(runs: Sequence[Run]) -> Iterator[Finding]:
    lossy = [run for run in runs if run.losses.measured]
    if lossy:
        total = sum(run.losses.measured for run in lossy)
        text = (
            f"the recorder counted {counted(total, 'frame')} lost or unusable: "
            f"{listed(f'{run.losses.measured} in {run.label}' for run in lossy)}; they cost their "
            "information only, check bus load and wiring if there are many"
        )
        yield Finding("frame_losses", Severity.NOTE, text)


def _flat(records: Sequence[Record]) -> Iterator[Finding]:
    """Yield a finding on peaks that are cut flat in the free decays."""
    tops: list[tuple[int, str, str]] = []
    for record in records:
        start_s = decay_start_s(record) - GUARD_S
        for r in record.recordings:
            for channel, column in zip(r.group.channels, r.values.T, strict=True):
                for first, stop in flat_tops(column):
                    if r.time_s[stop - 1] >= start_s:
                        value = f"{column[first]:.4g} {channel.unit}"
                        tops.append((stop - first, value, f"{channel.name} in {record.label}"))
    tops.sort(key=lambda top: -top[0])
    if tops:
        samples, value, _ = tops[0]
        text = (
            f"flat tops in the free decay, {samples} equal samples at {value}, which is not by "
            f"chance: {listed(place for *_, place in tops)}; the sensor saturates and the true "
            "motion is larger: use a lower bump or a sensor with a wider range"
        )
        yield Finding("saturation", Severity.WARNING, text)


def _out_of_range(session: Session, records: Sequence[Record]) -> Iterator[Finding]:
    """Yield a finding on samples outside the range of their message in the free decays."""
    used = {c.name for c in session.used_channels}
    starts_s = {record.label: decay_start_s(record) - GUARD_S for record in records}
    outside = [
        (int(flagged.sum()), f"{group.name} in {run.label}")
        for run in session.accepted
        if run.label in starts_s
        for group in run.groups
        if used & set(group.values)
        for flagged in [(group.quality & Quality.OUT_OF_RANGE) != 0]
        if (group.time_s[flagged] >= starts_s[run.label]).any()
    ]
    if outside:
        text = (
            f"{counted(max(n for n, _ in outside), 'sample')} outside the range that the DBC "
            f"states, in the free decay: {listed(place for _, place in outside)}; a saturated "
            "sensor or a wrong DBC: check scale and range of the message, use a lower bump"
        )
        yield Finding("out_of_range", Severity.WARNING, text)
