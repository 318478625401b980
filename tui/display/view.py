"""The state that the page shows, as a pure function of the recorder's status.

The page decides nothing: it shows these words, and sounds when word or title change.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from daq import BASELINE
from daq.bench.campaign import Origin
from daq.control.messages import Arm, Order, Pause, Phase, Reject, Status
from daq.runs import RunStatus
from dbc.words import printable

from ..terminal.campaign import (
    BETWEEN_RUNS,
    cause_words,
    changed_weights,
    next_action,
    shown_obstacle,
    weights_question,
)
from ..terminal.feed import Lost
from ..terminal.words import (
    COMPLETE,
    HANDS_OFF,
    PAUSED,
    accepted_words,
    count_words,
    countdown_digits,
    due_words,
    halted_words,
    instruction_words,
    last_judged,
    reason_words,
    rejected_words,
    remaining_motion,
    run_words,
    seconds_since_bump,
    unarmed_words,
    waiting_words,
)

Kind = Literal[
    "wait", "bump", "hands-off", "accepted", "again", "ready", "paused", "step", "done", "stopped",
    "lost",
]  # fmt: skip
"""State of the page, which chooses colour, symbol and sound; `step`: the next one is done at the
terminal."""


@dataclass(frozen=True, slots=True)
class Headline:
    """The word that fills the screen, with its reason, digits and sound."""

    kind: Kind
    word: tuple[str, ...]
    """One or two words, on separate lines where the screen is narrow."""
    why: str
    """One line with the reason, or with what to do."""
    advice: str = ""
    """A second line: the remedy."""
    digits: str = ""
    """Seconds, to be read from a distance."""
    digits_are: str = ""
    share: float | None = None
    """Share of the decay that has passed, 0..1; None outside a decay."""


@dataclass(frozen=True, slots=True)
class AlarmLine:
    """The gravest alarm in words."""

    cue: str
    """Changes when another alarm comes."""
    text: str
    advice: str
    more: int
    """Number of further alarms."""


@dataclass(frozen=True, slots=True)
class Row:
    """Progress of one mass state and kind of bump."""

    mass_state: str
    kind: str
    """The kind of bump in words."""
    accepted: int
    planned: int
    rejected: int
    due: bool
    """True if the next run is one of these."""


_NEXT_WORDS = {Phase.PAUSED: "Go on", Phase.REJECTED: "Again now", Phase.ACCEPTED: "Next now"}


@dataclass(frozen=True, slots=True)
class Buttons:
    """Labels; an empty one is a button that does nothing now.

    The page sends the target of a button back with it, so that a late touch answers no other
    question than the one that was shown.
    """

    next: str = ""
    next_target: str = ""
    """The mass state whose weights the first button confirms; empty if it confirms none."""
    reject: str = ""
    reject_target: str = ""
    """Label of the run that the second button rejects."""
    pause: str = ""


@dataclass(frozen=True, slots=True)
class View:
    """Everything that the page shows, except curves."""

    headline: Headline
    title: str = ""
    """Mass state and run that are due, or the run that was judged."""
    instruction: str = ""
    """Instruction for the bump that is due."""
    rows: tuple[Row, ...] = ()
    """In the order of the campaign."""
    done: int = 0
    """Accepted runs, without those beyond the plan."""
    planned: int = 0
    alarm: AlarmLine | None = None
    overload: str = ""
    """Channels that reached the end of their range."""
    vehicle: str = ""
    mark: str = ""
    """`SIMULATED` or `REPLAYED`; empty for a real bus."""
    buttons: Buttons = Buttons()


def view(status: Status | None, lost: Lost | None) -> View:
    """Return what the page shows.

    `status`: the last one; None before the first.  `lost`: not None if the recorder does not
    answer.
    """
    connecting = Headline("wait", ("WAIT",), "waiting for the recorder")
    last_view = _view_of(status) if status is not None else View(connecting)
    if lost is None:
        return last_view
    text, advice = printable(lost.text, 200), printable(lost.advice, 200)
    loss = Headline("lost", ("RECORDER", "LOST"), text, advice)
    return replace(last_view, headline=loss, alarm=None, buttons=Buttons())


def _view_of(status: Status) -> View:
    """Return what the page shows of a recorder that answers."""
    due, run = status.due, last_judged(status)
    title = f"{due.step.mass_state}: {due_words(status)}" if due else ""
    if status.phase in (Phase.ACCEPTED, Phase.REJECTED) and run:
        title = f"{run.mass_state}: {run_words(run)}, {count_words(status, run)}"
    due_kind = (due.step.mass_state, due.step.excitation) if due else None
    rows = []
    for tally in status.tallies:
        mass_state, kind = printable(tally.mass_state, 20), tally.excitation.words
        is_due = due_kind == (tally.mass_state, tally.excitation)
        rows.append(Row(mass_state, kind, tally.accepted, tally.planned, tally.rejected, is_due))
    return View(
        headline(status),
        title=title,
        instruction=instruction_words(status),
        rows=tuple(rows),
        done=sum(min(row.accepted, row.planned) for row in rows),
        planned=sum(row.planned for row in rows),
        alarm=_alarm_line(status),
        overload=printable(", ".join(status.overloaded), 80),
        vehicle=printable(status.vehicle, 60),
        mark="" if status.origin is Origin.REAL else status.origin.upper(),
        buttons=buttons_of(status),
    )


def headline(status: Status) -> Headline:
    """Return the headline of a status: a stopping alarm first, a question next, then the phase."""
    if (alarm := shown_obstacle(status)) is not None:
        name, advice, _ = cause_words(alarm)
        return Headline("stopped", ("STOP",), name, advice)
    may_start = status.phase in (Phase.IDLE, Phase.PAUSED) and _next_arms(status)
    if may_start and (question := weights_question(status)):
        # The question that comes before the first run of another mass state, and its explanation.
        short_question, why = question.split("? ")
        words = tuple(f"{short_question}?".upper().split())
        advice = "Yes: the first button, or SPACE at the terminal."
        return Headline("step", words, why, advice)
    instruction = instruction_words(status)
    match status.phase:
        case Phase.WAITING:
            return Headline("wait", ("WAIT",), f"Hands off: {waiting_words(status)}")
        case Phase.ARMED:
            return Headline("bump", ("BUMP", "NOW"), instruction)
        case Phase.TRIGGERED | Phase.DECAY:
            return _hands_off_headline(status)
        case Phase.ACCEPTED | Phase.REJECTED:
            return _verdict_headline(status)
        case Phase.PAUSED:
            return Headline("paused", ("PAUSED",), PAUSED)
        case Phase.COMPLETE:
            return Headline("done", ("DONE",), COMPLETE)
    if status.halted:
        why, advice = halted_words(status.halted), "Remove the reason, then start again."
        return Headline("stopped", ("STOPPED",), why, advice)
    if (step := next_action(status).step) is not None:
        why = f"Go to the terminal: step {step.title}"
        return Headline("step", ("STEP", str(step.value)), why)
    return Headline("ready", ("READY",), instruction)


def _hands_off_headline(status: Status) -> Headline:
    """Return `HANDS OFF` with the time since the bump, and the share of its decay that is over."""
    why, decayed = HANDS_OFF, None
    if (remaining := remaining_motion(status)) is not None:
        why = f"Hands off. {remaining:.0%} of the peak left."
        decayed = round(1.0 - remaining, 2)
    digits, digits_are = seconds_since_bump(status) or "0.0", "seconds since the bump"
    return Headline("hands-off", ("HANDS", "OFF"), why, "", digits, digits_are, decayed)


def _verdict_headline(status: Status) -> Headline:
    """Return the word on the run that has just been judged."""
    run, digits = last_judged(status), countdown_digits(status)
    digits_are = "seconds to the next run" if digits else ""
    if status.phase is Phase.ACCEPTED:
        why, advice = accepted_words(status, run), unarmed_words(status)
        return Headline("accepted", ("ACCEPTED",), why, advice, digits, digits_are)
    why, advice = rejected_words(run) if run else ("", "")
    return Headline("again", ("AGAIN",), why, advice, digits, digits_are)


def _alarm_line(status: Status) -> AlarmLine | None:
    if not status.alarms:
        return None
    gravest, *others = status.alarms
    subject = f" {printable(gravest.subject, 60)}" if gravest.subject else ""
    return AlarmLine(
        cue=f"{gravest.code} {gravest.subject} {gravest.since_ns}",
        text=f"{reason_words(gravest.code).upper()}{subject}: {printable(gravest.text, 160)}",
        advice=printable(gravest.advice, 160),
        more=len(others),
    )


def buttons_of(status: Status) -> Buttons:
    """Return the labels of the buttons in a status."""
    last_run = status.runs[-1] if status.runs else None
    rejectable = last_run if last_run and last_run.status is not RunStatus.REJECTED else None
    start_words = mass_state = ""
    if _next_arms(status):
        start_words, mass_state = _NEXT_WORDS.get(status.phase, "Start"), changed_weights(status)
    if mass_state:
        start_words = f"Weights are {'off' if mass_state == BASELINE else 'on'}: start"
    return Buttons(
        next=start_words,
        next_target=mass_state,
        reject=f"Reject {run_words(rejectable)}" if rejectable else "",
        reject_target=rejectable.label if rejectable else "",
        pause="" if status.phase in BETWEEN_RUNS else "Pause",
    )


def order_of(button: str, target: str, status: Status) -> Order | None:
    """Return the order of a button; None if it does nothing now, or would have another target.

    `target`: what the page sent with the button, as in `Buttons`.
    """
    buttons = buttons_of(status)
    if button == "next" and buttons.next and target == buttons.next_target:
        return next_action(status).order
    if button == "reject" and buttons.reject and target == buttons.reject_target:
        return Reject(target)
    return Pause() if button == "pause" and buttons.pause else None


def _next_arms(status: Status) -> bool:
    """Return True if the next action is to arm a run."""
    return isinstance(next_action(status).order, Arm)
