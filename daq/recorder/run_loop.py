"""Implements the run loop: armed, bump, decay, verdict, next run; without a clock.

Time is that of the frames: a replay at twenty times the speed has the same phases.  The verdicts
are in the run log; the loop has only its phase and the extent of the last order to arm.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..bench.campaign import Step, instruction
from ..bench.config import Bench
from ..control.messages import Due, Phase, Tally
from ..control.orders import Until
from ..runlog.run_log import LoggedRun, LoggedStatus, RunLog, next_step
from ..runs import Excitation

LIKE_REJECTS = 3
"""Consecutive runs rejected for the same reason after which the loop stops for a person."""


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
    """Duration of a bump, s."""
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
        self._kind: tuple[str, Excitation] | None = None  # due when the loop was armed
        self._runs_before = 0  # when the loop was armed: earlier rejects do not halt it

    @property
    def running(self) -> bool:
        """True while a run is being recorded."""
        return self.phase in (Phase.TRIGGERED, Phase.DECAY)

    def countdown_s(self, now: Surroundings) -> float | None:
        """Return the time until the next run is armed, s; None if no run will be armed."""
        goes_on = self._until is Until.COMPLETE or (
            self._until is Until.EXCITATION and now.kind == self._kind
        )
        if not self._is_judged or now.due is None or not goes_on:
            return None
        return max(now.accept_after_s - (now.t_ns - self.since_ns) * 1e-9, 0.0)

    def arm(self, until: Until, now: Surroundings) -> None:
        """Arm; this does not interrupt a run or a countdown."""
        self.halted = ""
        if now.due is None:
            self.phase, self._until = Phase.COMPLETE, None
            return
        self._until, self._kind, self._runs_before = until, now.kind, len(now.run_log.runs)
        if not self.running and self.phase not in (Phase.WAITING, Phase.ARMED):
            self.label = ""
            self._enter(Phase.WAITING, now.t_ns)

    def pause(self, now: Surroundings) -> None:
        """Pause; a run that is being recorded is completed."""
        self._until, self.halted = None, ""
        if not self.running:
            self._enter(Phase.PAUSED, now.t_ns)

    def choose(self, now: Surroundings) -> None:
        """Continue after the choice of a step."""
        if self.phase is Phase.COMPLETE:
            self._enter(Phase.IDLE, now.t_ns)
        self._stop_before_other_kind(now)

    def turn(self, now: Surroundings) -> None:
        """Continue after time has passed."""
        age_s = (now.t_ns - self.since_ns) * 1e-9
        if age_s < 0 and not self.running:  # the clock was set back
            self.since_ns = now.t_ns
        if self.phase is Phase.TRIGGERED and age_s >= now.bump_s:
            self.phase = Phase.DECAY
        if self._is_judged and age_s >= now.accept_after_s:
            self._end_countdown(now)
        if self.phase is Phase.WAITING and now.ready:
            self._enter(Phase.ARMED, now.t_ns)
        elif self.phase is Phase.ARMED and not now.ready:
            self._enter(Phase.WAITING, now.t_ns)

    def bump(self, label: str, bump_ns: int) -> None:
        """Begin to record a run."""
        self.label = label
        self._enter(Phase.TRIGGERED, bump_ns)

    def judge(self, now: Surroundings) -> None:
        """Continue after the verdict on the run that was being recorded."""
        self._enter(self._verdict(now), now.t_ns)
        if self._until is not Until.COMPLETE:
            code = _like_rejects(now.run_log.runs[self._runs_before :])
            if code:
                self._enter(Phase.IDLE, now.t_ns)
                self._until, self.halted = None, code

    def decide(self, now: Surroundings) -> None:
        """Continue after a person's verdict, or after undoing or redoing one.

        A verdict on the last judged run restarts the countdown.  If the last run of a complete
        campaign is rejected, the campaign is no longer complete.
        """
        if self._is_judged and now.run_log.run(self.label) is not None:
            if self._verdict(now) is not self.phase:
                self._enter(self._verdict(now), now.t_ns)
        elif self.phase is Phase.COMPLETE and now.due is not None:
            self._enter(Phase.IDLE, now.t_ns)
        elif now.due is None and not self.running:
            self._until = None
            self._enter(Phase.COMPLETE, now.t_ns)
        else:
            self._stop_before_other_kind(now)

    @property
    def _is_judged(self) -> bool:
        return self.phase in (Phase.ACCEPTED, Phase.REJECTED)

    def _verdict(self, now: Surroundings) -> Phase:
        run = now.run_log.run(self.label)
        accepted = run is not None and run.status is LoggedStatus.ACCEPTED
        return Phase.ACCEPTED if accepted else Phase.REJECTED

    def _end_countdown(self, now: Surroundings) -> None:
        if now.due is None:
            self._until = None
            self._enter(Phase.COMPLETE, now.t_ns)
        elif self._until is None:
            self._enter(Phase.PAUSED, now.t_ns)
        elif self._until is Until.RUN:
            self._until = None
            self._enter(Phase.IDLE, now.t_ns)
        else:
            self._enter(Phase.WAITING, now.t_ns)
            self._stop_before_other_kind(now)

    def _stop_before_other_kind(self, now: Surroundings) -> None:
        """Stop if it was not armed for the kind of bump that is due.

        A person has to move the boards first, and then arm again.
        """
        is_armed = self.phase in (Phase.WAITING, Phase.ARMED)
        if is_armed and now.kind != self._kind and self._until is not Until.COMPLETE:
            self._until = None
            self._enter(Phase.IDLE, now.t_ns)

    def _enter(self, phase: Phase, t_ns: int) -> None:
        self.phase, self.since_ns = phase, t_ns


def _like_rejects(runs: tuple[LoggedRun, ...]) -> str:
    """Return the code for which the last three runs were all rejected; empty if there is none."""
    last = runs[-LIKE_REJECTS:]
    codes = {
        run.failed.code
        if run.status is LoggedStatus.REJECTED and not run.by and run.failed is not None
        else ""
        for run in last
    }
    return codes.pop() if len(last) == LIKE_REJECTS and len(codes) == 1 else ""


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
            rejected=sum(run.status is LoggedStatus.REJECTED for run in run_log.of(*kind)),
        )
        for kind in kinds
    )


def due_of(bench: Bench, run_log: RunLog, tallies: tuple[Tally, ...]) -> Due | None:
    """Return the next step of a campaign; None when it is complete."""
    step = next_step(bench.campaign, run_log)
    if step is None:
        return None
    kind = (step.mass_state, step.excitation)
    counts = [(t.accepted, t.planned, t.rejected) for t in tallies if kind == t.kind]
    text = instruction(bench.campaign, step.excitation)
    return Due(step, *(counts[0] if counts else (0, 0, 0)), text)
