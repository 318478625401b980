"""Samples that are missing, mistimed, held or cut flat while the vehicle moves.

Every sample is fitted at its own time, so uneven sampling is legal and a lost frame costs no more
than its information.  The harmful faults are losing the wheels' motion, which is over in 0.2 s, a
channel that looks alive but is not, and peaks beyond the range of a sensor or its message.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daq.median import median
from daq.runs import Run, SampleGroup
from daq.samples.converter import flat_tops
from daq.samples.hold import FROZEN_S
from daq.sessions import Session
from daq.silence import WHEEL_MOTION_S, longest_gap_s
from dbc.finding import Finding, Severity
from dbc.samples import Quality
from dbc.words import counted

from ..decays.decay import Record, Recording
from ..decays.onset import GUARD_S, decay_start_s
from ..decays.stuck import frozen
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


def sampling_findings(session: Session, records: Sequence[Record]) -> tuple[Finding, ...]:
    """Judge the time stamps of the accepted runs.

    `session`: rejected runs do not count.  `records`: those of its runs, as they are fitted.
    """
    runs = session.accepted
    stretches = _stretches(runs, records)
    return (
        *_gaps(stretches),
        *_lost(stretches),
        *_jitter(stretches),
        *_order(runs),
        *_missing(runs, session),
        *_stuck(records),
        *_losses(runs),
    )


@dataclass(frozen=True, slots=True)
class _Stretch:
    """The sampling of one channel group during one free decay."""

    place: str
    """Message and run."""
    time_s: NDArray[np.float64]
    """Times of usable samples, from just before the decay, s since its start, shape (n,)."""
    period_s: float
    """The group's median interval over all runs."""
    arrival_sigma_s: float | None = None
    """Stated uncertainty of the lateness, s, where the times are those of the frames' arrival; else
    None."""

    @property
    def intervals_s(self) -> NDArray[np.float64]:
        return np.diff(self.time_s)

    @property
    def longest_early_s(self) -> float:
        """The longest interval that reaches into the wheels' motion."""
        early = self.intervals_s[self.time_s[:-1] < WHEEL_MOTION_S]
        return float(early.max(initial=0.0))

    @property
    def jitter_s(self) -> float:
        """Scatter of the time stamps about an even clock."""
        steps = np.maximum(np.rint(self.intervals_s / self.period_s), 1.0)
        return float(np.std(self.intervals_s - steps * self.period_s) / np.sqrt(2.0))

    @property
    def is_unsure(self) -> bool:
        """True if arrival times scatter more than the stated uncertainty of the lateness."""
        return self.arrival_sigma_s is not None and self.jitter_s > self.arrival_sigma_s

    @property
    def even(self) -> bool:
        """True if the samples are meant to come at equal intervals."""
        return self.jitter_s < _EVEN * self.period_s

    @property
    def lost_share(self) -> float:
        """Share of missing samples according to the intervals; 0 if these are uneven by nature."""
        if not self.even:
            return 0.0
        lost = float(np.sum(np.maximum(np.rint(self.intervals_s / self.period_s) - 1.0, 0.0)))
        return lost / (lost + len(self.time_s))


def _stretches(runs: Sequence[Run], records: Sequence[Record]) -> list[_Stretch]:
    found: list[tuple[str, tuple[str, ...], NDArray[np.float64], float | None]] = []
    run_of = {run.label: run for run in runs}
    for record in records:
        run, start = run_of[record.label], decay_start_s(record)
        by_arrival = {group.name for group in run.groups if _by_arrival(run, group)}
        for recording in record.recordings:
            time = recording.time_s - start
            # The sample before the decay too: a gap may begin on the bump.
            time = time[max(int(np.searchsorted(time, 0.0)) - 1, 0) :]
            if len(time) > 2:
                place = f"{_source(recording, run)} in {run.label}"
                sigma_s = recording.group.delay_sigma_s
                own = sigma_s if recording.group.name in by_arrival else None
                found.append((place, _names(recording), time, own))
    periods: dict[tuple[str, ...], list[float]] = {}
    for _, names, time, _ in found:
        periods.setdefault(names, []).append(median(np.diff(time)))
    return [_Stretch(place, t, median(periods[names]), own) for place, names, t, own in found]


def _by_arrival(run: Run, group: SampleGroup) -> bool:
    """Return whether a group from a bus has the times at which its frames arrived."""
    arrival_s = (group.t_ns - run.t0_ns) * 1e-9
    return len(run.frames) > 0 and bool(np.mean(group.time_s == arrival_s) > _MOSTLY)


