"""Implements the run loop: orders, armed, bump, decay, verdict, next run; without a clock.

Time is that of the frames: a replay at twenty times the speed has the same phases.  The verdicts
are in the run log; the loop has only its phase and the extent of the last order to arm.
"""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from dbc.frames import FrameBatch
from dbc.words import InputError, printable

from ..bench.campaign import Step, instruction
from ..bench.config import Bench, bench_codec, parse_bench
from ..check.check import check_bench
from ..control import messages
from ..control.messages import Due, Order, Phase, Reply, Tally, Until
from ..runlog import Code, LoggedRun, RunLog, entry, next_step
from ..runs import BASELINE, Event, Excitation, RunStatus
from ..samples.mapping import bench_mapping


@dataclass(frozen=True, slots=True)
class Surroundings:
    """State of the recorder on which the loop depends."""

    t_ns: int
    """Data time, ns."""
    ready: bool
    """True if the car is at rest and the pre-trigger is full."""
    run_log: RunLog
    due: Step | None
    """Next step of the campaign; None if it is complete."""
    bump_s: float
    """Duration of a bump as planned, s."""
    accept_after_s: float
    """Time that the operator has to reject a run, s."""

    @property
    def kind(self) -> tuple[str, Excitation] | None:
        """Mass state and excitation of the step that is due."""
        return (self.due.mass_state, self.due.excitation) if self.due else None


class RunLoop:
    """State of the run loop, at first that of a new recording."""

    def __init__(self) -> None:
        self.phase = Phase.IDLE
        self.since_ns = 0
        """Data time at which the phase began, ns."""
        self.label = ""
        """Label of the run being recorded, or judged last."""
        self.halted = ""
        """Code of the finding for which the loop stopped; empty if it did not."""
        self._until: Until | None = None  # None if the last order to arm is completed
        self._armed_kind: tuple[str, Excitation] | None = None  # due when the loop was armed
        self._runs_at_arming = 0  # number of runs: earlier rejects do not halt the loop

    @property
    def running(self) -> bool:
        """True while a run is being recorded."""
        return self.phase in (Phase.TRIGGERED, Phase.DECAY)

    def countdown_s(self, state: Surroundings) -> float | None:
        """Return the time until the next run is armed, s; None if no run will be armed."""
        is_continued = self._until is Until.COMPLETE or (
            self._until is Until.EXCITATION and state.kind == self._armed_kind
        )
        if not self._is_judged or state.due is None or not is_continued:
            return None
        return max(state.accept_after_s - (state.t_ns - self.since_ns) * 1e-9, 0.0)

    def arm(self, until: Until, state: Surroundings) -> None:
        """Arm at once, also during a countdown; a run that is being recorded goes on."""
        self.halted = ""
        if state.due is None:
            self.phase, self._until = Phase.COMPLETE, None
            return
        self._until, self._armed_kind = until, state.kind
        self._runs_at_arming = len(state.run_log.runs)
        if not self.running and self.phase not in (Phase.WAITING, Phase.ARMED):
            self.label = ""
            self._enter(Phase.WAITING, state.t_ns)

    def pause(self, state: Surroundings) -> None:
        """Pause; a run that is being recorded is completed."""
        self._until, self.halted = None, ""
        if not self.running:
            self._enter(Phase.PAUSED, state.t_ns)

    def choose(self, state: Surroundings) -> None:
        """Enter the phase after a person has chosen a step."""
        if self.phase is Phase.COMPLETE:
            self._enter(Phase.IDLE, state.t_ns)
        self._stop_before_other_kind(state)

    def turn(self, state: Surroundings) -> None:
        """Enter the next phase if it is time for it, or if the car has come to rest or moves."""
        age_s = (state.t_ns - self.since_ns) * 1e-9
        if age_s < 0 and not self.running:  # the clock was set back
            self.since_ns = state.t_ns
        if self.phase is Phase.TRIGGERED and age_s >= state.bump_s:
            self.phase = Phase.DECAY
        if self._is_judged and age_s >= state.accept_after_s:  # the countdown is over
            if state.due is None:
                self._until = None
                self._enter(Phase.COMPLETE, state.t_ns)
            elif self._until is None:
                self._enter(Phase.PAUSED, state.t_ns)
            else:
                self._enter(Phase.WAITING, state.t_ns)
                self._stop_before_other_kind(state)
        if self.phase is Phase.WAITING and state.ready:
            self._enter(Phase.ARMED, state.t_ns)
        elif self.phase is Phase.ARMED and not state.ready:
            self._enter(Phase.WAITING, state.t_ns)

    def bump(self, label: str, bump_ns: int) -> None:
        """Begin to record a run."""
        self.label = label
        self._enter(Phase.TRIGGERED, bump_ns)

    def judge(self, state: Surroundings) -> None:
        """Enter the phase after the verdict on the run that was being recorded."""
        self._enter(self._judged_phase(state), state.t_ns)
        # Three runs in a row that the recorder rejects for one reason: a person must find it.  A
        # loop armed for all runs together goes on: perhaps no person is at the car.
        last_runs = state.run_log.runs[self._runs_at_arming :][-3:]
        codes = {run.failed.code if run.failed and not run.by else "" for run in last_runs}
        alike = len(last_runs) == 3 and len(codes) == 1 and "" not in codes
        if alike and self._until is not Until.COMPLETE:
            self._enter(Phase.IDLE, state.t_ns)
            self._until, self.halted = None, codes.pop()

    def decide(self, state: Surroundings) -> None:
        """Enter the phase after a person's verdict, or after undoing or redoing one.

        A verdict on the last judged run restarts the countdown.  If the last run of a complete
        campaign is rejected, the campaign is no longer complete.
        """
        if self._is_judged and state.run_log.run(self.label) is not None:
            if self._judged_phase(state) is not self.phase:
                self._enter(self._judged_phase(state), state.t_ns)
        elif self.phase is Phase.COMPLETE and state.due is not None:
            self._enter(Phase.IDLE, state.t_ns)
        elif state.due is None and not self.running:
            self._until = None
            self._enter(Phase.COMPLETE, state.t_ns)
        else:
            self._stop_before_other_kind(state)

    @property
    def _is_judged(self) -> bool:
        return self.phase in (Phase.ACCEPTED, Phase.REJECTED)

    def _judged_phase(self, state: Surroundings) -> Phase:
        """Return the phase after the verdict that the log has on the last run."""
        run = state.run_log.run(self.label)
        accepted = run is not None and run.status is RunStatus.ACCEPTED
        return Phase.ACCEPTED if accepted else Phase.REJECTED

    def _stop_before_other_kind(self, state: Surroundings) -> None:
        """Stop if it was not armed for the kind of bump that is due.

        A person has to move the boards first, and then arm again.
        """
        is_armed = self.phase in (Phase.WAITING, Phase.ARMED)
        if is_armed and state.kind != self._armed_kind and self._until is not Until.COMPLETE:
            self._until = None
            self._enter(Phase.IDLE, state.t_ns)

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase, self.since_ns = phase, t_ns


