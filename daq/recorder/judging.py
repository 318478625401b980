"""Keeps the samples of the last seconds, and judges a run at its end."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from operator import sub

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.frames import FrameBatch
from dbc.words import Finding, Severity

from ..bench.campaign import Step
from ..bench.config import Bench
from ..bench.sensors import timed_messages
from ..control.messages import Lane, Live
from ..runlog import RunLog
from ..runs import Losses, RunStatus
from ..samples.mapping import SampleBlock, Trace
from ..verdict.judge import judge
from ..verdict.motion import peak_left
from ..verdict.window import RunMeasure, RunWindow

# Keeps frames, samples and losses of the last seconds ---------------------------------------------

CHECK_S = 10.0
"""Age up to which frames are kept at least, s: the longest bench check."""
_SLACK_NS = 1_000_000_000
"""Time for which blocks are kept in addition, and by which the stamps of two buses may differ, ns;
if they go back further, a clock was set."""
BLOCKS_PER_S = 40
"""Largest number of blocks kept for each second, in case the stamps of a bus do not advance: usual
are ten."""


@dataclass(frozen=True, slots=True)
class _Block:
    first_ns: int
    last_ns: int
    """Earliest and latest stamp of its frames."""
    frames: FrameBatch
    samples: SampleBlock
    losses: Losses
    """All losses counted up to it."""


class Recent:
    """The blocks of the last `CHECK_S`, or `kept_s` if that is longer, in order of arrival."""

    def __init__(self, kept_s: float) -> None:
        self.kept_s = kept_s
        self._blocks = deque([_Block(0, 0, FrameBatch.empty(), {}, Losses())])

    def add(self, frames: FrameBatch, samples: SampleBlock, losses: Losses) -> None:
        """Add a block that has frames; drop blocks that are too old, or too many."""
        first_ns, last_ns = int(frames.t_ns.min()), int(frames.t_ns.max())
        block = _Block(first_ns, last_ns, frames, samples, losses)
        previous_ns, kept_s = self._blocks[-1].last_ns, max(self.kept_s, CHECK_S)
        if last_ns < previous_ns - _SLACK_NS:  # the clock was set back: all earlier blocks go
            oldest_ns = previous_ns + 1
        else:
            # Counted from the previous block, not from this one: the first block after a pause of
            # the bus may end a run from before the pause.
            oldest_ns = previous_ns - round(kept_s * 1e9) - _SLACK_NS
        while self._blocks and (
            self._blocks[0].last_ns < oldest_ns or len(self._blocks) >= BLOCKS_PER_S * kept_s
        ):
            self._blocks.popleft()
        self._blocks.append(block)

    def frames(self, seconds: float) -> FrameBatch:
        """Return the frames of the last seconds."""
        since_ns = self._blocks[-1].last_ns - round(seconds * 1e9)
        recent = [block.frames for block in self._blocks if block.last_ns >= since_ns]
        frames = FrameBatch.concatenate(recent)
        return frames.select(frames.t_ns >= since_ns)

    def samples(self, start_ns: int, stop_ns: int) -> SampleBlock:
        """Return the samples with start <= t < stop, by channel, in order of arrival."""
        pieces: dict[str, list[Trace]] = {}
        for block in self._blocks:
            if block.last_ns >= start_ns:
                for name, piece in block.samples.items():
                    pieces.setdefault(name, []).append(piece)
        samples: dict[str, Trace] = {}
        for name, columns in pieces.items():
            t_ns, value = (np.concatenate(parts) for parts in zip(*columns, strict=True))
            within = (t_ns >= start_ns) & (t_ns < stop_ns)
            samples[name] = (t_ns[within], value[within])
        return samples

    def losses(self, start_ns: int, stop_ns: int) -> Losses:
        """Return the losses in a span, extended to complete blocks.

        Losses of a pause of the bus, which the first block after it has, are not those of a run
        that ends in the pause.
        """
        before = [block for block in self._blocks if block.last_ns < start_ns]
        until = [block for block in self._blocks if block.first_ns < stop_ns]
        counted_before = (before[-1] if before else self._blocks[0]).losses
        counted_until = (until[-1] if until else self._blocks[0]).losses
        return Losses(*map(sub, astuple(counted_until), astuple(counted_before)))


# Judges the runs ----------------------------------------------------------------------------------

UNJUDGED: Sequence[Finding] = (
    Finding("unjudged", Severity.NOTE, "the recorder could not judge it"),
)
"""Findings of a run if the verdict itself fails: the run is accepted, not lost."""


class Judge:
    """Judges the runs of a bench.

    `recent`: the last seconds of the recording.  `measures`: those of earlier runs, by label; later
    ones are added.
    """

    def __init__(
        self, bench: Bench, codec: Codec, recent: Recent, measures: dict[str, RunMeasure]
    ) -> None:
        self._bench, self._recent, self._measures = bench, recent, measures
        self._timed = timed_messages(codec, bench.message_rules)
        self._saturated: dict[str, int] = {}  # when last saturated, ns, by channel

    def saw_saturated(self, t_ns: int, channels: Sequence[str]) -> None:
        """Note the channels that are at the end of their range."""
        self._saturated.update(dict.fromkeys(channels, t_ns))

    def verdict(self, step: Step, bump_ns: int, run_log: RunLog) -> tuple[Finding, ...]:
        """Judge the run of a step, and keep its measure for the comparison with later runs."""
        span = self._bench.trigger.window_ns(bump_ns)
        samples, lost = self._recent.samples(*span), self._recent.losses(*span)
        saturated = tuple(name for name, t_ns in self._saturated.items() if t_ns >= bump_ns)
        window = RunWindow(bump_ns, samples, lost, saturated=saturated, timed=self._timed)
        runs = run_log.of(step.mass_state, step.excitation)
        accepted, unlike = [], []
        for run in runs:
            failed = {finding.code for finding in run.findings if not finding.passed}
            if run.label not in self._measures:
                continue
            if run.status is RunStatus.ACCEPTED:
                accepted.append(self._measures[run.label])
            elif run.status is RunStatus.REJECTED and not run.by and failed == {"not_repeatable"}:
                unlike.append(self._measures[run.label])  # by the recorder, for this reason alone
        findings, self._measures[step.label] = judge(self._bench, step, window, accepted, unlike)
        return findings

    def peak_left(self, bump_ns: int, t_ns: int) -> float | None:
        """Return the ratio of the present motion to its peak; None while it cannot be measured."""
        start_ns, _ = self._bench.trigger.window_ns(bump_ns)
        samples = self._recent.samples(start_ns, t_ns + 1)
        return peak_left(self._bench.channels, bump_ns, samples, t_ns)


# Keeps the newest samples as an envelope: lowest and highest value by channel and bin -------------
#
# Terminals draw it.  The bins are a ring of data time; the recorder publishes each complete bin
# once.

BIN_S = 0.02
"""Width of a bin, s."""
LATE_S = 0.1
"""Time, s, after its end at which a bin counts as complete: buses do not deliver at the same
time."""
_BIN_NS = round(BIN_S * 1e9)
# Length of the ring, s: the longest time that is published at once, after a gap in time.
_BINS = round(10.0 / BIN_S)


class LiveRing:
    """The last seconds of some channels, as an envelope."""

    def __init__(self, channels: Sequence[str]) -> None:
        self._row = {name: row for row, name in enumerate(channels)}
        self._low = np.full((len(channels), _BINS), np.nan)
        self._high = self._low.copy()
        self._first = 0  # the ring holds nothing before this bin
        self._sent = 0  # bins before this one were published
        self._end = 0  # bins before this one are or were in the ring

    def add(self, block: SampleBlock) -> None:
        """Add a block of samples in order of arrival; values that are not finite are left out."""
        times = [t_ns for t_ns, _ in block.values() if len(t_ns)]
        if not times:
            return
        end = max(int(t_ns[-1]) for t_ns in times) // _BIN_NS + 1
        if self._end == 0 or abs(end - self._end) > _BINS:  # the first data, or a clock was set
            self._first = self._sent = self._end = min(int(t_ns[0]) for t_ns in times) // _BIN_NS
        if end > self._end:
            new = np.arange(max(self._end, end - _BINS), end) % _BINS
            self._low[:, new] = self._high[:, new] = np.nan
            self._end, self._first = end, max(self._first, end - _BINS)
        for name, (t_ns, value) in block.items():
            number = t_ns // _BIN_NS
            good = np.isfinite(value) & (number >= self._first) & (number < self._end)
            place, value = number[good] % _BINS, value[good]
            # A bin may begin in one block and end in the next, or occur twice if stamps go back.
            np.fmin.at(self._low[self._row[name]], place, value)
            np.fmax.at(self._high[self._row[name]], place, value)

    def fresh(self) -> Live | None:
        """Return the complete bins that were not published yet."""
        complete = self._end - math.ceil(LATE_S / BIN_S)
        if complete <= self._sent:
            return None
        first, self._sent = max(self._sent, self._first), complete
        columns = np.arange(first, complete) % _BINS
        low, high = self._low[:, columns], self._high[:, columns]
        lanes = (Lane(name, _plain(low[row]), _plain(high[row])) for name, row in self._row.items())
        return Live(first, BIN_S, tuple(lanes))


def _plain(values: NDArray[np.float64]) -> tuple[float | None, ...]:
    """Return numbers that JSON can represent, rounded to four digits: a terminal shows fewer."""
    return tuple([None if v != v else float(f"{v:.4g}") for v in values.tolist()])