def _source(recording: Recording, run: Run) -> str:
    """Return the channels without which rows of a group are missing, or the group's name."""
    group = next(g for g in run.groups if g.name == recording.group.name)
    names = _names(recording)
    lacking = [name for name in names if not np.isfinite(group.values[name]).all()]
    return listed(lacking) if 0 < len(lacking) < len(names) else group.name


def _names(recording: Recording) -> tuple[str, ...]:
    return tuple(channel.name for channel in recording.group.channels)


def _gaps(stretches: Sequence[_Stretch]) -> Iterator[Finding]:
    bad = [s for s in stretches if s.longest_early_s > longest_gap_s(s.period_s)]
    if not bad:
        return
    bad.sort(key=lambda s: -s.longest_early_s)
    worst = bad[0]
    limit = longest_gap_s(worst.period_s)
    yield Finding(
        "gaps",
        Severity.WARNING,
        f"no sample for {worst.longest_early_s * 1e3:.0f} ms (limit {limit * 1e3:.0f}) in the "
        f"first {WHEEL_MOTION_S:g} s after the bump: {listed(s.place for s in bad)}; the wheels' "
        "motion is over by then, so these runs say little of wheels and tyres: repeat them",
    )


def _lost(stretches: Sequence[_Stretch]) -> Iterator[Finding]:
    poor = sorted((s for s in stretches if s.lost_share > 0.0), key=lambda s: -s.lost_share)
    bad = [s for s in poor if s.lost_share > LOST_SHARE]
    if bad:
        yield Finding(
            "lost_samples",
            Severity.WARNING,
            f"{bad[0].lost_share:.0%} of the samples are missing (limit {LOST_SHARE:.0%}): "
            f"{listed(s.place for s in bad)}; if they are lost when the vehicle moves most, "
            "the result is biased: check bus load, cable and plugs and repeat these runs",
        )
    elif poor:
        yield Finding(
            "lost_samples",
            Severity.NOTE,
            f"up to {100 * poor[0].lost_share:.2g}% of the samples are missing (limit "
            f"{LOST_SHARE:.0%}): {listed(s.place for s in poor)}; they cost their information and "
            "nothing else",
        )


def _jitter(stretches: Sequence[_Stretch]) -> Iterator[Finding]:
    scattered = sorted((s for s in stretches if s.jitter_s > JITTER_S), key=lambda s: -s.jitter_s)
    late = [s for s in scattered if s.is_unsure]
    if late:
        yield Finding(
            "arrival_times",
            Severity.WARNING,
            f"the samples of {listed(s.place.split(' in ')[0] for s in late)} have the times at "
            f"which their frames arrived, and these scatter by {late[0].jitter_s * 1e3:.2f} ms, "
            "more than is stated of their lateness: the true times are not known; give the "
            "message a rolling counter or a time stamp, or state delay_sigma_s",
        )
    scattered = [s for s in scattered if not s.is_unsure]
    if scattered:
        worst = scattered[0]
        groups = listed(s.place.split(" in ")[0] for s in scattered)
        yield Finding(
            "jitter",
            Severity.NOTE,
            f"time stamps scatter by {worst.jitter_s * 1e3:.2f} ms about an even clock of "
            f"{worst.period_s * 1e3:.3g} ms: {groups}; right if the sensor samples so, for each "
            "sample is fitted at its own time; if only its frames are late, give the message a "
            "rolling counter",
        )


def _order(runs: Sequence[Run]) -> Iterator[Finding]:
    groups = [(f"{g.name} in {run.label}", g) for run in runs for g in run.groups]
    backwards = [place for place, g in groups if (np.diff(g.time_s) <= 0.0).any()]
    if backwards:
        yield Finding(
            "time_order",
            Severity.WARNING,
            f"sample times do not increase: {listed(backwards)}; samples then have wrong "
            "times: sort them, remove doubles, or record again",
        )
    swapped = [place for place, g in groups if (np.diff(g.t_ns) < 0).any()]
    if swapped:
        yield Finding(
            "time_order",
            Severity.NOTE,
            f"frames were stamped out of order on the bus: {listed(swapped)}; the times of the "
            "samples were put right, check the interface if it happens often",
        )


def _missing(runs: Sequence[Run], session: Session) -> Iterator[Finding]:
    used = [c.name for c in session.used_channels]
    present = {
        (name, run.label)
        for run in runs
        for group in run.groups
        for name, values in group.values.items()
        if np.isfinite(values).any()
    }
    missing = [f"{n} in {run.label}" for n in used for run in runs if (n, run.label) not in present]
    if missing:
        yield Finding(
            "missing_channels",
            Severity.NOTE,
            f"channels without a sample: {listed(missing)}; these runs are fitted by the others: "
            "check sensor and plug",
        )


