"""Counts the runs of a campaign for the status of a recorder."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..bench.campaign import Step, instruction
from ..bench.config import Bench
from ..control.messages import Due, Phase, Tally
from ..control.orders import Until
from ..runlog.run_log import LoggedRun, LoggedStatus, RunLog, next_step
from ..runs import Excitation


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of the run log, kept until the log changes, because it may have thousands of runs."""

    due: Due | None
    """The next step; None when the campaign is complete."""
    tallies: tuple[Tally, ...]
    """Numbers of runs of each kind, with the kinds of the campaign first."""


def counts_of(bench: Bench, run_log: RunLog) -> Counts:
    """Count the runs of a run log."""
    kinds = [(step.mass_state, step.excitation) for step in bench.campaign.steps]
    kinds += [(run.mass_state, run.excitation) for run in run_log.runs]
    tallies = tuple(_tally(bench, run_log, kind) for kind in dict.fromkeys(kinds))
    step = next_step(bench.campaign, run_log)
    if step is None:
        return Counts(None, tallies)
    tally = _tally(bench, run_log, (step.mass_state, step.excitation))
    text = instruction(bench.campaign, step.excitation)
    return Counts(Due(step, tally.accepted, tally.planned, tally.rejected, text), tallies)


def _tally(bench: Bench, run_log: RunLog, kind: tuple[str, Excitation]) -> Tally:
    planned = {(step.mass_state, step.excitation) for step in bench.campaign.steps}
    rejected = sum(run.status is LoggedStatus.REJECTED for run in run_log.of(*kind))
    repeats = bench.campaign.repeats if kind in planned else 0
    return Tally(*kind, run_log.accepted(*kind), repeats, rejected)


# Implements the run loop: armed, bump, decay, verdict, next run, as a fold without a clock --------
#
# Time is that of the frames: a replay at twenty times the speed has the same phases.  The verdicts
# are in the run log; the loop has only its phase and the extent of the last order to arm.

LIKE_REJECTS = 3
"""Consecutive runs rejected for the same reason after which the loop stops for a person."""

_RUNNING = (Phase.TRIGGERED, Phase.DECAY)
_JUDGED = (Phase.ACCEPTED, Phase.REJECTED)


@dataclass(frozen=True, slots=True)
class LoopState:
    """State of the run loop; the default is that of a new recording."""

    phase: Phase = Phase.IDLE
    since_ns: int = 0
    """Data time at which the phase began, ns."""
    until: Until | None = None
    """Extent of the order to arm; None if it is completed."""
    kind: tuple[str, Excitation] | None = None
    """Mass state and excitation that were due when the loop was armed."""
    runs_before: int = 0
    """Number of runs when the loop was armed: earlier rejects do not halt it."""
    label: str = ""
    """Label of the run being recorded, or judged last."""
    halted: str = ""
    """Code of the finding for which the loop stopped; empty if it did not."""

    @property
    def running(self) -> bool:
        """True while a run is being recorded."""
        return self.phase in _RUNNING

    @property
    def takes_bumps(self) -> bool:
        """True if the next bump counts as a run."""
        return self.phase is Phase.ARMED

    def goes_on(self, due: Step | None) -> bool:
        """Return True if the due step is one of those for which the loop was armed."""
        if due is None or self.until in (None, Until.RUN):
            return False
        return self.until is Until.COMPLETE or (due.mass_state, due.excitation) == self.kind

    def countdown_s(self, t_ns: int, accept_after_s: float, due: Step | None) -> float | None:
        """Return the time until the next run is armed, s; None if no run will be armed."""
        if self.phase not in _JUDGED or not self.goes_on(due):
            return None
        return max(accept_after_s - (t_ns - self.since_ns) * 1e-9, 0.0)


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


def armed(state: LoopState, until: Until, now: Surroundings) -> LoopState:
    """Return the loop after an order to arm, which does not interrupt a run or a countdown."""
    if now.due is None:
        return replace(state, phase=Phase.COMPLETE, until=None, halted="")
    kind = (now.due.mass_state, now.due.excitation)
    state = replace(state, until=until, kind=kind, runs_before=len(now.run_log.runs), halted="")
    if state.running or state.phase in (Phase.WAITING, Phase.ARMED):
        return state
    return _entered(replace(state, label=""), Phase.WAITING, now.t_ns)


