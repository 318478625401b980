"""Checks a bench: frames, DBC and bench.toml must agree, and the sensors must read correctly.

Pure: from the frames of a few seconds of rest to a report.  Each line is OK, WARN or FAIL with a
reason and, where possible, advice.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.frames import FrameBatch
from dbc.words import plural

from ..bench.bench_tables import SampleSet
from ..bench.config import Bench
from ..channels import sensor_of, sensor_of_signal
from ..runs import SampleGroup
from ..samples.groups import sample_groups, timekeeping
from ..samples.trigger import mapped_channels, trigger_channels
from ..vehicle import BodyWeight
from .bus_checks import check_traffic
from .channel_checks import check_channel
from .frame_checks import check_messages, frame_table
from .result import WORDS, about, judged, ok, open_questions, warn

_INCOMPLETE_SHARE = 0.01
_PAUSE_S, _PAUSE_INTERVALS = 0.1, 50.0
"""Time without any frame, s and in usual intervals of the whole traffic, that counts as a pause:
the bus was off, or the log was not written (an exported session has 0.6 s between runs)."""


@dataclass(frozen=True, slots=True)
class CheckReport:
    """The result of a bench check."""

    seconds: float
    """Time from the first frame to the last, s."""
    frames: int
    """Number of frames."""
    lines: tuple[Finding, ...]
    """Lines on buses, messages, sample sets and channels, in this order."""

    @property
    def verdict(self) -> Severity:
        """The worst of all lines."""
        return max((line.severity for line in self.lines), default=Severity.NOTE)

    @property
    def word(self) -> str:
        """OK, WARN or FAIL."""
        return WORDS[self.verdict]


def check_bench(bench: Bench, codec: Codec, frames: FrameBatch, today: date) -> CheckReport:
    """Check a bench at rest.

    `codec`: its DBC (`config.bench_codec`).  `frames`: a few seconds of traffic while the car
    stands still, in order of arrival.  If the traffic has pauses, only the longest stretch between
    pauses is checked.  `today`: for the age of calibrations.  Raises InputError if a channel does
    not fit the DBC.
    """
    mapped = mapped_channels(bench, codec)
    if not len(frames):
        advice = "check power, wiring, termination and the bit rate; sensors that must be started"
        line = Finding("no_frames", Severity.ERROR, "no frame was received", "bus", advice)
        return CheckReport(0.0, 0, (line,))
    frames, pauses = _without_pauses(frames)
    seconds = float(np.ptp(frames.t_ns)) * 1e-9
    decoded = codec.decode(frames)
    keeping = timekeeping(bench, codec)
    table = frame_table(codec.messages, frames)
    groups = sample_groups(mapped, decoded, keeping, int(frames.t_ns[0]))
    lines = pauses + check_traffic(codec.messages, table, decoded, bench.buses)
    lines += check_messages(mapped, keeping, table, decoded)
    by_name = {group.name: group for group in groups}
    for each in bench.sample_sets:
        if each.name in by_name:
            lines += _set_lines(each, by_name[each.name])
    if not trigger_channels(bench.channels, bench.procedure.method):
        advice = "add a hub_acceleration or a body_acceleration"
        reason = "no channel can trigger"
        lines.append(Finding("trigger", Severity.ERROR, reason, "trigger", advice))
    lines += open_questions(bench.text)
    lines += _exact_weights(bench)
    for m in mapped:
        lines += check_channel(m, keeping, decoded, bench.calibration_days, today)
    return CheckReport(seconds, len(frames), tuple(lines))


def part_of(
    report: CheckReport, bench: Bench, sensors: Collection[str], buses: Collection[int]
) -> CheckReport:
    """Return the lines of a report on some sensors and some buses; empty: all."""
    own = {s.name for s in bench.sensors if not buses or s.bus in buses}
    wanted = own & set(sensors) if sensors else own
    channels = {c.name for c in bench.channels if sensor_of_signal(c.signal) in wanted}
    labels = {bus.label for i, bus in enumerate(bench.buses) if not buses or i in buses}

    def is_wanted(line: Finding) -> bool:
        kind, _, name = line.subject.partition(" ")
        if kind == "message":
            return sensor_of(name) in wanted
        return name in channels if kind == "channel" else kind != "bus" or name in {*labels, ""}

    if not sensors and not buses:
        return report
    return replace(report, lines=tuple(filter(is_wanted, report.lines)))


def _exact_weights(bench: Bench) -> list[Finding]:
    """Return a note on weights that are stated without an uncertainty: nobody weighs exactly."""
    exact = [
        str(i)
        for state in bench.mass_states
        for i, weight in enumerate(state.added.weights, 1)
        if not weight.sigma_kg or (isinstance(weight, BodyWeight) and not weight.position_sigma_m)
    ]
    if not exact:
        return []
    text = f"{', '.join(exact)}: stated as exact (± 0 kg or ± 0 m)"
    advice = "state sigma_kg and position_sigma_m: nobody weighs or measures exactly"
    return about("weights", [judged("exact_weights", Severity.NOTE, text, advice)])


def _without_pauses(frames: FrameBatch) -> tuple[FrameBatch, list[Finding]]:
    """Return the longest stretch between pauses, because counters do not cover pauses."""
    gap_s = np.diff(frames.t_ns) * 1e-9
    if not len(gap_s):
        return frames, []
    before = np.flatnonzero(gap_s > max(_PAUSE_S, _PAUSE_INTERVALS * float(np.median(gap_s))))
    if not len(before):
        return frames, []
    first, last = np.append(0, before + 1), np.append(before, len(frames) - 1)
    length_s = (frames.t_ns[last] - frames.t_ns[first]) * 1e-9
    k = int(np.argmax(length_s))
    paused_s = float(gap_s[before].sum())
    many = "a pause" if len(before) == 1 else f"{len(before)} pauses"
    reason = (
        f"{many} without any frame, {paused_s:.1f} s in all; checked is the longest stretch "
        f"without one, {length_s[k]:.1f} s"
    )
    advice = "a log that a trigger wrote has them; on a live bus look for plug and power"
    figures = {"pauses": len(before), "paused_s": paused_s}
    lines = about("bus", [warn("pause", reason, advice)], figures)
    return frames.select(slice(int(first[k]), int(last[k]) + 1)), lines


def _set_lines(sample_set: SampleSet, group: SampleGroup) -> list[Finding]:
    subject = f"sample set {group.name}"
    n = len(group.time_s)
    missing = int(np.sum(np.isnan(np.array(list(group.values.values()))).any(axis=0)))
    rate = (n - 1) / float(group.time_s[-1] - group.time_s[0]) if n > 1 else 0.0
    figures = {"samples": n, "incomplete": missing, "rate_hz": rate}
    if missing > _INCOMPLETE_SHARE * n + 2:  # the first and the last set may be incomplete
        verdict = Severity.ERROR if missing > n / 2 else Severity.WARNING
        reason = f"{missing} of {n} samples {plural(missing, 'lacks', 'lack')} a frame"
        advice = f"are {', '.join(sample_set.messages)} sent at one rate, in one burst?"
        return about(subject, [judged("sample_set", verdict, reason, advice)], figures)
    reason = f"{n} samples at {rate:.1f} Hz"
    return about(subject, [ok("sample_set", reason)], figures)
