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

from ..bench.config import Bench
from ..bench.message_rules import SampleSet
from ..channels import sensor_of, sensor_of_signal
from ..runs import SampleGroup
from ..samples.groups import sample_groups, timekeeping
from ..samples.trigger import mapped_channels, trigger_channels
from .channel_checks import check_channel
from .frame_checks import FAIL, OK, WARN, check_buses, check_messages, frame_table
from .questions import open_questions

WORDS = {OK: "OK", WARN: "WARN", FAIL: "FAIL"}
"""Words for the severities, printed and sent to the terminal."""
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
        return max((line.severity for line in self.lines), default=OK)


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
        line = Finding("no_frames", FAIL, "no frame was received", "bus", advice)
        return CheckReport(0.0, 0, (line,))
    frames, lines = _without_pauses(frames)
    decoded = codec.decode(frames)
    keeping = timekeeping(bench, codec)
    table = frame_table(codec.messages, frames)
    lines += check_buses(codec.messages, table, decoded.counts.error_frames, bench.buses)
    lines += check_messages(mapped, keeping, table, decoded)
    groups = {g.name: g for g in sample_groups(mapped, decoded, keeping, int(frames.t_ns[0]))}
    lines += [_set_line(s, groups[s.name]) for s in bench.sample_sets if s.name in groups]
    if not trigger_channels(bench.channels, bench.campaign.method):
        advice = "add a hub_acceleration or a body_acceleration"
        lines.append(Finding("trigger", FAIL, "no channel can trigger", "trigger", advice))
    lines += open_questions(bench.text, "bench.toml")
    for each in mapped:
        lines += check_channel(each, keeping.messages, decoded, bench.calibration_days, today)
    return CheckReport(table.seconds, len(frames), tuple(lines))


def part_of(
    report: CheckReport, bench: Bench, sensors: Collection[str], buses: Collection[int]
) -> CheckReport:
    """Return the lines of a report on some sensors and some buses; empty: all."""
    if not sensors and not buses:
        return report
    wanted = {
        s.name
        for s in bench.sensors
        if (not buses or s.bus in buses) and (not sensors or s.name in sensors)
    }
    channels = {c.name for c in bench.channels if sensor_of_signal(c.signal) in wanted}
    labels = {bus.label for i, bus in enumerate(bench.buses) if not buses or i in buses}

    def is_wanted(line: Finding) -> bool:
        kind, _, name = line.subject.partition(" ")
        if kind == "message":
            return sensor_of(name) in wanted
        return name in channels if kind == "channel" else kind != "bus" or name in {*labels, ""}

    return replace(report, lines=tuple(filter(is_wanted, report.lines)))


def _without_pauses(frames: FrameBatch) -> tuple[FrameBatch, list[Finding]]:
    """Return the longest stretch between pauses, because counters do not cover pauses."""
    gap_s = np.diff(frames.t_ns) * 1e-9
    usual_s = float(np.median(gap_s)) if len(gap_s) else 0.0
    before = np.flatnonzero(gap_s > max(_PAUSE_S, _PAUSE_INTERVALS * usual_s))
    if not len(before):
        return frames, []
    first, last = np.append(0, before + 1), np.append(before, len(frames) - 1)
    length_s = (frames.t_ns[last] - frames.t_ns[first]) * 1e-9
    k = int(np.argmax(length_s))
    paused_s = float(gap_s[before].sum())
    many = "a pause" if len(before) == 1 else f"{len(before)} pauses"
    text = (
        f"{many} without any frame, {paused_s:.1f} s in all; checked is the longest stretch "
        f"without one, {length_s[k]:.1f} s"
    )
    advice = "a log that a trigger wrote has them; on a live bus look for plug and power"
    figures = {"pauses": len(before), "paused_s": paused_s}
    line = Finding("pause", WARN, text, "bus", advice, figures=figures)
    return frames.select(slice(int(first[k]), int(last[k]) + 1)), [line]


def _set_line(sample_set: SampleSet, group: SampleGroup) -> Finding:
    n = len(group.time_s)
    missing = int(np.sum(np.isnan(np.array(list(group.values.values()))).any(axis=0)))
    rate_hz = (n - 1) / float(group.time_s[-1] - group.time_s[0]) if n > 1 else 0.0
    verdict, text, advice = OK, f"{n} samples at {rate_hz:.1f} Hz", ""
    if missing > _INCOMPLETE_SHARE * n + 2:  # the first and the last set may be incomplete
        verdict = FAIL if missing > n / 2 else WARN
        text = f"{missing} of {n} samples {plural(missing, 'lacks', 'lack')} a frame"
        advice = f"are {', '.join(sample_set.messages)} sent at one rate, in one burst?"
    figures = {"samples": n, "incomplete": missing, "rate_hz": rate_hz}
    subject = f"sample set {group.name}"
    return Finding("sample_set", verdict, text, subject, advice, figures=figures)
