"""The seven steps of a campaign at the bench: which are reached, which is due."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from daq import ADDED, BASELINE, Status
from daq.control import Phase


class BenchStep(IntEnum):
    """The steps, by the key that jumps to them."""

    VEHICLE = 1
    CHECK = 2
    BASELINE = 3
    MASSES = 4
    ADDED = 5
    IDENTIFY = 6
    REPORT = 7

    @property
    def title(self) -> str:
        """`1 Vehicle` and the like."""
        return f"{self.value} {self.name.capitalize()}"

    @property
    def mark(self) -> str:
        """Mark in the recording with which a person confirms that the step is done."""
        return f"step {self.name.lower()} done"


SCREEN_OF = {
    BenchStep.VEHICLE: "vehicle",
    BenchStep.CHECK: "check",
    BenchStep.BASELINE: "home",
    BenchStep.MASSES: "masses",
    BenchStep.ADDED: "home",
    BenchStep.IDENTIFY: "identify",
    BenchStep.REPORT: "report",
}


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a campaign."""

    done: frozenset[BenchStep]
    """Finished steps."""
    due: BenchStep
    """The first step that is not done."""

    def reached(self, step: BenchStep) -> bool:
        """Return True if the operator may go to a step."""
        return step <= self.due or step in self.done


def bump_step(status: Status) -> BenchStep:
    """Return the step of the next bumps: with weights as soon as these are on the car."""
    due = status.due
    more_of_the_baseline = due is not None and due.step.mass_state == BASELINE
    if more_of_the_baseline or not progress(status).reached(BenchStep.ADDED):
        return BenchStep.BASELINE
    return BenchStep.ADDED


def progress(status: Status | None) -> Progress:
    """Return the progress of the recording from its log alone, also for a new terminal.

    A mark by a person ends the steps without bumps; accepted runs end the others.  A bump of a
    later step implies the earlier steps.  Identification and report must be repeated when runs,
    weights or vehicle have changed since.
    """
    if status is None:
        return Progress(frozenset(), BenchStep.VEHICLE)
    done = {step for step in BenchStep if is_marked(status, step)}
    for step, state in ((BenchStep.BASELINE, BASELINE), (BenchStep.ADDED, ADDED)):
        if any(run.mass_state == state for run in status.runs):
            done |= {before for before in BenchStep if before < step and before.mark}
        tallies = [tally for tally in status.tallies if tally.mass_state == state]
        if tallies and all(tally.accepted >= tally.planned for tally in tallies):
            done.add(step)
        else:
            done.discard(step)
    due = next((step for step in BenchStep if step not in done), BenchStep.REPORT)
    return Progress(frozenset(done), due)


def is_marked(status: Status, step: BenchStep) -> bool:
    """Return True if the operator has ended a step and the recording has not changed since."""
    marks = {note.text: note.revision for note in status.notes if not note.by}
    if step < BenchStep.IDENTIFY:
        return step.mark in marks
    return marks.get(step.mark) == status.revision


def waits_unarmed(status: Status) -> bool:
    """Return True if the recorder waits for a first bump that no terminal has armed."""
    return in_run(status) and progress(status).due <= BenchStep.BASELINE


def in_run(status: Status) -> bool:
    """Return True if the recorder waits for a bump or follows one."""
    return status.phase not in (Phase.IDLE, Phase.COMPLETE)
