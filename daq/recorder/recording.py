"""The engine of a recording: journal first, then decode, watch, find the bumps, judge them.

`Recording.step` does all of it for one block, without threads and without a clock;
`daq.recorder.recorder` feeds it.  Whatever fails after the journal costs no frame: it is
told as `consumer_failed`.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import replace

from dbc import Codec
from dbc.finding import Finding, Severity
from dbc.frames import FrameBatch

from ..alarms import AlarmState, Turn, acknowledged, reconfigured, watch
from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec
from ..bus.source import HopLosses, LinkFacts
from ..clocks import Now
from ..control.messages import DiskStatus, Live, Phase, QueueStatus, Status
from ..control.orders import Acknowledge, Arm, Choose, Configure, Order, Pause
from ..runlog.entries import verdict_entry
from ..runlog.fold import advance
from ..runlog.runlog import Code, RunLog, next_step, parse_label
from ..runs import Event, Losses
from ..samples import health, trigger
from ..samples.bench_mapping import bench_mapping
from ..verdict import RunMeasure
from . import run_loop
from .bench_checks import configured
from .fault_barrier import Guard
from .frame_store import FrameStore
from .judging import UNJUDGED, Judge
from .live import LiveRing
from .orders import OrderError, order_event
from .recent import RecentFrames
from .run_loop import LoopState, Surroundings
from .status import NO_DISK, NO_QUEUE, Host, due, redo_text, tallies, told_runs, undo_text

RESTAMPED = "restamped"


class Recording:
    """One recording of a campaign.

    Parameters
    ----------
    bench : Bench
        Channels, campaign, trigger and procedure.
    codec : Codec
        The bench's DBC.
    store : FrameStore
        Where everything goes; the caller closes it.
    book : Book
        Of a recording that is taken up again.
    guard : Guard
        Told of whatever fails behind the journal.

    Raises
    ------
    InputError
        If a channel and the DBC do not fit, or no channel can trigger.
    """

    def __init__(
        self,
        bench: Bench,
        codec: Codec,
        store: FrameStore,
        book: RunLog | None = None,
        guard: Guard | None = None,
    ) -> None:
        self._store = store
        self._book = book or RunLog()
        self._hops = HopLosses()
        self._loop = LoopState()
        self._health = health.HealthState()
        self._guard = guard or Guard()
        self._frames = 0
        self._t_ns = self._first_ns = 0
        self._bump_ns = 0
        self._raw = RecentFrames()
        self.measures: dict[str, RunMeasure] = {}
        self._alarms = AlarmState()
        self.adopt(bench, codec)

    def adopt(self, bench: Bench, codec: Codec) -> None:
        """Go on with another bench.toml.

        Raises
        ------
        InputError
            As the constructor; nothing has changed then.
        """
        mapped, triggers = bench_mapping(bench, codec)
        self._bench, self._codec, self._mapped, self._triggers = bench, codec, mapped, triggers
        self._live = LiveRing([m.channel.name for m in mapped])
        self._judge = Judge(bench, codec, self.measures)
        self._trigger = trigger.TriggerState()
        self._alarms = reconfigured(self._alarms)
        # One that was killed behind the last run, or that now plans fewer of them, is complete.
        self._loop = run_loop.decided(self._loop, self._surroundings(self._t_ns))

    @property
    def bench(self) -> Bench:
        """The bench in force."""
        return self._bench

    @property
    def book(self) -> RunLog:
        """The runs and what was decided."""
        return self._book

    @property
    def running(self) -> str:
        """Label of the run that is being recorded, also if it is rejected already; else empty."""
        return self._loop.label if self._loop.running else ""

    @property
    def complete(self) -> bool:
        """Whether every planned run is accepted and the operator's time to reject is over."""
        return self._loop.phase is Phase.COMPLETE

    @property
    def revision(self) -> int:
        """Of the book: changes so far of what a session file is made of."""
        return self._book.revision

    @property
    def losses(self) -> Losses:
        """What was lost so far, at all hops."""
        hops = Losses(
            bus_dropped=self._hops.bus_dropped,
            bus_garbled=self._hops.bus_garbled,
            queue_dropped=self._hops.queue_dropped,
        )
        return health.losses_added(self._health.losses, hops)

    def step(
        self,
        batch: FrameBatch,
        hops: HopLosses,
        now: Now,
        links: Sequence[LinkFacts] = (),
        disk: DiskStatus = NO_DISK,
        queue: QueueStatus = NO_QUEUE,
    ) -> tuple[Event, ...]:
        """Take in one block of frames; to be called in silence, too, for the alarms.

        Parameters
        ----------
        batch : FrameBatch
            In order of arrival; may be empty.
        hops : HopLosses
            Cumulative counts up to this block, since this recorder was started.
        now : Now
            The host's clocks.
        links, disk, queue : sequence of LinkFacts, DiskStatus, QueueStatus
            As they stand.

        Returns
        -------
        tuple of Event
            What happened, as stored: `bump` and `run_end` carry the label of their run.

        Raises
        ------
        JournalError
            If the store raises it.  Nothing else has been done with the block then.
        """
        if len(batch) or hops != self._hops:
            self._store.append(batch, hops)
        restamped = hops.restamped and not self._hops.restamped
        self._hops = hops
        events: list[Event] = []
        if len(batch):
            self._frames += len(batch)
            self._t_ns = int(batch.t_ns[-1])
            self._first_ns = self._first_ns or int(batch.t_ns[0])
            self._raw.add(batch)
        if restamped:
            text = "time stamps of another epoch: frames are stamped on arrival"
            self._tell(Event(self._t_ns, RESTAMPED, hops.restamped, text), events)
        turn = Turn(now, batch, None, self._health, links, hops, disk, queue)
        turn = self._guard.value("decode", now, turn, lambda: self._decoded(turn))
        if turn.decoded is not None:
            self._guard.run("samples", now, lambda: self._take(turn, events))
        self._guard.run("run loop", now, self._pass_time)
        self._guard.run("alarms", now, lambda: self._watch(turn, events))
        for event in self._guard.events(now, self._t_ns or now.wall_ns):
            self._tell(event, events)
        return tuple(events)

    def carry_out(self, order: Order, by: str, now: Now) -> None:
        """Carry out an order of the run loop or of the book; its event is stored first.

        Parameters
        ----------
        order : Order
            Not one of those that begin or end a recording.
        by : str
            Who gave it.
        now : Now
            The host's clocks.

        Raises
        ------
        OrderError
            If it makes no sense now; nothing has changed then.
        """
        t_ns = self._t_ns or now.wall_ns
        event = order_event(order, by, t_ns, self._book, self._bench)
        if isinstance(order, Arm) and self._due is None:
            raise OrderError("the campaign is complete: choose a run first")
        bench = self._configured(order.bench_text) if isinstance(order, Configure) else None
        if event is not None:
            self._tell(event, [])
        if bench is not None:
            self.adopt(bench, bench_codec(bench))
        here = self._surroundings(self._t_ns)
        match order:
            case Arm():
                self._loop = run_loop.armed(self._loop, order.until, here)
                self._tell(Event(t_ns, "arm", text=f"{order.until} {by}"), [])
            case Pause():
                self._loop = run_loop.paused(self._loop, here)
                self._tell(Event(t_ns, "pause", text=by), [])
            case Choose():
                self._loop = run_loop.chosen(self._loop, here)
            case Acknowledge():
                self._alarms = acknowledged(self._alarms)
            case _:
                self._loop = run_loop.decided(self._loop, here)

    def reconfigure(self, bench: Bench, now: Now) -> None:
        """Go on with a bench that was checked, and store its text."""
        self.note(Code.BENCH, 0.0, bench.text, now)
        self.adopt(bench, bench_codec(bench))

    def cut(self, why: str) -> None:
        """End the run that is being recorded, if any: it cannot be brought to its end."""
        if not self.running:
            return
        finding = Finding("cut", Severity.ERROR, f"cut: {why}", advice="bump again")
        self._tell(verdict_entry(self._t_ns, self.running, [finding]), [])
        self._loop = run_loop.judged(self._loop, self._surroundings(self._t_ns))

    def note(self, code: str, value: float, text: str, now: Now) -> None:
        """Store an event that is not in the frames, at the time of the latest one."""
        self._tell(Event(self._t_ns or now.wall_ns, code, value, text), [])

    def status(self, now: Now, host: Host) -> Status:
        """Return where the recording stands."""
        bench, book, loop = self._bench, self._book, self._loop
        waiting: tuple[str, ...] = ()
        if loop.phase is Phase.WAITING:
            waiting = trigger.not_at_rest(bench.trigger, self._trigger)
        return Status(
            wall_ns=now.wall_ns,
            t_ns=self._t_ns,
            recording=host.recording,
            folder=host.folder,
            vehicle=bench.vehicle.name,
            bench_crc32=zlib.crc32(bench.text.encode()),
            phase=loop.phase,
            phase_s=max(self._t_ns - loop.since_ns, 0) * 1e-9,
            countdown_s=loop.countdown_s(self._t_ns, bench.procedure.accept_after_s),
            not_at_rest=waiting,
            bump_ns=self._bump_ns,
            peak_left=self._guard.value("verdict", now, None, self._peak_left),
            halted=loop.halted,
            due=due(bench, book),
            tallies=tallies(bench, book),
            runs=told_runs(book),
            notes=book.notes,
            overrides=book.overrides,
            undo=undo_text(book),
            redo=redo_text(book),
            alarms=self._alarms.alarms,
            overloaded=self._alarms.overloaded,
            buses=self._alarms.buses,
            sensors_alive=self._alarms.sensors_alive,
            sensors_expected=self._alarms.sensors_expected,
            losses=self.losses,
            disk=host.disk,
            queue=host.queue,
            session=host.session,
            software=host.software,
            revision=book.revision,
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
        return next_step(self._bench.campaign, self._book)

    def _configured(self, text: str) -> Bench:
        if self.running:
            raise OrderError(f"{self.running} is being recorded: wait for its end")
        return configured(self._bench, text)

    def _tell(self, event: Event, events: list[Event]) -> None:
        """Store an event, then let the book have it."""
        self._store.append_events([event])
        self._book = advance(self._book, event)
        events.append(event)

    def _surroundings(self, t_ns: int, ready: bool | None = None) -> Surroundings:
        bench = self._bench
        full = trigger.pre_trigger_full(bench.trigger, self._trigger, self._first_ns)
        if ready is None:
            ready = self._trigger.phase is trigger.TriggerPhase.ARMED
        return Surroundings(
            t_ns,
            ready and full,
            self._book,
            self._due,
            bench.bump_s,
            bench.procedure.accept_after_s,
        )

    def _decoded(self, turn: Turn) -> Turn:
        if not len(turn.batch):
            return turn
        decoded = self._codec.decode(turn.batch)
        self._health = health.advance(self._codec.messages, self._health, decoded)
        return replace(turn, decoded=decoded, health=self._health)

    def _take(self, turn: Turn, events: list[Event]) -> None:
        """Keep the samples, and go through the bumps found in them."""
        assert turn.decoded is not None  # held by the caller
        block = {
            m.channel.name: (samples.t_ns, m.values(samples))
            for m in self._mapped
            if (samples := turn.decoded.samples.get(m.channel.signal)) is not None
        }
        self._judge.add(int(turn.batch.t_ns.min()), self._t_ns, block, self.losses)
        self._live.add(block)
        own = {name: piece for name, piece in block.items() if name in self._triggers}
        self._trigger, found = trigger.advance(self._bench.trigger, self._trigger, own)
        for event in found:
            match event.code:
                case trigger.BUMP:
                    self._bumped(event, events)
                case trigger.RUN_END:
                    self._ended(event, turn, events)
                case _:
                    self._tell(event, events)
                    if event.code == trigger.CLOCK_STEP:
                        self._first_ns = event.t_ns
                        self.cut("the time stamps fell back")

    def _bumped(self, event: Event, events: list[Event]) -> None:
        here = self._surroundings(event.t_ns, ready=True)  # it was
        self._loop = run_loop.turned(self._loop, here)
        due = self._due
        if due is None or not self._loop.takes_bumps:
            self._tell(replace(event, code=trigger.UNPLANNED + event.code), events)
            return
        self._tell(replace(event, text=due.label), events)
        self._loop = run_loop.bumped(self._loop, due.label, event.t_ns)
        self._bump_ns = event.t_ns

    def _ended(self, event: Event, turn: Turn, events: list[Event]) -> None:
        if not self._loop.running:
            self._tell(replace(event, code=trigger.UNPLANNED + event.code), events)
            return
        label = self._loop.label
        self._tell(replace(event, text=label), events)
        findings = self._guard.value("verdict", turn.now, UNJUDGED, lambda: self._findings(label))
        self._tell(verdict_entry(event.t_ns, label, findings), events)
        seen_ns = max(event.t_ns, int(turn.batch.t_ns[0]))  # a bus may have paused meanwhile
        self._loop = run_loop.judged(self._loop, self._surroundings(seen_ns))

    def _findings(self, label: str) -> Sequence[Finding]:
        step = parse_label(label)
        assert step is not None  # the recorder gave it
        return self._judge.verdict(step, self._bump_ns, self._book)

    def _peak_left(self) -> float | None:
        if self._loop.phase is not Phase.DECAY:
            return None
        return self._judge.peak_left(self._bump_ns, self._t_ns)

    def _pass_time(self) -> None:
        self._loop = run_loop.turned(self._loop, self._surroundings(self._t_ns))

    def _watch(self, turn: Turn, events: list[Event]) -> None:
        turn = replace(turn, failed=self._guard.failed(turn.now))
        self._alarms, told = watch(
            self._bench.recorder, self._codec, self._mapped, self._alarms, turn
        )
        at_end = [alarm.subject for alarm in self._alarms.alarms if alarm.code == "saturated"]
        self._judge.saw_saturated(self._t_ns, at_end)
        for event in told:
            self._tell(event, events)
