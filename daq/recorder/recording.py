"""Processes one recording: journal first, then decode, watch, find the bumps, judge them.

`Recording.store` writes one block to the journal; `Recording.look` does the other steps for all
blocks since the last look.  Both have no threads and no clock; `daq.recorder.recorder` calls them.
A failure after the journal loses no frame: the event `consumer_failed` reports it.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.frames import FrameBatch

from ..alarms import Cycle, Watch
from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec
from ..bus.clock import Now
from ..bus.source import HopLosses, LinkFacts
from ..control.messages import DiskStatus, LeftOut, Live, Phase, Status, StorageStatus
from ..control.orders import Acknowledge, Arm, Choose, Configure, LeaveOut, Order, Pause
from ..errors import printable
from ..runlog.run_log import Change, Code, RunLog, advance, parse_label, verdict_entry
from ..runs import Event, Losses
from ..samples import converter as health
from ..samples import trigger as trigger
from ..samples.mapping import mapped_block
from ..samples.trigger import bench_mapping
from ..verdict import RunMeasure
from ..verdict.words import finding
from . import status as run_loop
from .judging import UNJUDGED, Judge, RecentFrames
from .live import Compared, LiveRing, compared, left_out_event, proposed
from .orders import OrderError, checked_arm, configured, order_event
from .readers import FrameStore
from .status import Counts, LoopState, Surroundings, counts_of

# Runs the frame consumers; one that fails is reported and never stops the recording ---------------

CONSUMER_FAILED = "consumer_failed"
REPORT_S = 1.0
"""Time, s, between two events for a consumer that keeps failing."""
FORGOTTEN_S = 5.0
"""Time, s, without a failure after which a consumer counts as working again."""

_T = TypeVar("_T")


class FaultBarrier:
    """Runs consumers and keeps their failures."""

    def __init__(self) -> None:
        self._failed: dict[str, tuple[float, str]] = {}
        self._failures: dict[str, int] = {}
        self._reported_s: dict[str, float] = {}

    def run(self, name: str, now: Now, consumer: Callable[[], object]) -> None:
        """Run a consumer that may fail."""
        self.value(name, now, None, consumer)

    def value(self, name: str, now: Now, otherwise: _T, consumer: Callable[[], _T]) -> _T:
        """Return the result of a consumer, or `otherwise` if it fails."""
        try:
            return consumer()
        except Exception as error:  # any exception: the frames are stored, the recording continues
            self._failed[name] = (now.monotonic_s, printable(repr(error)))
            self._failures[name] = self._failures.get(name, 0) + 1
            return otherwise

    def failed(self, now: Now) -> Mapping[str, str]:
        """Return the failing consumers, with reasons."""
        return {
            name: text
            for name, (failed_s, text) in self._failed.items()
            if now.monotonic_s - failed_s < FORGOTTEN_S
        }

    def events(self, now: Now, t_ns: int) -> tuple[Event, ...]:
        """Return the due events: one per second for each failing consumer, with a count."""
        due = [
            name
            for name in self._failures
            if now.monotonic_s - self._reported_s.get(name, float("-inf")) >= REPORT_S
        ]
        self._reported_s.update(dict.fromkeys(due, now.monotonic_s))
        return tuple(
            Event(
                t_ns, CONSUMER_FAILED, self._failures.pop(name), f"{name}: {self._failed[name][1]}"
            )
            for name in due
        )


# The recording ------------------------------------------------------------------------------------

RESTAMPED = "restamped"


class Recording:
    """One recording: of a campaign, or of the traffic between two campaigns, when nothing is armed.

    `store`: for frames and events; the caller closes it.  `run_log`: run log of a resumed
    recording.  Raises InputError if a channel contradicts the DBC, or no channel can trigger.
    """

    def __init__(
        self,
        bench: Bench,
        codec: Codec,
        store: FrameStore,
        run_log: RunLog | None = None,
        barrier: FaultBarrier | None = None,
    ) -> None:
        self._store = store
        self._run_log = run_log or RunLog()
        self._hops = self._looked_hops = HopLosses()
        self._unseen: list[FrameBatch] = []
        self._loop = LoopState()
        self._health = health.HealthState()
        self._barrier = barrier or FaultBarrier()
        self._frames = 0
        self._t_ns = self._first_ns = 0
        self._bump_ns = 0
        self._raw = RecentFrames()
        self.measures: dict[str, RunMeasure] = {}
        self._alarms = Watch()
        self.adopt(bench, codec)

    def adopt(self, bench: Bench, codec: Codec) -> None:
        """Continue with another bench.toml.

        Raises InputError as the constructor; then nothing is changed.
        """
        mapped, triggers = bench_mapping(bench, codec)
        self._bench, self._codec, self._mapped, self._triggers = bench, codec, mapped, triggers
        self._live = LiveRing([m.channel.name for m in mapped])
        self._judge = Judge(bench, codec, self.measures)
        self._trigger = trigger.TriggerState()
        self._counted: tuple[RunLog, Counts] | None = None
        self._compared: tuple[tuple[RunLog | None, int], Compared] = (None, 0), {}
        self._alarms.adopt()
        # It is complete if it was killed after the last run, or now plans fewer runs.
        self._loop = run_loop.decided(self._loop, self._surroundings(self._t_ns))

    @property
    def bench(self) -> Bench:
        """The present bench."""
        return self._bench

    @property
    def run_log(self) -> RunLog:
        """The runs and the verdicts on them."""
        return self._run_log

    @property
    def running(self) -> str:
        """Label of the run that is being recorded, also if it is already rejected; else empty."""
        return self._loop.label if self._loop.running else ""

    @property
    def revision(self) -> int:
        """Revision of the run log."""
        return self._run_log.revision

    @property
    def losses(self) -> Losses:
        """The losses until now, at all hops."""
        return health.losses_added(self._health.losses, self._hops.of_a_run)

    def store(self, batch: FrameBatch, hops: HopLosses) -> None:
        """Store one block of frames, and keep it for the next look.

        `batch`: in order of arrival; may be empty.  `hops`: cumulative counts up to this block,
        since this recorder was started.  Raises JournalError if the store raises it; the block is
        then not processed.
        """
        if len(batch) or hops != self._hops:
            self._store.append(batch, hops)
        self._hops = hops
        if len(batch):
            self._frames += len(batch)
            self._t_ns = int(batch.t_ns[-1])
            self._first_ns = self._first_ns or int(batch.t_ns[0])
            self._raw.add(batch)
            self._unseen.append(batch)

    def look(
        self,
        now: Now,
        links: Sequence[LinkFacts],
        disk: DiskStatus,
        storage: StorageStatus,
    ) -> tuple[Event, ...]:
        """Process all frames since the last look; also called without frames, for the alarms.

        `links`, `disk`, `storage`: their present state.  Returns the events stored: `bump`
        and `run_end` have the label of their run.
        """
        batch, hops, events = FrameBatch.concatenate(self._unseen), self._hops, list[Event]()
        restamped = hops.restamped and not self._looked_hops.restamped
        self._unseen, self._looked_hops = [], hops
        if restamped:
            text = "time stamps of another epoch: frames are stamped on arrival"
            self._log_event(Event(self._t_ns, RESTAMPED, hops.restamped, text), events)
        cycle = Cycle(now, batch, None, self._health, links, hops, disk, storage)
        cycle = self._barrier.value("decode", now, cycle, lambda: self._decoded(cycle))
        if cycle.decoded is not None:
            self._barrier.run("samples", now, lambda: self._take(cycle, events))
        self._barrier.run("run loop", now, self._pass_time)
        self._barrier.run("alarms", now, lambda: self._watch(cycle, events))
        for event in self._barrier.events(now, self._t_ns or now.wall_ns):
            self._log_event(event, events)
        return tuple(events)

    def carry_out(self, order: Order, by: str, now: Now) -> None:
        """Execute an order of the run loop or of the run log; its event is stored first.

        `order`: any order except those that begin or end a recording.  `by`: name of its sender.
        Raises OrderError if the order is not possible now; then nothing is changed.
        """
        t_ns = self._t_ns or now.wall_ns
        if isinstance(order, LeaveOut):
            event: Event | None = left_out_event(self._proposed, by, t_ns)
        else:
            event = order_event(order, by, t_ns, self._run_log, self._bench)
        if isinstance(order, Arm):
            checked_arm(order, self._due, self._run_log)
        bench = self._configured(order.bench_text) if isinstance(order, Configure) else None
        if event is not None:
            self._log_event(event, [])
        if bench is not None:
            self.adopt(bench, bench_codec(bench))
        surroundings = self._surroundings(self._t_ns)
        match order:
            case Arm():
                self._loop = run_loop.armed(self._loop, order.until, surroundings)
                self._log_event(Event(t_ns, "arm", text=f"{order.until} {by}"), [])
            case Pause():
                self._loop = run_loop.paused(self._loop, surroundings)
                self._log_event(Event(t_ns, "pause", text=by), [])
            case Choose():
                self._loop = run_loop.chosen(self._loop, surroundings)
            case Acknowledge():
                self._alarms.acknowledge()
            case _:
                self._loop = run_loop.decided(self._loop, surroundings)

    def reconfigure(self, bench: Bench, now: Now) -> None:
        """Continue with a checked bench, and store its text."""
        self.note(Code.BENCH, 0.0, bench.text, now)
        self.adopt(bench, bench_codec(bench))

    def cut(self, why: str) -> None:
        """Reject the run that is being recorded, if any, because it cannot be finished."""
        if self.running:
            self._reject(Finding("cut", Severity.ERROR, f"cut: {why}", advice="bump again"), [])

    def note(self, code: str, value: float, text: str, now: Now) -> None:
        """Store an event of the recorder, at the time of the latest frame."""
        self._log_event(Event(self._t_ns or now.wall_ns, code, value, text), [])

    def status(self, now: Now) -> Status:
        """Return the status as far as the recording knows it."""
        loop, alarms, log, counts = self._loop, self._alarms, self._run_log, self._counts
        bench = self._bench
        return Status(
            wall_ns=now.wall_ns,
            t_ns=self._t_ns,
            vehicle=bench.vehicle.name,
            bench_crc32=zlib.crc32(bench.text.encode()),
            phase=loop.phase,
            phase_s=max(self._t_ns - loop.since_ns, 0) * 1e-9,
            countdown_s=loop.countdown_s(self._t_ns, bench.campaign.accept_after_s, self._due),
            not_at_rest=trigger.not_at_rest(bench.trigger, self._trigger)
            if loop.phase is Phase.WAITING
            else (),
            bump_ns=self._bump_ns,
            peak_left=self._barrier.value("verdict", now, None, self._peak_left),
            halted=loop.halted,
            due=counts.due,
            tallies=counts.tallies,
            runs=log.runs,
            notes=log.notes,
            overrides=log.overrides,
            undo=_text_of_last(log.done),
            redo=_text_of_last(log.undone),
            alarms=alarms.shown,
            overloaded=alarms.overloaded,
            buses=alarms.buses,
            sensors_alive=alarms.sensors_alive,
            sensors_expected=alarms.sensors_expected,
            losses=self.losses,
            revision=log.revision,
            origin=bench.origin,
            proposed=self._barrier.value("comparison", now, (), lambda: self._proposed),
        )

    def recent(self, seconds: float) -> FrameBatch:
        """Return the raw frames of the last seconds, at most ten."""
        return self._raw.last(seconds)

    def live(self) -> Live | None:
        """Return the samples that became complete since the last call."""
        return self._live.fresh()

    def history(self, seconds: float) -> Live:
        """Return the samples of the last seconds, at most sixty."""
        return self._live.history(seconds)

    @property
    def _due(self) -> Step | None:
        due = self._counts.due
        return due.step if due else None

    @property
    def _counts(self) -> Counts:
        if self._counted is None or self._counted[0] is not self._run_log:
            self._counted = self._run_log, counts_of(self._bench, self._run_log)
        return self._counted[1]

    @property
    def _proposed(self) -> tuple[LeftOut, ...]:
        # After a restart the measures arrive later than the runs.
        known = self._run_log, len(self.measures)
        if self._compared[0] != known:
            before = self._compared[1]
            self._compared = known, compared(self._bench, self._run_log, self.measures, before)
        return proposed(self._compared[1])

    def _configured(self, text: str) -> Bench:
        if self.running:
            raise OrderError(f"{self.running} is being recorded: wait for its end")
        return configured(self._bench, text)

    def _log_event(self, event: Event, events: list[Event]) -> None:
        """Store an event, then add it to the run log."""
        self._store.append_events([event])
        self._run_log = advance(self._run_log, event)
        events.append(event)

    def _surroundings(self, t_ns: int, ready: bool | None = None) -> Surroundings:
        bench = self._bench
        full = trigger.pre_trigger_full(bench.trigger, self._trigger, self._first_ns)
        if ready is None:
            ready = self._trigger.phase is trigger.TriggerPhase.ARMED
        return Surroundings(
            t_ns,
            ready and full,
            self._run_log,
            self._due,
            bench.campaign.bump_s,
            bench.campaign.accept_after_s,
        )

    def _decoded(self, cycle: Cycle) -> Cycle:
        if not len(cycle.batch):
            return cycle
        decoded = self._codec.decode(cycle.batch)
        self._health = health.advance(self._codec.messages, self._health, decoded)
        return replace(cycle, decoded=decoded, health=self._health)

    def _take(self, cycle: Cycle, events: list[Event]) -> None:
        """Keep the samples, and process the bumps found in them."""
        assert cycle.decoded is not None  # ensured by the caller
        block = mapped_block(self._mapped, cycle.decoded)
        self._judge.add(int(cycle.batch.t_ns.min()), self._t_ns, block, self.losses)
        self._live.add(block)
        trigger_block = {name: piece for name, piece in block.items() if name in self._triggers}
        self._trigger, found = trigger.advance(self._bench.trigger, self._trigger, trigger_block)
        for event in found:
            match event.code:
                case trigger.BUMP:
                    self._bumped(event, events)
                case trigger.RUN_END:
                    self._ended(event, cycle, events)
                case _:
                    self._log_event(event, events)
                    if event.code == trigger.CLOCK_STEP:
                        self._first_ns = event.t_ns
                        self.cut("the time stamps went back")

    def _bumped(self, event: Event, events: list[Event]) -> None:
        surroundings = self._surroundings(event.t_ns, ready=True)  # the state at the bump
        self._loop = run_loop.turned(self._loop, surroundings)
        due = self._due
        if due is None or not self._loop.takes_bumps:
            self._log_event(replace(event, code=trigger.UNPLANNED + event.code), events)
            return
        self._log_event(replace(event, text=due.label), events)
        self._loop = run_loop.bumped(self._loop, due.label, event.t_ns)
        self._bump_ns = event.t_ns

    def _ended(self, event: Event, cycle: Cycle, events: list[Event]) -> None:
        if not self._loop.running:
            self._log_event(replace(event, code=trigger.UNPLANNED + event.code), events)
            return
        label = self._loop.label
        self._log_event(replace(event, text=label), events)
        findings = self._barrier.value(
            "verdict", cycle.now, UNJUDGED, lambda: self._findings(label)
        )
        self._log_event(verdict_entry(event.t_ns, label, findings), events)
        seen_ns = max(event.t_ns, int(cycle.batch.t_ns[0]))  # a bus may have paused in between
        self._loop = run_loop.judged(self._loop, self._surroundings(seen_ns))

    def _reject(self, finding: Finding, events: list[Event]) -> None:
        """End the run that is being recorded now, with the reason."""
        self._log_event(verdict_entry(self._t_ns, self.running, [finding]), events)
        self._loop = run_loop.judged(self._loop, self._surroundings(self._t_ns))

    def _findings(self, label: str) -> Sequence[Finding]:
        step = parse_label(label)
        assert step is not None  # given by the recorder
        return self._judge.verdict(step, self._bump_ns, self._run_log)

    def _peak_left(self) -> float | None:
        if self._loop.phase is not Phase.DECAY:
            return None
        return self._judge.peak_left(self._bump_ns, self._t_ns)

    def _pass_time(self) -> None:
        self._loop = run_loop.turned(self._loop, self._surroundings(self._t_ns))

    def _watch(self, cycle: Cycle, events: list[Event]) -> None:
        cycle = replace(cycle, failed=self._barrier.failed(cycle.now))
        alarm_events = self._alarms.advance(self._bench.recorder, self._codec, self._mapped, cycle)
        at_end = [alarm.subject for alarm in self._alarms.alarms if alarm.code == "saturated"]
        self._judge.saw_saturated(self._t_ns, at_end)
        for event in alarm_events:
            self._log_event(event, events)
        dead = self._alarms.dead_bus if self.running else None
        if dead is not None:
            self._reject(finding("bus_lost", False, 0.0, 0.0, "", dead.text, dead.subject), events)


def _text_of_last(changes: tuple[Change, ...]) -> str:
    """Return the last of the verdicts that can be undone or redone, in words."""
    return f"{changes[-1].after.label} {changes[-1].after.status}" if changes else ""
