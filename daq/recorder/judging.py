"""Judges a run at its end from the samples of the last seconds."""

from __future__ import annotations

from collections.abc import Sequence

from dbc import Codec
from dbc.finding import Finding, Severity

from ..bench.campaign import Step
from ..bench.config import Bench
from ..bench.message_rules import timed_messages
from ..runlog.runlog import LoggedRun, LoggedStatus, RunLog
from ..runs import Losses
from ..samples.blocks import SampleBlock
from ..verdict import RunMeasure, RunWindow, judge, peak_left
from .recent import RecentLosses, RecentSamples

UNJUDGED: Sequence[Finding] = (
    Finding("unjudged", Severity.NOTE, "the recorder could not judge it"),
)
"""Findings of a run if the verdict itself fails: the run is accepted, not lost."""
LOOK_NS = 300_000_000
"""Time between two computations of the remaining motion, ns."""


def is_accepted(run: LoggedRun) -> bool:
    """Return True if later runs are compared with this run."""
    return run.status is LoggedStatus.ACCEPTED


def is_only_unlike(run: LoggedRun) -> bool:
    """Return True if the recorder rejected a run only as unlike the accepted ones."""
    failed = {finding.code for finding in run.findings if not finding.passed}
    return run.status is LoggedStatus.REJECTED and not run.by and failed == {"not_repeatable"}


class Judge:
    """Keeps the data for a verdict, and judges a run that has ended.

    `measures`: measures of the earlier runs; later ones are added.
    """

    def __init__(self, bench: Bench, codec: Codec, measures: dict[str, RunMeasure]) -> None:
        self._bench = bench
        self._measures = measures
        self._timed = timed_messages(codec, bench.message_rules)
        self._samples = RecentSamples(bench.trigger.pre_s + bench.trigger.post_s)
        self._saturated: dict[str, int] = {}
        self._left: tuple[int, int, float | None] = (0, 0, None)
        self._losses = RecentLosses(bench.trigger.pre_s + bench.trigger.post_s)

    def add(self, first_ns: int, last_ns: int, block: SampleBlock, losses: Losses) -> None:
        """Add a block, its earliest and latest stamp, and the losses counted up to it."""
        self._samples.add(last_ns, block)
        self._losses.add(first_ns, last_ns, losses)

    def saw_saturated(self, t_ns: int, channels: Sequence[str]) -> None:
        """Note the channels that are at the end of their range."""
        self._saturated.update(dict.fromkeys(channels, t_ns))

    def verdict(self, step: Step, bump_ns: int, run_log: RunLog) -> tuple[Finding, ...]:
        """Judge the run of a step."""
        start_ns, stop_ns = self._bench.trigger.window_ns(bump_ns)
        lost = self._losses.between(start_ns, stop_ns)
        samples = self._samples.between(start_ns, stop_ns)
        saturated = tuple(name for name, t_ns in self._saturated.items() if t_ns >= bump_ns)
        window = RunWindow(bump_ns, samples, lost, (), saturated, self._timed)
        kind = run_log.of(step.mass_state, step.excitation)
        known = [run for run in kind if run.label in self._measures]
        accepted, unlike = (
            [self._measures[run.label] for run in known if chosen(run)]
            for chosen in (is_accepted, is_only_unlike)
        )
        findings, self._measures[step.label] = judge(self._bench, step, window, accepted, unlike)
        return findings

    def peak_left(self, bump_ns: int, t_ns: int) -> float | None:
        """Return the ratio of the present motion to its peak; None while it cannot be measured."""
        before_bump_ns, seen_ns, left = self._left
        if before_bump_ns == bump_ns and 0 <= t_ns - seen_ns < LOOK_NS:
            return left
        start_ns, _ = self._bench.trigger.window_ns(bump_ns)
        columns = dict(self._samples.between(start_ns, t_ns + 1))
        left = peak_left(self._bench.channels, bump_ns, columns, t_ns)
        self._left = (bump_ns, t_ns, left)
        return left
