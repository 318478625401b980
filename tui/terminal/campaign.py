"""The steps of a campaign, the alarm that is in the way, the next action of SPACE, and drafts."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

from daq import ADDED, BASELINE
from daq.control.messages import Alarm, Arm, Order, Phase, Status
from dbc.words import printable


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

    @property
    def screen(self) -> str:
        """Name of its screen; the steps with bumps share one."""
        return "home" if self in _WITH_BUMPS else self.name.lower()


_WITH_BUMPS = (BenchStep.BASELINE, BenchStep.ADDED)


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a campaign."""

    done: frozenset[BenchStep]
    due: BenchStep
    """The first step that is not done."""

    def reached(self, step: BenchStep) -> bool:
        """Return True if the operator may go to a step."""
        return step <= self.due or step in self.done


def bump_step(status: Status) -> BenchStep:
    """Return the step of the next bumps: with weights as soon as these are on the car."""
    baseline_due = status.due is not None and status.due.step.mass_state == BASELINE
    if baseline_due or not progress(status).reached(BenchStep.ADDED):
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
    for step, mass_state in ((BenchStep.BASELINE, BASELINE), (BenchStep.ADDED, ADDED)):
        if any(run.mass_state == mass_state for run in status.runs):
            done |= {earlier for earlier in BenchStep if earlier < step}
        tallies = [tally for tally in status.tallies if tally.mass_state == mass_state]
        if tallies and all(tally.accepted >= tally.planned for tally in tallies):
            done.add(step)
        else:
            done.discard(step)
    due = next((step for step in BenchStep if step not in done), BenchStep.REPORT)
    return Progress(frozenset(done), due)


def is_marked(status: Status, step: BenchStep) -> bool:
    """Return True if the operator has ended a step, steps 6 and 7 on the recording as it is now."""
    # Notes of persons, which may have the same text, have an author; marks have none.
    revisions = {note.text: note.revision for note in status.notes if not note.by}
    if step < BenchStep.IDENTIFY:
        return step.mark in revisions
    return revisions.get(step.mark) == status.revision


def in_first_runs(status: Status) -> bool:
    """Return True in a run before the baseline is complete, even if steps 1 and 2 are not done."""
    return in_run(status) and progress(status).due <= BenchStep.BASELINE


def in_run(status: Status) -> bool:
    """Return True from the order to arm until the run loop is idle or complete, also paused."""
    return status.phase not in (Phase.IDLE, Phase.COMPLETE)


_STORAGE_ALARMS = ("journal_failed", "not_recording")
"""Alarms during which frames are not stored."""
_BUS_ALARMS = (
    "disconnected",
    "bus_off",
    "interface_down",
    "bus_silent",
    "check_bitrate",
    "none_of_dbc",
    "stale",
)
"""Alarms that affect a run if sensors of the bench are silent."""
_LOSS_ALARMS = ("queue_dropped", "overrun", "bus_full", "counter_gap")
"""Alarms of lost frames."""

RUNNING = (Phase.TRIGGERED, Phase.DECAY)
"""Phases in which a run is recorded."""


def shown_obstacle(status: Status) -> Alarm | None:
    """Return the gravest alarm that would spoil the next run; it is shown instead of the state.

    Returns None while a run is recorded or its verdict is shown, and where no run is due.
    """
    # The countdown after an accepted run is measured by the frames: without any it never ends.
    shows_verdict = status.phase is Phase.REJECTED or (
        status.phase is Phase.ACCEPTED and not frames_stand_still(status)
    )
    if status.due is None or status.phase in RUNNING or shows_verdict:
        return None
    sensors_lack = status.sensors_alive < status.sensors_expected
    for alarm in status.alarms:  # the gravest first
        # Lost frames are counted over 1 s, and their alarm stays for 1.5 s more: after 3 s, frames
        # are lost still.
        lasts = status.wall_ns - alarm.since_ns >= 3_000_000_000
        if (
            alarm.code in _STORAGE_ALARMS
            or (alarm.code in _BUS_ALARMS and sensors_lack)
            or (alarm.code in _LOSS_ALARMS and lasts)
        ):
            return alarm
    return None


