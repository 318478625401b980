"""Processes one recording: journal first, then decode, watch, find the bumps, judge them.

`Recording.store` writes one block to the journal; `Recording.look` does the other steps for all
blocks since the last look.  Both have no threads and no clock; `daq.recorder.recorder` calls them.
A failure after the journal loses no frame: the alarm `consumer_failed` reports it.
"""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from operator import sub
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dbc import Codec
from dbc.codec import Decoded
from dbc.frames import FrameBatch
from dbc.words import Finding, Severity, printable

from ..alarms.watch import Cycle, Watch
from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec
from ..bench.sensors import timed_messages
from ..bus.source import HopLosses, LinkFacts, Now
from ..control import messages
from ..control.messages import DiskStatus, Lane, Live, Order, Phase, Status, StorageStatus
from ..journal.writer import JournalWriter
from ..runlog import Change, RunLog, advance, parse_label, verdict_entry
from ..runs import Event, Losses, RunStatus
from ..samples import converter as health
from ..samples import trigger
from ..samples.mapping import SampleBlock, Trace, bench_mapping, mapped_block
from ..verdict.checks import remaining_ratio
from ..verdict.judge import judge
from ..verdict.window import RunMeasure, RunWindow
from ..verdict.words import finding
from .run_loop import OrderError, RunLoop, Surroundings, configured, due_of, order_event, tallies_of

_T = TypeVar("_T")


# Keeps frames, samples and losses of the last seconds ---------------------------------------------

CHECK_S = 10.0
"""Age up to which frames are kept at least, s: the longest bench check."""
_SLACK_NS = 1_000_000_000
"""Time for which blocks are kept in addition, and by which the stamps of two buses may differ, ns;
if they go back further, a clock was set."""
BLOCKS_PER_S = 40
"""Largest number of blocks kept for each second, if stamps do not advance: usual are ten."""


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
        if last_ns < previous_ns - _SLACK_NS:  # the clock was set back
            self._blocks.clear()
        # Counted from the previous block, not from this one: the first block after a pause of the
        # bus may end a run from before the pause.
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
        for name, traces in pieces.items():
            t_ns, value = (np.concatenate(columns) for columns in zip(*traces, strict=True))
            within = (t_ns >= start_ns) & (t_ns < stop_ns)
            samples[name] = (t_ns[within], value[within])
        return samples

    def losses(self, start_ns: int, stop_ns: int) -> Losses:
        """Return the losses in a span, extended to complete blocks.

        Losses of a pause of the bus, which the first block after it has, are not those of a run
        that ends in the pause.
        """
        before_start = [block for block in self._blocks if block.last_ns < start_ns]
        until_stop = [block for block in self._blocks if block.first_ns < stop_ns]
        counted_at_start = (before_start[-1] if before_start else self._blocks[0]).losses
        counted_at_stop = (until_stop[-1] if until_stop else self._blocks[0]).losses
        return Losses(*map(sub, astuple(counted_at_stop), astuple(counted_at_start)))


# Keeps the newest samples as an envelope: lowest and highest value by channel and bin -------------

BIN_S = 0.02
"""Width of a bin, s."""
LATE_BINS = 5
"""Number of the newest bins that may be incomplete: for 0.1 s a bus may deliver late."""
MOST_BINS = 500
"""Largest number of bins that are published at once: 10 s, after a gap."""
MOST_SAMPLES = 100_000
"""Largest number of samples of a channel that wait, if its time stamps do not advance."""


