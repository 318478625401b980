"""The run loop alone: phases, how far an order to arm carries, what stops it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import pytest

from daq.bench.campaign import Campaign
from daq.control.messages import Phase, Until
from daq.recorder.run_loop import RunLoop, Surroundings, due_of, tallies_of
from daq.runlog import (
    Code,
    LoggedRun,
    LoggedStatus,
    RunLog,
    advance,
    entry,
    next_step,
    verdict_entry,
)
from daq.runs import BASELINE, Event, Excitation
from dbc.finding import Finding, Severity

from ..small_campaign import small_bench

S = 1_000_000_000
BOUNCE, ROLL = Excitation.BOUNCE, Excitation.ROLL
CAMPAIGN = Campaign((BOUNCE, ROLL), 2, ("baseline",))


def _finding(code: str) -> Finding:
    return Finding(code, Severity.ERROR, code)


@dataclass
class Bench:
    """A run_log, a loop and a time that a test moves on."""

    loop: RunLoop = field(default_factory=RunLoop)
    run_log: RunLog = field(default_factory=RunLog)
    t_ns: int = 1000 * S
    ready: bool = True

    @property
    def now(self) -> Surroundings:
        due = next_step(CAMPAIGN, self.run_log)
        return Surroundings(self.t_ns, self.ready, self.run_log, due, 0.2, 3.0)

    def arm(self, until: Until = Until.EXCITATION) -> Bench:
        self.loop.arm(until, self.now)
        return self.turn()

    def turn(self, seconds: float = 0.0) -> Bench:
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

    def end(self, *codes: str) -> Bench:
        """End the run with a verdict: these codes fail."""
        self.turn(2.5)
        self.add(verdict_entry(self.t_ns, self.loop.label, [_finding(code) for code in codes]))
        self.loop.judge(self.now)
        return self

    def run(self, *codes: str) -> Bench:
        """Bump, end and let the countdown pass."""
        self.bump()
        return self.end(*codes).turn(3.0)

    def add(self, event: Event) -> Bench:
        self.run_log = advance(self.run_log, event)
        return self

    def decide(self, code: Code, label: str = "") -> Bench:
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
    bench = Bench(ready=False).arm()
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
    bench = Bench().arm(Until.EXCITATION)
    bench.run("too_weak")
    assert bench.phase == Phase.ARMED
    bench.run()
    assert bench.phase == Phase.ARMED
    bench.run()
    assert bench.phase == Phase.IDLE
    assert [run.label for run in bench.run_log.runs] == [f"baseline_bounce_{n}" for n in (1, 2, 3)]
    assert bench.arm().run().phase == Phase.ARMED
    assert bench.run().phase == Phase.COMPLETE


@pytest.mark.parametrize("codes", [(), ("too_weak",)])
def test_one_run_is_one_run(codes: tuple[str, ...]) -> None:
    bench = Bench().arm(Until.RUN)
    bench.bump()
    assert bench.end(*codes).phase == (Phase.REJECTED if codes else Phase.ACCEPTED)
    assert bench.turn(3.0).phase == Phase.IDLE


def test_until_complete_goes_on_whatever_is_rejected() -> None:
    bench = Bench().arm(Until.COMPLETE)
    for _ in range(5):
        assert bench.run("too_weak").phase == Phase.ARMED
    for _ in range(3):
        assert bench.run().phase == Phase.ARMED
    assert bench.run().phase == Phase.COMPLETE
    assert bench.loop.halted == ""


def test_three_like_rejects_in_a_row_halt_it() -> None:
    bench = Bench().arm()
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


def test_what_a_person_rejects_does_not_halt_it() -> None:
    bench = Bench().arm()
    for _ in range(4):
        label = bench.bump()
        bench.end()
        assert bench.decide(Code.REJECT, label).phase == Phase.REJECTED
        assert bench.turn(3.0).phase == Phase.ARMED


def test_a_verdict_within_the_countdown_counts_and_gives_the_time_anew() -> None:
    bench = Bench().arm()
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


def test_a_run_rejected_while_it_is_recorded_stays_rejected() -> None:
    bench = Bench().arm()
    label = bench.bump()
    bench.decide(Code.REJECT, label)
    assert bench.phase == Phase.TRIGGERED
    assert bench.end().phase == Phase.REJECTED


@pytest.mark.parametrize(
    ("until", "seconds"),
    [
        (Until.RUN, [None, None, None]),
        (Until.EXCITATION, [3.0, None, 3.0]),
        (Until.COMPLETE, [3.0, 3.0, 3.0]),
    ],
)
def test_seconds_are_counted_only_to_a_run_that_arms_itself(
    until: Until, seconds: list[float | None]
) -> None:
    """Two bounces and a roll: before the roll a person moves the boards, unless all are armed."""
    bench, counted = Bench(), list[float | None]()
    for _ in range(3):
        if bench.phase == Phase.IDLE:
            bench.arm(until)
        bench.bump()
        counted.append(bench.end().countdown_s)
        bench.turn(3.0)
    assert counted == seconds


def test_a_pause_lets_the_run_end_and_then_counts_no_bump() -> None:
    bench = Bench().arm()
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
    bench = Bench().arm()
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
    bench = Bench().arm().run().run()
    bench.arm()
    assert bench.phase == Phase.ARMED
    assert bench.decide(Code.REJECT, "baseline_bounce_1").phase == Phase.IDLE


def test_a_complete_campaign_can_be_taken_up_again() -> None:
    bench = Bench().arm(Until.COMPLETE)
    for _ in range(4):
        bench.run()
    assert bench.phase == Phase.COMPLETE
    assert bench.arm().phase == Phase.COMPLETE
    assert bench.decide(Code.REJECT, "baseline_roll_2").phase == Phase.IDLE
    assert bench.decide(Code.UNDO).phase == Phase.COMPLETE
    bench.add(entry(Code.CHOOSE, bench.t_ns, mass_state="baseline", excitation="bounce"))
    bench.loop.choose(bench.now)
    assert bench.phase == Phase.IDLE
    assert bench.arm().run().phase == Phase.COMPLETE


def test_a_clock_set_back_does_not_stretch_the_countdown() -> None:
    bench = Bench().arm()
    bench.bump()
    bench.end()
    bench.turn(-3600.0)
    assert bench.phase == Phase.ACCEPTED
    assert bench.turn(3.0).phase == Phase.ARMED


def test_the_runs_of_each_kind_are_counted_and_the_next_one_is_due() -> None:
    planned = replace(small_bench(), campaign=Campaign((BOUNCE, ROLL), 1))
    weak = LoggedRun("baseline_bounce_1", BASELINE, BOUNCE, 1, 5, LoggedStatus.REJECTED)
    good = replace(weak, label="baseline_bounce_2", repeat=2, status=LoggedStatus.ACCEPTED)
    beyond = replace(weak, label="baseline_warp_1", excitation=Excitation.WARP)
    log = RunLog((weak, good, beyond))
    tallies = tallies_of(planned, log)
    counts = [(*t.kind, t.accepted, t.planned, t.rejected) for t in tallies]
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