def paused(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop after an order to pause; a run that is being recorded is completed."""
    state = replace(state, until=None, halted="")
    return state if state.running else _entered(state, Phase.PAUSED, now.t_ns)


def chosen(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop after the choice of a step."""
    if state.phase is Phase.COMPLETE:
        return _entered(state, Phase.IDLE, now.t_ns)
    return _stopped_if_other_kind(state, now)


def turned(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop after time has passed."""
    age_s = (now.t_ns - state.since_ns) * 1e-9
    if age_s < 0 and not state.running:  # the clock was set back
        state = replace(state, since_ns=now.t_ns)
    if state.phase is Phase.TRIGGERED and age_s >= now.bump_s:
        return replace(state, phase=Phase.DECAY)
    if state.phase in _JUDGED and age_s >= now.accept_after_s:
        state = _after(state, now)
    if state.phase is Phase.WAITING and now.ready:
        return _entered(state, Phase.ARMED, now.t_ns)
    if state.phase is Phase.ARMED and not now.ready:
        return _entered(state, Phase.WAITING, now.t_ns)
    return state


def bumped(state: LoopState, label: str, bump_ns: int) -> LoopState:
    """Return the loop after the bump of a run."""
    return replace(_entered(state, Phase.TRIGGERED, bump_ns), label=label)


def judged(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop after the verdict on the run that was being recorded."""
    run = now.run_log.run(state.label)
    accepted = run is not None and run.status is LoggedStatus.ACCEPTED
    state = _entered(state, Phase.ACCEPTED if accepted else Phase.REJECTED, now.t_ns)
    if state.until is not Until.COMPLETE:
        code = like_rejects(now.run_log.runs[state.runs_before :])
        if code:
            return replace(_entered(state, Phase.IDLE, now.t_ns), until=None, halted=code)
    return state


def decided(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop after a person's verdict, or after undoing or redoing one.

    A verdict on the last judged run restarts the countdown.  If the last run of a complete campaign
    is rejected, the campaign is no longer complete.
    """
    run = now.run_log.run(state.label)
    if state.phase in _JUDGED and run is not None:
        accepted = run.status is LoggedStatus.ACCEPTED
        phase = Phase.ACCEPTED if accepted else Phase.REJECTED
        return state if phase is state.phase else _entered(state, phase, now.t_ns)
    if state.phase is Phase.COMPLETE and now.due is not None:
        return _entered(state, Phase.IDLE, now.t_ns)
    if now.due is None and not state.running:
        return _entered(replace(state, until=None), Phase.COMPLETE, now.t_ns)
    return _stopped_if_other_kind(state, now)


def like_rejects(runs: tuple[LoggedRun, ...]) -> str:
    """Return the code for which the last three runs were all rejected; empty if there is none."""
    last = runs[-LIKE_REJECTS:]
    codes = {_failing(run) for run in last}
    return codes.pop() if len(last) == LIKE_REJECTS and len(codes) == 1 else ""


def _failing(run: LoggedRun) -> str:
    if run.status is not LoggedStatus.REJECTED or run.by:
        return ""
    return run.failed.code if run.failed else ""


def _after(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop after the countdown."""
    if now.due is None:
        return _entered(replace(state, until=None), Phase.COMPLETE, now.t_ns)
    if state.until is None:
        return _entered(state, Phase.PAUSED, now.t_ns)
    if state.until is Until.RUN:
        return _entered(replace(state, until=None), Phase.IDLE, now.t_ns)
    return _stopped_if_other_kind(_entered(state, Phase.WAITING, now.t_ns), now)


def _stopped_if_other_kind(state: LoopState, now: Surroundings) -> LoopState:
    """Return the loop, stopped if it was not armed for the kind of bump that is due.

    A person has to move the boards first, and then arm again.
    """
    kind = (now.due.mass_state, now.due.excitation) if now.due else None
    armed_for_all = state.until is Until.COMPLETE
    if state.phase in (Phase.WAITING, Phase.ARMED) and kind != state.kind and not armed_for_all:
        return _entered(replace(state, until=None), Phase.IDLE, now.t_ns)
    return state


def _entered(state: LoopState, phase: Phase, t_ns: int) -> LoopState:
    return replace(state, phase=phase, since_ns=t_ns)