# Counts the runs of a campaign --------------------------------------------------------------------


def tallies_of(bench: Bench, run_log: RunLog) -> tuple[Tally, ...]:
    """Return the numbers of runs of each kind, with the kinds of the campaign first."""
    planned = [(step.mass_state, step.excitation) for step in bench.campaign.steps]
    kinds = dict.fromkeys([*planned, *((r.mass_state, r.excitation) for r in run_log.runs)])
    return tuple(
        Tally(
            *kind,
            accepted=run_log.accepted(*kind),
            planned=bench.campaign.repeats if kind in planned else 0,
            rejected=sum(run.status is RunStatus.REJECTED for run in run_log.of(*kind)),
        )
        for kind in kinds
    )


def due_of(bench: Bench, run_log: RunLog, tallies: tuple[Tally, ...]) -> Due | None:
    """Return the next step of a campaign; None when it is complete."""
    step = next_step(bench.campaign, run_log)
    if step is None:
        return None
    counts = {(t.mass_state, t.excitation): (t.accepted, t.planned, t.rejected) for t in tallies}
    of_step = counts.get((step.mass_state, step.excitation), (0, 0, 0))
    return Due(step, *of_step, instruction(bench.campaign, step.excitation))


# Converts orders to events of the run log, or refuses them in one line for a person ---------------


class OrderError(Exception):
    """An order that cannot be carried out now; the text is one line for a person."""


