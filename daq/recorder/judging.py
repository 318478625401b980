"""Judges a run at its end from the samples of the last seconds."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from itertools import pairwise

import numpy as np

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.frames import FrameBatch

from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec
from ..bench.message_rules import timed_messages
from ..errors import printable
from ..journal.contents import RecordingInfo
from ..journal.folder import scan
from ..journal.reader import read_windows
from ..runlog.run_log import LoggedRun, LoggedStatus, RunLog, fold
from ..runs import Losses
from ..samples.mapping import Column, SampleBlock, mapped_block
from ..samples.trigger import mapped_channels
from ..verdict import RunMeasure, RunWindow, judge, peak_left

# Keeps frames, samples and losses of the last seconds for bench check and verdict -----------------

CHECK_S = 10.0
"""Age up to which raw frames are kept, s."""
MOST_BLOCKS = 20_000
"""Largest number of blocks kept, half an hour at ten per second, in case the stamps of a bus do not
advance and no block grows old."""
_SLACK_NS = 1_000_000_000
"""Time for which samples and losses are kept in addition to a run, ns."""
_MOST_BYTES = 64 << 20
"""Largest number of bytes of raw frames kept."""


class RecentFrames:
    """Raw frames of the last `CHECK_S`, of data time; at most `_MOST_BYTES`."""

    def __init__(self) -> None:
        self._batches: deque[tuple[int, FrameBatch]] = deque()
        self._bytes = 0

    def add(self, batch: FrameBatch) -> None:
        """Add a block, not empty."""
        latest_ns = int(batch.t_ns.max())
        self._batches.append((latest_ns, batch))
        self._bytes += _size(batch)
        horizon_ns = latest_ns - round(CHECK_S * 1e9)
        # A block of a later time (the clock was set back) is also dropped: it would never grow old.
        while self._batches[0][0] < horizon_ns or self._bytes > _MOST_BYTES:
            self._bytes -= _size(self._batches.popleft()[1])
            if not self._batches:
                break
        while self._batches and self._batches[0][0] > latest_ns + _SLACK_NS:
            self._bytes -= _size(self._batches.popleft()[1])

    def last(self, seconds: float) -> FrameBatch:
        """Return the frames of the last seconds."""
        if not self._batches:
            return FrameBatch.empty()
        since_ns = self._batches[-1][0] - round(seconds * 1e9)
        found = FrameBatch.concatenate([b for t_ns, b in self._batches if t_ns >= since_ns])
        return found.select(found.t_ns >= since_ns)


class RecentSamples:
    """Samples of all channels of the last `kept_s` + 1 s."""

    def __init__(self, kept_s: float) -> None:
        self._kept_ns = round(kept_s * 1e9) + _SLACK_NS
        self._blocks: deque[tuple[int, SampleBlock]] = deque(maxlen=MOST_BLOCKS)

    def add(self, t_ns: int, block: SampleBlock) -> None:
        """Add a block whose latest stamp is `t_ns`."""
        # The first block after a pause of the bus may end a run from before the pause: the previous
        # block decides which blocks are too old.
        last_ns = self._blocks[-1][0] if self._blocks else t_ns
        while self._blocks and (
            last_ns - self._blocks[0][0] > self._kept_ns or self._blocks[0][0] - t_ns > _SLACK_NS
        ):
            self._blocks.popleft()
        self._blocks.append((t_ns, block))

    def between(self, start_ns: int, stop_ns: int) -> SampleBlock:
        """Return the samples of a span, by channel, in order of arrival."""
        pieces: dict[str, list[Column]] = {}
        for latest_ns, block in self._blocks:
            if latest_ns >= start_ns:
                for name, piece in block.items():
                    pieces.setdefault(name, []).append(piece)
        found: dict[str, Column] = {}
        for name, parts in pieces.items():
            t_ns = np.concatenate([part[0] for part in parts])
            value = np.concatenate([part[1] for part in parts])
            within = (t_ns >= start_ns) & (t_ns < stop_ns)
            found[name] = (t_ns[within], value[within])
        return found


@dataclass(frozen=True, slots=True)
class _Counted:
    first_ns: int
    last_ns: int
    losses: Losses


class RecentLosses:
    """Losses counted up to each block of the last `kept_s` + 1 s."""

    def __init__(self, kept_s: float) -> None:
        self._kept_ns = round(kept_s * 1e9) + _SLACK_NS
        self._blocks = deque([_Counted(0, 0, Losses())], MOST_BLOCKS)

    def add(self, first_ns: int, last_ns: int, losses: Losses) -> None:
        """Add the losses counted up to a block, and its earliest and latest stamp."""
        before_ns = self._blocks[-1].last_ns  # as in `RecentSamples`, for a pause of the bus
        self._blocks.append(_Counted(first_ns, last_ns, losses))
        while len(self._blocks) > 1 and (
            before_ns - self._blocks[1].last_ns > self._kept_ns
            or self._blocks[1].last_ns - last_ns > _SLACK_NS
        ):
            self._blocks.popleft()

    def between(self, start_ns: int, stop_ns: int) -> Losses:
        """Return the losses in a span, extended to complete blocks.

        The first block after a pause of the bus has all losses of the pause: the span gets the
        share of these losses that corresponds to its share of the pause.
        """
        blocks = list(self._blocks)
        earlier = [k for k, block in enumerate(blocks) if block.last_ns < start_ns]
        within = blocks[earlier[-1] if earlier else 0 :]
        total = np.zeros(len(fields(Losses)))
        for before, block in pairwise(within):
            share = 1.0
            if block.first_ns >= stop_ns:
                pause_ns = max(block.first_ns - before.last_ns, 1)
                share = max(stop_ns - before.last_ns, 0) / pause_ns
            total += share * np.subtract(astuple(block.losses), astuple(before.losses))
        return Losses(*np.rint(total).astype(int).tolist())


def _size(batch: FrameBatch) -> int:
    return batch.data.nbytes + 16 * len(batch)


# The judging --------------------------------------------------------------------------------------

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


# Measures the earlier runs of a resumed recording again, from its journal -------------------------
#
# Later runs are compared with them.  Reading may take seconds, during which the recorder must
# already record, so it is done in a separate thread.

PassOn = Callable[[Mapping[str, RunMeasure]], object]

_log = logging.getLogger("recorder")


def recall(tail: RecordingInfo, bench: Bench, pass_on: PassOn) -> threading.Thread:
    """Measure the runs in a separate thread, which passes on the result; never raises."""
    thread = threading.Thread(
        target=_recall, args=(tail, bench, pass_on), name="recall", daemon=True
    )
    thread.start()
    return thread


def _recall(tail: RecordingInfo, bench: Bench, pass_on: PassOn) -> None:
    try:
        pass_on(remeasured(tail, bench, bench_codec(bench)))
    except Exception as error:  # any exception: then later runs are not compared
        _log.warning("earlier runs cannot be measured again: %s", printable(str(error)))


def remeasured(tail: RecordingInfo, bench: Bench, codec: Codec) -> Mapping[str, RunMeasure]:
    """Return the measures of the runs with which later ones are compared, by label.

    Raises OSError or InputError if the journal cannot be read, or contradicts the bench.
    """
    runs = [run for run in fold(tail.events).runs if is_accepted(run) or is_only_unlike(run)]
    spans = [bench.trigger.window_ns(run.t_ns) for run in runs]
    summaries = [(path, info.summary) for path in tail.segments if (info := scan(path))]
    paths = [
        path
        for path, summary in summaries
        if any(summary.first_ns < stop and start <= summary.last_ns for start, stop in spans)
    ]
    if not paths:
        return {}
    mapped = mapped_channels(bench, codec)
    measures = {}
    for run, frames in zip(runs, read_windows(paths, spans)[1], strict=True):
        window = RunWindow(run.t_ns, mapped_block(mapped, codec.decode(frames)))
        step = Step(run.mass_state, run.excitation, run.repeat)
        measures[run.label] = judge(bench, step, window, ())[1]
    return measures