class LiveEnvelope:
    """The newest samples of some channels: lowest and highest value in each bin of data time.

    Each bin is published once, when it is complete.  Terminals draw them.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        nothing = np.zeros(0, np.int64), np.zeros(0)
        self._waiting: dict[str, Trace] = dict.fromkeys(channels, nothing)
        """Samples of the bins that are not published yet: number of the bin, and value."""
        self._next_bin = 0  # the bin after those published; 0 if there is none

    def add(self, block: SampleBlock) -> None:
        """Add a block of samples, in order of arrival."""
        for name, (t_ns, value) in block.items():
            bins, values = self._waiting[name]
            new_bins = t_ns // round(BIN_S * 1e9)
            bins, values = np.append(bins, new_bins), np.append(values, value)
            self._waiting[name] = bins[-MOST_SAMPLES:], values[-MOST_SAMPLES:]

    def fresh(self) -> Live | None:
        """Return the complete bins that were not published yet; None if there is none."""
        all_bins = [bins for bins, _ in self._waiting.values() if len(bins)]
        if not all_bins:
            return None
        newest_bin = max(int(bins[-1]) for bins in all_bins)
        if newest_bin < self._next_bin - MOST_BINS:  # the clock was set back: begin anew
            self._next_bin = 0
        oldest_bin = min(int(bins.min()) for bins in all_bins)
        stop_bin = newest_bin + 1 - LATE_BINS
        first_bin = max(self._next_bin or oldest_bin, stop_bin - MOST_BINS)
        if first_bin >= stop_bin:
            return None
        lanes = []
        for name, (bins, values) in self._waiting.items():
            low, high = np.full((2, stop_bin - first_bin), np.nan)  # a value for each bin
            is_complete = (bins >= first_bin) & (bins < stop_bin) & np.isfinite(values)
            np.fmin.at(low, bins[is_complete] - first_bin, values[is_complete])
            np.fmax.at(high, bins[is_complete] - first_bin, values[is_complete])
            lanes.append(Lane(name, _plain(low), _plain(high)))
            is_next = (bins >= stop_bin) & (bins <= newest_bin)
            self._waiting[name] = bins[is_next], values[is_next]
        self._next_bin = stop_bin
        return Live(first_bin, BIN_S, tuple(lanes))


def _plain(values: NDArray[np.float64]) -> tuple[float | None, ...]:
    """Return numbers that JSON can represent, rounded to four digits: a terminal shows fewer."""
    return tuple([None if v != v else float(f"{v:.4g}") for v in values.tolist()])


# The recording ------------------------------------------------------------------------------------


class FaultBarrier:
    """Runs the consumers of frames; a failure of one stops neither the others nor the recording."""

    def __init__(self) -> None:
        self._failed: dict[str, tuple[float, str]] = {}
        """Monotonic time, s, and reason of the last failure of each."""

    def value(self, name: str, now: Now, otherwise: _T, consumer: Callable[[], _T]) -> _T:
        """Return the result of a consumer, or `otherwise` if it fails."""
        try:
            return consumer()
        except Exception as error:  # any exception: the frames are stored, the recording continues
            self._failed[name] = (now.monotonic_s, printable(repr(error)))
            return otherwise

    def failed(self, now: Now) -> Mapping[str, str]:
        """Return the reasons of those that have failed within the last 5 s."""
        failures = self._failed.items()
        return {name: text for name, (time_s, text) in failures if now.monotonic_s - time_s < 5.0}


class Recording:
    """One recording: of a campaign, or of the traffic between two campaigns, when nothing is armed.

    Attributes: `recent`, its last seconds; `live`, the newest samples for terminals.
    `journal`: for frames and events; the caller closes it.  `run_log`: run log of a resumed
    recording.  Raises InputError if a channel contradicts the DBC, or no channel can trigger.
    """

    def __init__(
        self,
        bench: Bench,
        codec: Codec,
        journal: JournalWriter,
        run_log: RunLog | None = None,
        barrier: FaultBarrier | None = None,
    ) -> None:
        self._journal = journal
        self.run_log = run_log or RunLog()
        self.measures: dict[str, RunMeasure] = {}
        """Measures of the runs judged by this recorder, by label."""
        self._barrier = barrier or FaultBarrier()
        self._hops = self._looked_hops = HopLosses()  # until now, and until the last look
        self._unseen: list[FrameBatch] = []
        self._events: list[Event] = []  # since the last look
        self._loop = RunLoop()
        self._health = health.HealthState()
        self._t_ns = self._first_ns = 0  # of the latest frame, and of the first on its clock
        self._bump_ns = 0  # of the last planned bump
        self._saturated: dict[str, int] = {}  # count of each channel's alarm at the last look
        self.recent = Recent(bench.trigger.pre_s + bench.trigger.post_s)
        self._alarms = Watch(codec, ())
        self.adopt(bench, codec)

    def adopt(self, bench: Bench, codec: Codec) -> None:
        """Continue with another bench.toml, or begin with the first.

        Live envelope, trigger (which waits for rest anew) and the history behind the alarms
        begin anew.  Run log, measures, run loop, recent frames and the health of the counters stay.
        Raises InputError as the constructor; then nothing is changed.
        """
        self._mapped, self._triggers = bench_mapping(bench, codec)
        self.bench, self._codec = bench, codec
        self.live = LiveEnvelope([m.channel.name for m in self._mapped])
        self.recent.kept_s = bench.trigger.pre_s + bench.trigger.post_s
        self._timed = timed_messages(codec, bench.message_rules)
        self.saturated_ns: dict[str, int] = {}
        """When each channel was last at the end of its range, ns."""
        self._trigger = trigger.TriggerState()
        self._count_runs()
        self._alarms.adopt(codec, self._mapped)
        # The campaign may now be complete, because the new bench plans fewer runs or the recorder
        # was killed after the last run; or no longer complete, because the new bench plans more.
        self._loop.decide(self._surroundings())

    def _count_runs(self) -> None:
        """Count the runs of each kind, and find the next step of the campaign, if any."""
        self._tallies = tallies_of(self.bench, self.run_log)
        self._due = due_of(self.bench, self.run_log, self._tallies)

    @property
    def running(self) -> str:
        """Label of the run that is being recorded; empty if none is."""
        return self._loop.label if self._loop.running else ""

    @property
    def losses(self) -> Losses:
        """The losses until now, at all hops."""
        return health.losses_added(self._health.losses, self._hops.of_a_run)

    # Frames ------------------------------------------------------------------------------------

    def store(self, batch: FrameBatch, hops: HopLosses) -> None:
        """Store one block of frames, and keep it for the next look.

        `batch`: in order of arrival; may be empty.  `hops`: losses up to this block, since this
        recorder began or resumed the recording.  Raises JournalError if the journal does; the block
        is then not processed.
        """
        if len(batch) or hops != self._hops:
            self._journal.append(batch, hops)
        self._hops = hops
        if len(batch):
            self._t_ns = int(batch.t_ns[-1])
            self._first_ns = self._first_ns or int(batch.t_ns[0])
            self._unseen.append(batch)

    def look(
        self, now: Now, links: Sequence[LinkFacts], disk: DiskStatus, storage: StorageStatus
    ) -> tuple[Event, ...]:
        """Process all frames since the last call: decode, find bumps, judge runs, raise alarms.

        Also to be called without frames, for the alarms.  `links`, `disk`, `storage`: their present
        state.  Returns the events stored: `bump` and `run_end` have the label of their run.
        """
        batch, hops_before = FrameBatch.concatenate(self._unseen), self._looked_hops
        self._unseen, self._events, self._looked_hops = [], [], self._hops
        if self._hops.restamped and not hops_before.restamped:
            text = "time stamps of another epoch: frames are stamped on arrival"
            self._log(Event(self._t_ns, "restamped", self._hops.restamped, text))
        barrier, decoded = self._barrier, None
        if len(batch):
            decoded = barrier.value("decode", now, None, lambda: self._decode(batch))
        if decoded is not None:
            barrier.value("samples", now, None, lambda: self._find_bumps(batch, decoded, now))
        barrier.value("run loop", now, None, lambda: self._loop.turn(self._surroundings()))
        cycle = Cycle(
            now, batch, decoded, self._health, links, self._hops, disk, storage, barrier.failed(now)
        )
        barrier.value("alarms", now, None, lambda: self._raise_alarms(cycle))
        return tuple(self._events)

    def _decode(self, batch: FrameBatch) -> Decoded:
        """Return the signals in the frames; update the health of the sensors' counters."""
        decoded = self._codec.decode(batch)
        self._health = health.advance(self._codec.messages, self._health, decoded)
        return decoded

    def _find_bumps(self, batch: FrameBatch, decoded: Decoded, now: Now) -> None:
        """Keep the samples, and process the bumps and ends of runs that are found in them."""
        block = mapped_block(self._mapped, decoded)
        self.recent.add(batch, block, self.losses)
        self.live.add(block)
        triggers = {name: trace for name, trace in block.items() if name in self._triggers}
        self._trigger, events = trigger.advance(self.bench.trigger, self._trigger, triggers)
        for event in events:
            if event.code == trigger.BUMP:
                self._begin_run(event)
            elif event.code == trigger.RUN_END:
                self._judge_run(event, int(batch.t_ns[0]), now)
            else:
                self._log(event)
                if event.code == trigger.CLOCK_STEP:
                    self._first_ns = event.t_ns
                    self.cut("the time stamps went back")

    def _begin_run(self, event: Event) -> None:
        """Begin the run that is due with a bump; without an armed run it is only logged."""
        at_bump = replace(self._surroundings(), t_ns=event.t_ns, ready=self._pre_trigger_is_full)
        self._loop.turn(at_bump)
        if self._due is None or self._loop.phase is not Phase.ARMED:
            self._log(replace(event, code=trigger.UNPLANNED + event.code))
            return
        label = self._due.step.label
        self._log(replace(event, text=label))
        self._loop.bump(label, event.t_ns)
        self._bump_ns = event.t_ns

    def _judge_run(self, event: Event, block_start_ns: int, now: Now) -> None:
        """Judge the run whose end is seen in the block that begins at `block_start_ns`.

        The end of a bump that was no run is only logged.
        """
        label = self.running
        if not label:
            self._log(replace(event, code=trigger.UNPLANNED + event.code))
            return
        self._log(replace(event, text=label))
        step = parse_label(label)
        assert step is not None  # given by the recorder
        # A run is accepted, not lost, if the verdict itself fails.
        unjudged: tuple[Finding, ...] = (
            Finding("unjudged", Severity.NOTE, "the recorder could not judge it"),
        )
        findings = self._barrier.value(
            "verdict", now, unjudged, lambda: self.verdict(step, self._bump_ns)
        )
        self._log(verdict_entry(event.t_ns, label, findings))
        # The countdown begins when the end is seen: the bus may have paused after the end itself.
        seen_ns = max(event.t_ns, block_start_ns)
        self._loop.judge(replace(self._surroundings(), t_ns=seen_ns))

    def verdict(self, step: Step, bump_ns: int) -> tuple[Finding, ...]:
        """Judge the run of a step, and keep its measure for the comparison with later runs."""
        span_ns = self.bench.trigger.window_ns(bump_ns)
        samples, losses = self.recent.samples(*span_ns), self.recent.losses(*span_ns)
        saturated = tuple(name for name, t_ns in self.saturated_ns.items() if t_ns >= bump_ns)
        window = RunWindow(bump_ns, samples, losses, saturated=saturated, timed=self._timed)
        accepted = [
            self.measures[run.label]
            for run in self.run_log.of(step.mass_state, step.excitation)
            if run.status is RunStatus.ACCEPTED and run.label in self.measures
        ]
        findings, self.measures[step.label] = judge(self.bench, step, window, accepted)
        return findings

    def _decay_ratio(self) -> float | None:
        """Return the ratio of the present motion to its peak; None while it cannot be measured."""
        start_ns, _ = self.bench.trigger.window_ns(self._bump_ns)
        samples = self.recent.samples(start_ns, self._t_ns + 1)
        return remaining_ratio(self.bench.channels, self._bump_ns, samples, self._t_ns)

    def _raise_alarms(self, cycle: Cycle) -> None:
        """Log the alarms that begin and end; reject the present run if its bus is dead."""
        events = self._alarms.advance(self.bench.recorder, cycle)
        # An alarm lasts longer than its samples: those of this look have raised its count.
        saturated = {a.subject: a.count for a in self._alarms.alarms if a.code == "saturated"}
        raised = saturated.items() - self._saturated.items()
        self.saturated_ns |= {name: self._t_ns for name, _ in raised}
        self._saturated = saturated
        for event in events:
            self._log(event)
        dead = self._alarms.dead_bus
        if self.running and dead is not None:
            self._reject(finding("bus_lost", False, 0.0, 0.0, "", dead.text, dead.subject))

    def cut(self, why: str) -> None:
        """Reject the run that is being recorded, if any, because it cannot be finished."""
        if self.running:
            self._reject(Finding("cut", Severity.ERROR, f"cut: {why}", advice="bump again"))

    def _reject(self, reason: Finding) -> None:
        """End the run that is being recorded now, with the reason."""
        self._log(verdict_entry(self._t_ns, self.running, [reason]))
        self._loop.judge(self._surroundings())

    # Orders ------------------------------------------------------------------------------------

    def carry_out(self, order: Order, by: str, now: Now) -> None:
        """Execute an order of the run loop or of the run log; its event is stored first.

        `order`: any order except those that begin or end a recording.  `by`: name of its sender.
        Raises OrderError if the order is not possible now; then nothing is changed.
        """
        due = self._due.step if self._due else None
        t_ns = self._t_ns or now.wall_ns
        event = order_event(order, by, t_ns, self.run_log, self.bench, due)
        new_bench = None
        if isinstance(order, messages.Configure):
            if self.running:
                raise OrderError(f"{self.running} is being recorded: wait for its end")
            new_bench = configured(self.bench, order.bench_text)
        if event is not None:
            self._log(event)
        if new_bench is not None:
            self.adopt(new_bench, bench_codec(new_bench))
        match order:
            case messages.Arm():
                self._loop.arm(order.until, self._surroundings())
            case messages.Pause():
                self._loop.pause(self._surroundings())
            case messages.Choose():
                self._loop.choose(self._surroundings())
            case messages.Acknowledge():
                self._alarms.acknowledge()
            case _:
                self._loop.decide(self._surroundings())

    def note(self, code: str, value: float, text: str, now: Now) -> None:
        """Store an event of the recorder, at the time of the latest frame."""
        self._log(Event(self._t_ns or now.wall_ns, code, value, text))

    def _log(self, event: Event) -> None:
        """Store an event, then add it to the run log."""
        self._journal.append_events([event])
        self.run_log = advance(self.run_log, event)
        self._events.append(event)
        self._count_runs()

    # State -------------------------------------------------------------------------------------

    def status(self, now: Now) -> Status:
        """Return the status as far as the recording knows it."""
        loop, alarms, log, bench = self._loop, self._alarms, self.run_log, self.bench
        moving = trigger.not_at_rest(bench.trigger, self._trigger)
        decay_ratio = None
        if loop.phase is Phase.DECAY:
            decay_ratio = self._barrier.value("verdict", now, None, self._decay_ratio)
        return Status(
            wall_ns=now.wall_ns,
            t_ns=self._t_ns,
            vehicle=bench.vehicle.name,
            bench_crc32=zlib.crc32(bench.text.encode()),
            phase=loop.phase,
            phase_s=max(self._t_ns - loop.since_ns, 0) * 1e-9,
            countdown_s=loop.countdown_s(self._surroundings()),
            not_at_rest=moving if loop.phase is Phase.WAITING else (),
            bump_ns=self._bump_ns,
            peak_left=decay_ratio,
            halted=loop.halted,
            due=self._due,
            tallies=self._tallies,
            runs=log.runs,
            notes=log.notes,
            overrides=log.overrides,
            undo=_text_of_last(log.done),
            redo=_text_of_last(log.undone),
            alarms=alarms.grouped_alarms,
            overloaded=alarms.overloaded,
            buses=alarms.buses,
            sensors_alive=alarms.sensors_alive,
            sensors_expected=alarms.sensors_expected,
            losses=self.losses,
            revision=log.revision,
            origin=bench.origin,
        )

    @property
    def _pre_trigger_is_full(self) -> bool:
        """True if the trigger channels reach back over the whole pre-trigger."""
        return trigger.pre_trigger_full(self.bench.trigger, self._trigger, self._first_ns)

    def _surroundings(self) -> Surroundings:
        """Return the state on which the run loop depends, as of the latest frame."""
        is_armed = self._trigger.phase is trigger.TriggerPhase.ARMED  # all trigger channels rest
        return Surroundings(
            t_ns=self._t_ns,
            ready=is_armed and self._pre_trigger_is_full,
            run_log=self.run_log,
            due=self._due.step if self._due else None,
            bump_s=self.bench.campaign.bump_s,
            accept_after_s=self.bench.campaign.accept_after_s,
        )


def _text_of_last(changes: tuple[Change, ...]) -> str:
    """Return the run and the verdict of the last change, in words; empty if there is none."""
    run = changes[-1].after if changes else None
    return f"{run.label} {run.status}" if run else ""
