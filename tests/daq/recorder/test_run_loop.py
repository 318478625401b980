"""The run loop alone: phases, how far an order to arm carries, what stops it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Origin, Step
from daq.bench.config import Bench, BusConfig, default_bench_text, load_bench
from daq.bus.source import HopLosses
from daq.control.messages import (
    Accept,
    Acknowledge,
    Arm,
    Choose,
    Configure,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Phase,
    Redo,
    Reject,
    Undo,
    Until,
)
from daq.journal.writer import JournalWriter
from daq.recorder.recording import Recording
from daq.recorder.run_loop import (
    OrderError,
    RunLoop,
    Surroundings,
    configured,
    due_of,
    order_event,
    tallies_of,
)
from daq.runlog import (
    Code,
    LoggedRun,
    RunLog,
    advance,
    entry,
    fold,
    next_step,
    verdict_entry,
)
from daq.runs import ADDED, BASELINE, Event, Excitation, RunStatus
from dbc import Codec
from dbc.words import Finding, Severity

from ..crash_frames import read_journal
from ..recorder_run import LINK, armed, feed, now, status_of, step
from ..small_campaign import blocks, bumps, small_bench

S = 1_000_000_000
BOUNCE, ROLL = Excitation.BOUNCE, Excitation.ROLL
CAMPAIGN = Campaign((BOUNCE, ROLL), 2, ("baseline",))


def _finding(code: str) -> Finding:
    return Finding(code, Severity.ERROR, code)


@dataclass
class LoopBench:
    """A run_log, a loop and a time that a test moves on."""

    loop: RunLoop = field(default_factory=RunLoop)
    run_log: RunLog = field(default_factory=RunLog)
    t_ns: int = 1000 * S
    ready: bool = True

    @property
    def now(self) -> Surroundings:
        due = next_step(CAMPAIGN, self.run_log)
        return Surroundings(self.t_ns, self.ready, self.run_log, due, 0.2, 3.0)

    def arm(self, until: Until = Until.EXCITATION) -> LoopBench:
        self.loop.arm(until, self.now)
        return self.turn()

    def turn(self, seconds: float = 0.0) -> LoopBench:
        self.t_ns += round(seconds * S)
        self.loop.turn(self.now)
        return self

    def bump(self) -> str:
        step = next_step(CAMPAIGN, self.run_log)
        assert self.loop.phase is Phase.ARMED
        assert step is not None
        self.add(Event(self.t_ns, Code.BUMP, 9.0, step.label))
        self.loop.bump(step.label, self.t_ns)
        return step.label

    def end(self, *codes: str) -> LoopBench:
        """End the run with a verdict: these codes fail."""
        self.turn(2.5)
        self.add(verdict_entry(self.t_ns, self.loop.label, [_finding(code) for code in codes]))
        self.loop.judge(self.now)
        return self

    def run(self, *codes: str) -> LoopBench:
        """Bump, end and let the countdown pass."""
        self.bump()
        return self.end(*codes).turn(3.0)

    def add(self, event: Event) -> LoopBench:
        self.run_log = advance(self.run_log, event)
        return self

    def decide(self, code: Code, label: str = "") -> LoopBench:
        event = Event(self.t_ns, code, text="Ann")
        if label:
            event = entry(code, self.t_ns, label=label, by="Ann", reason="so")
        self.add(event)
        self.loop.decide(self.now)
        return self

    @property
    def countdown_s(self) -> float | None:
        return self.loop.countdown_s(self.now)

    @property
    def phase(self) -> str:  # not `Phase`: mypy would take it for the one that it was before
        return self.loop.phase


def test_a_run_goes_through_all_phases() -> None:
    bench = LoopBench(ready=False).arm()
    assert bench.phase == Phase.WAITING
    bench.ready = True
    assert bench.turn().phase == Phase.ARMED
    bench.ready = False  # somebody leans on the car
    assert bench.turn().phase == Phase.WAITING
    bench.ready = True
    bench.turn().bump()
    assert (bench.phase, bench.loop.since_ns) == (Phase.TRIGGERED, bench.t_ns)
    assert bench.turn(0.19).phase == Phase.TRIGGERED
    assert bench.turn(0.02).phase == Phase.DECAY
    assert bench.end().phase == Phase.ACCEPTED
    assert bench.countdown_s == 3.0
    assert bench.turn(2.9).phase == Phase.ACCEPTED
    assert bench.countdown_s == pytest.approx(0.1)
    assert bench.turn(0.2).phase == Phase.ARMED
    assert bench.countdown_s is None


def test_an_excitation_is_armed_until_its_repeats_are_accepted() -> None:
    bench = LoopBench().arm(Until.EXCITATION)
    bench.run("too_weak")
    assert bench.phase == Phase.ARMED
    bench.run()
    assert bench.phase == Phase.ARMED
    bench.run()
    assert bench.phase == Phase.IDLE
    assert [run.label for run in bench.run_log.runs] == [f"baseline_bounce_{n}" for n in (1, 2, 3)]
    assert bench.arm().run().phase == Phase.ARMED
    assert bench.run().phase == Phase.COMPLETE


def test_three_like_rejects_in_a_row_halt_it() -> None:
    bench = LoopBench().arm()
    bench.run("too_weak", "wrong_mode")
    bench.run("wrong_mode", "too_weak")
    bench.run("wrong_mode")
    assert bench.phase == Phase.ARMED
    bench.bump()
    bench.end("wrong_mode", "overload")
    assert (bench.phase, bench.loop.halted) == (Phase.IDLE, "wrong_mode")
    # Armed again it begins to count anew.
    bench.arm()
    assert (bench.phase, bench.loop.halted) == (Phase.ARMED, "")
    assert bench.run("wrong_mode").run("wrong_mode").phase == Phase.ARMED
    assert bench.run("wrong_mode").loop.halted == "wrong_mode"


@pytest.mark.parametrize("codes", [(), ("too_weak",)])
def test_what_a_person_rejects_does_not_halt_it(codes: tuple[str, ...]) -> None:
    bench = LoopBench().arm()
    for _ in range(4):
        label = bench.bump()
        bench.end(*codes)
        assert bench.decide(Code.REJECT, label).phase == Phase.REJECTED
        assert bench.turn(3.0).phase == Phase.ARMED


def test_a_verdict_within_the_countdown_counts_and_gives_the_time_anew() -> None:
    bench = LoopBench().arm()
    label = bench.bump()
    bench.end().turn(2.0)
    bench.decide(Code.REJECT, label)
    assert bench.phase == Phase.REJECTED
    assert bench.turn(2.0).decide(Code.UNDO).phase == Phase.ACCEPTED
    assert bench.turn(2.9).phase == Phase.ACCEPTED
    assert bench.turn(0.2).phase == Phase.ARMED
    # Undoing the recorder's own verdict turns it round.
    bench.bump()
    bench.end("too_weak")
    assert bench.decide(Code.UNDO).phase == Phase.ACCEPTED
    assert bench.decide(Code.REDO).phase == Phase.REJECTED


@pytest.mark.parametrize(
    ("until", "seconds"),
    [
        (Until.EXCITATION, [3.0, None, 3.0]),
        (Until.COMPLETE, [3.0, 3.0, 3.0]),
    ],
)
def test_seconds_are_counted_only_to_a_run_that_arms_itself(
    until: Until, seconds: list[float | None]
) -> None:
    """Two bounces and a roll: before the roll a person moves the boards, unless all are armed."""
    bench, counted = LoopBench(), list[float | None]()
    for _ in range(3):
        if bench.phase == Phase.IDLE:
            bench.arm(until)
        bench.bump()
        counted.append(bench.end().countdown_s)
        bench.turn(3.0)
    assert counted == seconds


def test_a_pause_lets_the_run_end_and_then_counts_no_bump() -> None:
    bench = LoopBench().arm()
    bench.bump()
    bench.loop.pause(bench.now)
    assert bench.phase == Phase.TRIGGERED
    assert bench.end().phase == Phase.ACCEPTED
    assert bench.countdown_s is None
    assert bench.turn(3.0).phase == Phase.PAUSED
    assert bench.turn(10.0).phase == Phase.PAUSED
    assert bench.arm().phase == Phase.ARMED
    bench.loop.pause(bench.now)
    assert bench.phase == Phase.PAUSED


def test_the_choice_of_another_bump_waits_for_a_person() -> None:
    bench = LoopBench().arm()
    choice = entry(Code.CHOOSE, bench.t_ns, mass_state="baseline", excitation="roll")
    bench.add(choice)
    bench.loop.choose(bench.now)
    assert bench.phase == Phase.IDLE
    bench.arm(Until.EXCITATION).run()
    assert bench.run_log.runs[-1].excitation is ROLL
    # Now a bounce is due again, as the campaign has it; the boards still lie as for a roll.
    assert bench.phase == Phase.IDLE
    # The same kind as was armed changes nothing; without anybody there it goes on, too.
    for until, kind in ((Until.EXCITATION, "bounce"), (Until.COMPLETE, "roll")):
        bench.arm(until)
        bench.add(entry(Code.CHOOSE, bench.t_ns, mass_state="baseline", excitation=kind))
        bench.loop.choose(bench.now)
        assert bench.phase == Phase.ARMED


def test_an_earlier_run_rejected_after_all_stops_it() -> None:
    bench = LoopBench().arm().run().run()
    bench.arm()
    assert bench.phase == Phase.ARMED
    assert bench.decide(Code.REJECT, "baseline_bounce_1").phase == Phase.IDLE


def test_a_complete_campaign_can_be_taken_up_again() -> None:
    bench = LoopBench().arm(Until.COMPLETE)
    for codes in [("too_weak",)] * 5 + [()] * 4:  # whatever is rejected
        assert bench.phase == Phase.ARMED
        bench.run(*codes)
    assert (bench.phase, bench.loop.halted) == (Phase.COMPLETE, "")
    assert bench.arm().phase == Phase.COMPLETE
    assert bench.decide(Code.REJECT, "baseline_roll_2").phase == Phase.IDLE
    assert bench.decide(Code.UNDO).phase == Phase.COMPLETE
    bench.add(entry(Code.CHOOSE, bench.t_ns, mass_state="baseline", excitation="bounce"))
    bench.loop.choose(bench.now)
    assert bench.phase == Phase.IDLE
    assert bench.arm().run().phase == Phase.COMPLETE


def test_a_clock_set_back_does_not_stretch_the_countdown() -> None:
    bench = LoopBench().arm()
    bench.bump()
    bench.end()
    bench.turn(-3600.0)
    assert bench.phase == Phase.ACCEPTED
    assert bench.turn(3.0).phase == Phase.ARMED


def test_the_runs_of_each_kind_are_counted_and_the_next_one_is_due() -> None:
    planned = replace(small_bench(), campaign=Campaign((BOUNCE, ROLL), 1))
    weak = LoggedRun("baseline_bounce_1", BASELINE, BOUNCE, 1, 5, RunStatus.REJECTED)
    good = replace(weak, label="baseline_bounce_2", repeat=2, status=RunStatus.ACCEPTED)
    beyond = replace(weak, label="baseline_warp_1", excitation=Excitation.WARP)
    log = RunLog((weak, good, beyond))
    tallies = tallies_of(planned, log)
    counts = [(t.mass_state, t.excitation, t.accepted, t.planned, t.rejected) for t in tallies]
    assert counts[:2] == [(BASELINE, BOUNCE, 1, 1, 1), (BASELINE, ROLL, 0, 1, 0)]
    assert counts[-1] == (BASELINE, Excitation.WARP, 0, 0, 1)
    due = due_of(planned, log, tallies)
    assert due is not None
    assert due.step.label == "baseline_roll_1"
    assert (due.accepted, due.planned, due.rejected) == (0, 1, 0)
    runs = [replace(good, label=s.label, mass_state=s.mass_state, excitation=s.excitation)
            for s in planned.campaign.steps]  # fmt: skip
    assert due_of(planned, RunLog(tuple(runs)), ()) is None
    chosen = RunLog(chosen=(BASELINE, Excitation.WARP))
    due = due_of(planned, chosen, tallies_of(planned, chosen))
    assert due is not None
    assert (due.step.label, due.planned) == ("baseline_warp_1", 0)


# Orders of a person as events of the run log, and those that make no sense now --------------------

BENCH: Bench = small_bench()
FIRST = LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 5, RunStatus.ACCEPTED)
LAST = replace(FIRST, label="baseline_roll_2", repeat=2, status=RunStatus.REJECTED)
OPEN = replace(FIRST, label="baseline_roll_3", repeat=3, status=RunStatus.OPEN)


def event(order: Order, *runs: LoggedRun, **facts: Any) -> Event | None:
    return order_event(order, "Ann", 77, replace(RunLog(runs), **facts), BENCH, None)


@pytest.mark.parametrize(
    ("order", "runs", "why"),
    [
        (Accept(""), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Reject(), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Accept("baseline_roll_3", "x"), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Accept("", "x"), (LAST, FIRST), "baseline_roll_1 is already accepted"),
        (Accept("baseline_roll_1", "x"), (FIRST, LAST), "baseline_roll_1 is already accepted"),
        (Accept(""), (FIRST, LAST), "give the reason"),
        (Accept(""), (), "no run yet"),
        (Accept("other"), (FIRST,), "no run 'other'"),
        (Reject(), (FIRST, LAST), "baseline_roll_2 is already rejected"),
        (Choose(BASELINE, Excitation.ROLL), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Choose("loaded", Excitation.ROLL), (), "not a mass state: baseline, added"),
        (Note("x", "other"), (FIRST,), "no run 'other'"),
        (Undo(), (FIRST,), "no verdict to undo"),
        (Redo(), (FIRST,), "nothing to redo"),
        (Arm(Until.COMPLETE), (FIRST,), "campaign is complete"),
    ],
)
def test_what_makes_no_sense_now_is_refused(
    order: Order, runs: tuple[LoggedRun, ...], why: str
) -> None:
    with pytest.raises(OrderError, match=why):
        event(order, *runs)


# Another bench.toml within a recording, and bench checks that wait for each other -----------------

TEXT = default_bench_text()
OLD = replace(
    load_bench(None),
    text=TEXT,
    buses=(BusConfig("slcan", "/dev/ttyACM0", 250_000),),  # as the command line says
    dbc_name="the one in force",
    origin=Origin.REPLAYED,
)


def test_another_bench_keeps_buses_dbc_and_origin_in_force() -> None:
    text = TEXT.replace("repeats = 2", "repeats = 3")
    assert text != TEXT
    new = configured(OLD, text)
    assert new.campaign.repeats == 3
    assert new.text == text
    assert (new.buses, new.dbc_name, new.origin) == (OLD.buses, OLD.dbc_name, OLD.origin)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (TEXT + "[campaign]\n", "bench.toml"),
        ("x = 1\n" + TEXT, "unknown key x"),
        (TEXT.replace("IMU_Accel.acc_z", "IMU_Accel.acc_q"), "no signal"),
        (TEXT.replace("[bus]", '[bus]\nname = "other"'), "other buses"),
        (TEXT.replace('dbc = ""', 'dbc = "other.dbc"'), "another DBC"),
    ],
)
def test_a_bench_that_cannot_go_on_is_refused(text: str, why: str) -> None:
    with pytest.raises(OrderError, match=why):
        configured(OLD, text)


# Orders to a recording, and a bench.toml that changes within it -----------------------------------


def test_weights_that_change_are_asked_for_when_the_run_is_armed() -> None:
    def armed(order: Arm, due: Step, log: RunLog) -> None:
        found = order_event(order, "Ann", 77, log, BENCH, due)
        assert found == Event(77, "arm", text=f"{order.until} Ann")

    first = Step(BASELINE, Excitation.ROLL, 1)
    done = RunLog(runs=(LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 0),))
    loaded = Step(ADDED, Excitation.BOUNCE, 1)
    armed(Arm(), first, RunLog())
    armed(Arm(), replace(first, repeat=2), done)
    for order in (Arm(), Arm(mass_state="baseline")):
        with pytest.raises(OrderError, match=r'weights on[?].* arm with "mass_state": "added"'):
            armed(order, loaded, done)
    armed(Arm(mass_state="added"), loaded, done)
    armed(Arm(Until.COMPLETE), loaded, done)
    back = RunLog(runs=(*done.runs, LoggedRun("added_roll_1", ADDED, Excitation.ROLL, 1, 0)))
    with pytest.raises(OrderError, match=r'weights off[?].* arm with "mass_state": "baseline"'):
        armed(Arm(), first, back)


def test_orders_are_written_down_and_those_that_make_no_sense_refused(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    frames = bumps(codec, 1)
    feed(recording, blocks(frames.select(slice(0, 700))))
    with pytest.raises(OrderError, match="is being recorded"):
        recording.carry_out(Configure(quick.text), "Ann", now())
    feed(recording, blocks(frames.select(slice(700, None))))
    recording.carry_out(Reject(reason="foot"), "Ann", now())
    with pytest.raises(OrderError, match="already rejected"):
        recording.carry_out(Reject("baseline_bounce_1"), "Ann", now())
    with pytest.raises(OrderError, match="give the reason"):
        recording.carry_out(Accept("baseline_bounce_1"), "Ann", now())
    recording.carry_out(Undo(), "Ann", now())
    recording.carry_out(Redo(), "Ann", now())
    recording.carry_out(Accept("baseline_bounce_1", "it was mine"), "Bob", now())
    recording.carry_out(Mark("here"), "Bob", now())
    recording.carry_out(Note("wet", "baseline_bounce_1"), "Bob", now())
    recording.carry_out(OverrideWarning("bus", "known"), "Bob", now())
    recording.carry_out(Acknowledge(), "Bob", now())
    recording.carry_out(Choose("added", Excitation.WARP), "Bob", now())
    status = status_of(recording)
    assert status.due is not None
    assert status.due.step.label == "added_warp_1"
    assert [(note.text, note.label) for note in status.notes] == [
        ("here", ""),
        ("wet", "baseline_bounce_1"),
    ]
    assert [(one.subject, one.by) for one in status.overrides] == [("bus", "Bob")]
    (run,) = status.runs
    assert (run.status, run.by, run.reason) == (RunStatus.ACCEPTED, "Bob", "it was mine")
    journal.close()
    events = read_journal(journal.paths).events
    assert fold(events) == recording.run_log
    assert {e.t_ns for e in events if e.code == "mark"} == {int(frames.t_ns[-1])}


def test_bench_toml_may_change_within_a_recording(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    with pytest.raises(OrderError, match="is not TOML"):
        recording.carry_out(Configure("[[["), "Ann", now())
    assert recording.bench == quick
    other = quick.text.replace('name = "Ford Granada"', 'name = "Other"')
    recording.carry_out(Configure(other), "Ann", now())
    assert status_of(recording).vehicle == "Other"
    journal.close()
    assert [(e.code, e.text) for e in read_journal(journal.paths).events] == [("bench", other)]


def test_what_was_lost_before_bench_toml_changed_is_no_news(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    frames = bumps(codec, 1)
    whole = frames.select(np.delete(np.arange(len(frames)), [50, 51]))
    given, lost = blocks(whole), HopLosses(queue_dropped=9)
    for block in given[: len(given) // 2]:
        step(recording, block, lost, now(block), [LINK])
    recording.carry_out(Configure(quick.text), "Ann", now())
    status = [
        event.text.partition(":")[0]
        for block in given[len(given) // 2 :]
        for event in step(recording, block, lost, now(block), [LINK])
        if event.code == "alarm"
    ]
    assert not {"queue_dropped", "counter_gap HUB_Front"} & set(status), status
    assert status_of(recording).buses[0].frames == len(whole)
