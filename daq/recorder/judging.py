"""The verdict on a run at its end, from the samples of the last seconds."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import fields

from dbc import Codec

from ..bench.campaign import Step
from ..bench.config import Bench
from ..bench.message_rules import timed_messages
from ..runs import Losses
from ..verdict import RunMeasure, RunWindow, judge, peak_left
from .book import Book, BookStatus, Finding
from .recent import MOST_BLOCKS, Block, RecentSamples

UNJUDGED: Sequence[Finding] = (
    Finding("unjudged", True, "", 0.0, 0.0, "", "the recorder could not judge it", ""),
)
"""When the verdict fails: a bump is not thrown away for that."""
LOOK_NS = 300_000_000
"""The motion that is left is looked at so often."""
_SLACK_NS = 1_000_000_000


class Judge:
    """Keeps what a verdict takes; asked when a run has ended.

    Parameters
    ----------
    bench : Bench
        Channels, trigger and procedure.
    codec : Codec
        The bench's DBC.
    measures : dict of label to RunMeasure
        What was measured of the runs so far; later ones are added.
    """

    def __init__(self, bench: Bench, codec: Codec, measures: dict[str, RunMeasure]) -> None:
        self._bench = bench
        self._measures = measures
        self._timed = timed_messages(codec, bench.message_rules)
        self._samples = RecentSamples(bench.trigger.pre_s + bench.trigger.post_s)
        self._saturated: dict[str, int] = {}
        self._left: tuple[int, int, float | None] = (0, 0, None)
        self._losses: deque[tuple[int, Losses]] = deque([(0, Losses())], MOST_BLOCKS)

    def add(self, t_ns: int, block: Block, losses: Losses) -> None:
        """Take in a block whose latest stamp is `t_ns`, and the losses counted up to it."""
        self._samples.add(t_ns, block)
        self._losses.append((t_ns, losses))
        trigger = self._bench.trigger
        kept_ns = round((trigger.pre_s + trigger.post_s) * 1e9) + _SLACK_NS
        while len(self._losses) > 1 and not -_SLACK_NS <= t_ns - self._losses[1][0] <= kept_ns:
            self._losses.popleft()

    def saw_saturated(self, t_ns: int, channels: Sequence[str]) -> None:
        """Take in which channels are at the end of their range."""
        self._saturated.update(dict.fromkeys(channels, t_ns))

    def verdict(self, step: Step, bump_ns: int, book: Book) -> tuple[Finding, ...]:
        """Judge the run of a step."""
        start_ns = bump_ns - round(self._bench.trigger.pre_s * 1e9)
        stop_ns = bump_ns + round(self._bench.trigger.post_s * 1e9)
        before = next((lost for t_ns, lost in reversed(self._losses) if t_ns < start_ns), None)
        lost = _difference(self._losses[-1][1], before or self._losses[0][1])
        samples = self._samples.between(start_ns, stop_ns)
        saturated = tuple(name for name, t_ns in self._saturated.items() if t_ns >= bump_ns)
        window = RunWindow(bump_ns, samples, lost, (), saturated, self._timed)
        accepted = [
            self._measures[run.label]
            for run in book.of(step.mass_state, step.excitation)
            if run.status is BookStatus.ACCEPTED and run.label in self._measures
        ]
        findings, self._measures[step.label] = judge(self._bench, step, window, accepted)
        return findings

    def peak_left(self, bump_ns: int, t_ns: int) -> float | None:
        """Return the share of the motion that is left; None as long as it cannot be told."""
        before_bump_ns, seen_ns, left = self._left
        if before_bump_ns == bump_ns and 0 <= t_ns - seen_ns < LOOK_NS:
            return left
        start_ns = bump_ns - round(self._bench.trigger.pre_s * 1e9)
        columns = dict(self._samples.between(start_ns, t_ns + 1))
        left = peak_left(self._bench.channels, bump_ns, columns, t_ns)
        self._left = (bump_ns, t_ns, left)
        return left


def _difference(after: Losses, before: Losses) -> Losses:
    return Losses(*(getattr(after, f.name) - getattr(before, f.name) for f in fields(Losses)))