def order_event(
    order: Order, by: str, t_ns: int, run_log: RunLog, bench: Bench, due: Step | None
) -> Event | None:
    """Return the event of an order on the runs; None if the order has no event.

    `by`: name of its sender.  `t_ns`: data time.  `due`: next step of the campaign.
    Raises OrderError if the order is not possible now.
    """
    match order:
        case messages.Arm():
            if due is None:
                raise OrderError("the campaign is complete: choose a run first")
            is_confirmed = order.mass_state == due.mass_state or order.until is Until.COMPLETE
            is_reloaded = bool(run_log.runs) and run_log.runs[-1].mass_state != due.mass_state
            if is_reloaded and not is_confirmed:
                weights = "weights off" if due.mass_state == BASELINE else "weights on"
                state = printable(due.mass_state, 40)
                raise OrderError(
                    f"{weights}? the next run is of the car in state {state}: look at the car, "
                    f'then arm with "mass_state": "{state}"'
                )
            return Event(t_ns, "arm", text=f"{order.until} {by}")
        case messages.Pause():
            return Event(t_ns, "pause", text=by)
        case messages.Accept() | messages.Reject():
            run, accepts = _judged(run_log, order.label), isinstance(order, messages.Accept)
            if run.status is (RunStatus.ACCEPTED if accepts else RunStatus.REJECTED):
                raise OrderError(f"{run.label} is already {run.status}")
            if accepts and not order.reason:
                raise OrderError(f"{run.label} was rejected: give the reason why it should be used")
            code = Code.ACCEPT if accepts else Code.REJECT
            return entry(code, t_ns, label=run.label, by=by, reason=_clean(order.reason))
        case messages.Undo():
            if not run_log.done:
                raise OrderError("there is no verdict to undo")
            return Event(t_ns, Code.UNDO, text=by)
        case messages.Redo():
            if not run_log.undone:
                raise OrderError("there is nothing to redo")
            return Event(t_ns, Code.REDO, text=by)
        case messages.Choose():
            states = [state.name for state in bench.mass_states]
            if order.mass_state not in states:
                raise OrderError(f"{order.mass_state!r} is not a mass state: {', '.join(states)}")
            if run_log.open is not None:
                raise OrderError(f"{run_log.open.label} is being recorded: wait for its end")
            kind = str(order.excitation)
            return entry(Code.CHOOSE, t_ns, mass_state=order.mass_state, excitation=kind)
        case messages.Mark():
            return Event(t_ns, Code.MARK, text=_clean(order.text))
        case messages.Note():
            if order.label:
                _logged(run_log, order.label)
            return entry(Code.NOTE, t_ns, text=_clean(order.text), label=order.label, by=by)
        case messages.OverrideWarning():
            subject, reason = _clean(order.subject), _clean(order.reason)
            return entry(Code.OVERRIDE, t_ns, subject=subject, reason=reason, by=by)
        case messages.Configure():
            return Event(t_ns, Code.BENCH, text=order.bench_text)
    return None


def _clean(text: str) -> str:
    """Return a person's text without control characters, line by line.

    Terminals, reports and session files would be disturbed by them or refuse them.
    """
    return "\n".join(printable(line, len(text) * 10) for line in text.split("\n"))


def _logged(run_log: RunLog, label: str) -> LoggedRun:
    """Return the run of a label; without one, the open or else the last; OrderError if none."""
    last = run_log.runs[-1] if run_log.runs else None
    run = run_log.run(label) if label else run_log.open or last
    if run is None:
        raise OrderError(f"there is no run {label!r}" if label else "there is no run yet")
    return run


def _judged(run_log: RunLog, label: str) -> LoggedRun:
    """Return the run of a label, as `_logged`, which is not being recorded any more."""
    run = _logged(run_log, label)
    if run.status is RunStatus.OPEN:
        raise OrderError(f"{run.label} is being recorded: wait for its end")
    return run


def configured(old: Bench, text: str) -> Bench:
    """Return the bench of a new bench.toml, with the present buses and DBC.

    Raises OrderError if it cannot be used, or needs another bus or DBC.
    """
    try:
        bench = parse_bench(text, "bench.toml", Path(), old.dbc_text)
        bench_mapping(bench, bench_codec(bench))
        unchanged = parse_bench(old.text, "bench.toml", Path(), old.dbc_text)
    except InputError as error:
        raise OrderError(str(error)) from error
    # The present buses may come from the command line, so the two files are compared.
    if bench.buses != unchanged.buses:
        raise OrderError("bench.toml names other buses: end the recorder and start it with them")
    if bench.dbc_name != unchanged.dbc_name:
        raise OrderError("bench.toml names another DBC: end the recorder and start it with it")
    return replace(bench, buses=old.buses, dbc_name=old.dbc_name, origin=old.origin)


def answer_check(bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
    """Check the bench with the last frames, and set the answer."""
    try:
        report = check_bench(bench, bench_codec(bench), frames, date.today())
        answer.set_result(Reply(check=report.lines))
    except Exception as error:  # any exception is reported to the client
        answer.set_exception(error)