def frames_stand_still(status: Status) -> bool:
    """Return True if no sensor of the bench sends, so that the time in the frames stands still."""
    return status.sensors_expected > 0 and status.sensors_alive == 0


def cause_words(alarm: Alarm) -> tuple[str, str, str]:
    """Return the name of the cause with its subject, the advice as a sentence, and the details."""
    from daq.alarms.texts import EXPLAINED

    title = EXPLAINED[alarm.code].title if alarm.code in EXPLAINED else alarm.code
    name = f"{title.upper()}  {printable(alarm.subject, 40)}".rstrip()
    advice = printable(alarm.advice, 160)
    return name, f"{advice[:1].upper()}{advice[1:]}.", printable(alarm.text, 160)


BUSY = (Phase.WAITING, Phase.ARMED, *RUNNING)
"""Phases from the order to arm to the verdict."""
BETWEEN_RUNS = (Phase.IDLE, Phase.PAUSED, Phase.COMPLETE)
"""Phases that lead to no further run by themselves, and in which no bump counts."""


@dataclass(frozen=True, slots=True)
class NextAction:
    """Action of SPACE in steps 3 and 5."""

    words: str = ""
    """Text for the operator, such as `SPACE starts`; empty if there is no action now."""
    order: Order | None = None
    step: BenchStep | None = None
    """Step to go to instead of an order."""


def next_action(status: Status | None, in_control: bool = True) -> NextAction:
    """Return the next action; of a viewer (not `in_control`), to take control before an order."""
    if status is None or status.phase in BUSY:
        return NextAction()
    due_step = progress(status).due
    go_to_step = NextAction(f"SPACE = step {due_step.title}", step=due_step)
    # The operator has chosen a kind of bump whose planned runs are all accepted.
    beyond_plan = status.due is not None and status.due.accepted >= status.due.planned
    rejected_or_paused = status.phase in (Phase.PAUSED, Phase.REJECTED)
    if not beyond_plan and due_step not in _WITH_BUMPS and not rejected_or_paused:
        return go_to_step
    match status.phase:
        case Phase.PAUSED:
            words = "SPACE = go on"
        case Phase.REJECTED:
            words = "SPACE = again"
        case Phase.ACCEPTED if status.countdown_s is None:
            return NextAction()  # the boards must be moved: IDLE follows, and shows how
        case Phase.ACCEPTED:
            words = "SPACE = now"
        case _ if status.due is None:
            return go_to_step
        case _:
            kind = status.due.step.excitation.words
            words = f"SPACE = one more {kind}" if beyond_plan else "SPACE starts"
    if not in_control:
        return NextAction("C = take control")
    return NextAction(words, Arm(mass_state=changed_weights(status)))


def changed_weights(status: Status | None) -> str:
    """Return the mass state of the next run if the last one was of another; else empty."""
    if status is None or status.due is None or not status.runs:
        return ""
    due_state = status.due.step.mass_state
    return due_state if status.runs[-1].mass_state != due_state else ""


def weights_question(status: Status | None) -> str:
    """Return the question that comes before the first run of another mass state; else empty."""
    mass_state = changed_weights(status)
    if not mass_state:
        return ""
    if mass_state == BASELINE:
        return "Weights off? The next run is of the car as it is (baseline)."
    return f"Weights on? The next run is of the car with weights ({printable(mass_state, 40)})."


VEHICLE_FORM = "vehicle.json"
"""File of the applied vehicle form, in the recorder's folder."""


def read_draft(path: Path) -> dict[str, Any]:
    """Return the values of a stored form; empty if there is none that can be read."""
    try:
        form = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return form if isinstance(form, dict) else {}