def _losses(runs: Sequence[Run]) -> Iterator[Finding]:
    lossy = [run for run in runs if run.losses.measured]
    if lossy:
        total = sum(run.losses.measured for run in lossy)
        yield Finding(
            "frame_losses",
            Severity.NOTE,
            f"the recorder counted {counted(total, 'frame')} lost or unusable: "
            f"{listed(f'{run.losses.measured} in {run.label}' for run in lossy)}; they cost their "
            "information only, check bus load and wiring if there are many",
        )


def _stuck(records: Sequence[Record]) -> Iterator[Finding]:
    """Yield a finding on channels that do not move in the decays that are fitted."""
    found = frozen(records)
    if not found:
        return
    places = listed(f"{hold.channel} in {hold.run}" for hold in found)
    text = (
        f"holds one value for {found[0].longest.held_s:.2f} s (limit {FROZEN_S:g}) while the "
        f"vehicle moves: {places}; these samples are not measured and bias the result: check the "
        "sensor and repeat the run"
    )
    yield Finding("stuck_channels", Severity.WARNING, text)


@dataclass(frozen=True, slots=True)
class _Top:
    """A flat top: its place, number of samples, value, and whether it lies within the decay."""

    channel: str
    run: str
    samples: int
    value: float
    unit: str
    in_decay: bool


def saturation_findings(session: Session, records: Sequence[Record]) -> tuple[Finding, ...]:
    """Find flat tops and samples outside the range of their message.

    On the bump they are harmless, because only the free decay is fitted.

    `session`: as recorded; rejected runs do not count.  `records`: those of its runs, as they are
    fitted.
    """
    used = {c.name for c in session.used_channels}
    groups = {
        run.label: [group for group in run.groups if used & set(group.values)]
        for run in session.accepted
    }
    tops = [top for record in records for top in _tops(record)]
    outside = [one for record in records for one in _outside(record, groups[record.label])]
    return (*_flat(tops), *_out_of_range(outside))


def _flat(tops: list[_Top]) -> Iterator[Finding]:
    decay = sorted((top for top in tops if top.in_decay), key=lambda top: -top.samples)
    if decay:
        worst = decay[0]
        yield Finding(
            "saturation",
            Severity.WARNING,
            f"flat tops in the free decay, {worst.samples} equal samples at {worst.value:.4g} "
            f"{worst.unit}, which is not by chance: {_places(decay)}; the sensor saturates and the "
            "true motion is larger: use a lower bump or a sensor with a wider range",
        )
    elif tops:
        worst = max(tops, key=lambda top: top.samples)
        yield Finding(
            "saturation",
            Severity.NOTE,
            f"flat tops on the bump only, {worst.samples} equal samples at {worst.value:.4g} "
            f"{worst.unit}: {_places(tops)}; harmless, for only the decay after it is fitted",
        )


def _places(tops: list[_Top]) -> str:
    return listed(f"{top.channel} in {top.run}" for top in tops)


def _tops(record: Record) -> Iterator[_Top]:
    start = decay_start_s(record) - GUARD_S
    for recording in record.recordings:
        for channel, column in zip(recording.group.channels, recording.values.T, strict=True):
            for first, stop in flat_tops(column):
                yield _Top(
                    channel.name,
                    record.label,
                    stop - first,
                    float(column[first]),
                    channel.unit,
                    bool(recording.time_s[stop - 1] >= start),
                )


def _outside(record: Record, groups: Sequence[SampleGroup]) -> Iterator[tuple[str, int, bool]]:
    """Return message and run, samples out of range, and whether any is within the decay."""
    start = decay_start_s(record) - GUARD_S
    for group in groups:
        flagged = (group.quality & Quality.OUT_OF_RANGE) != 0
        if flagged.any():
            in_decay = bool((group.time_s[flagged] >= start).any())
            yield f"{group.name} in {record.label}", int(flagged.sum()), in_decay


def _out_of_range(outside: list[tuple[str, int, bool]]) -> Iterator[Finding]:
    decay = [(place, n) for place, n, in_decay in outside if in_decay]
    if decay:
        yield Finding(
            "out_of_range",
            Severity.WARNING,
            f"{counted(max(n for _, n in decay), 'sample')} outside the range that the DBC states, "
            f"in the free decay: {listed(place for place, _ in decay)}; a saturated sensor or a "
            "wrong DBC: check scale and range of the message, use a lower bump",
        )
    elif outside:
        yield Finding(
            "out_of_range",
            Severity.NOTE,
            f"{counted(max(n for _, n, _ in outside), 'sample')} outside the range that the DBC "
            f"states, on the bump only: {listed(place for place, _, _ in outside)}; harmless, for "
            "only the decay after it is fitted",
        )
