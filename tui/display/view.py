"""The state that the page shows, as a pure function of the recorder's status.

The page decides nothing: it shows these words, and speaks or sounds when `cue` changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from daq import BASELINE, Excitation
from daq.bench.campaign import Method, Origin
from daq.bumps import BUMPS
from daq.control.messages import Phase, Status
from daq.control.orders import Arm, Order, Pause, Reject
from daq.errors import printable
from daq.runlog import LoggedRun, LoggedStatus

from ..terminal.state.campaign import (
    BUSY,
    cause_words,
    changed_weights,
    first_obstacle,
    next_action,
    weights_question,
)
from ..terminal.state.feed import Lost
from ..terminal.state.words import (
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
    run_words,
    waiting_words,
)

if TYPE_CHECKING:
    from daq.bench.config import Bench


class Kind(StrEnum):
    """State of the page; chooses colour, symbol and sound."""

    WAIT = "wait"
    BUMP = "bump"
    HANDS_OFF = "hands-off"
    ACCEPTED = "accepted"
    AGAIN = "again"
    READY = "ready"
    PAUSED = "paused"
    STEP = "step"
    """The next step is done at the terminal."""
    DONE = "done"
    STOPPED = "stopped"
    LOST = "lost"


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
    """Seconds, to be read from a distance; may be empty."""
    digits_are: str = ""
    """Meaning of the digits."""
    share: float | None = None
    """Share of the decay that has passed, 0..1; None outside a decay."""
    cue: str = ""
    """Changes when sound and speech are due."""
    speech: str = ""
    """Sentence to speak; empty for none."""


@dataclass(frozen=True, slots=True)
class AlarmLine:
    """The gravest alarm in words."""

    cue: str
    """Changes when another alarm comes."""
    text: str
    advice: str
    more: int
    """Number of further alarms."""
    speech: str
    """Sentence to speak."""


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


@dataclass(frozen=True, slots=True)
class Sketch:
    """The boards to place, or where to push, on the car seen from above."""

    method: Method
    wheels: tuple[bool, bool, bool, bool]
    """Wheels with a board or block, in the order of `Corner`; none for a push."""
    hand: tuple[int, int] | None
    """Place where hands push, forward and to the left of the body's middle; None without a push."""
    legend: str
    """Text of the sketch: the board or block, with its height."""


NEXT, REJECT, PAUSE = "next", "reject", "pause"
_RUNNING = (*BUSY, Phase.ACCEPTED, Phase.REJECTED)
_NEXT_WORDS = {Phase.PAUSED: "Go on", Phase.REJECTED: "Again now", Phase.ACCEPTED: "Next now"}


@dataclass(frozen=True, slots=True)
class Buttons:
    """Labels; an empty one is a button that does nothing now."""

    next: str = ""
    """Label of the first button."""
    next_label: str = ""
    """Mass state that the first button confirms: the page sends it back, so that a late touch
    cannot answer another question."""
    reject: str = ""
    """Label of the second button."""
    reject_label: str = ""
    """Label of the run that the second button rejects: the page sends it back, so that a late touch
    cannot reject another run."""
    pause: str = ""
    """Label of the third button."""


NO_BUTTONS = Buttons()
"""Without a status, no button does anything."""


@dataclass(frozen=True, slots=True)
class View:
    """Everything that the page shows, except curves."""

    headline: Headline
    title: str = ""
    """Mass state and run that are due, or the run that was judged."""
    instruction: str = ""
    """Instruction for the bump that is due."""
    sketch: Sketch | None = None
    """Sketch of the bump that is due; None if none is, or bench.toml is not known yet."""
    rows: tuple[Row, ...] = ()
    """Progress of each mass state and kind of bump, in the order of the campaign."""
    done: int = 0
    """Number of accepted runs among the planned ones."""
    planned: int = 0
    """Number of planned runs of the campaign."""
    alarm: AlarmLine | None = None
    """The gravest alarm."""
    overload: str = ""
    """Channels that reached the end of their range."""
    vehicle: str = ""
    """Name of the vehicle."""
    mark: str = ""
    """`SIMULATED` or `REPLAYED`; empty for a real bus."""
    buttons: Buttons = NO_BUTTONS
    """Labels of the three buttons."""


_CONNECTING = Headline(Kind.WAIT, ("WAIT",), "waiting for the recorder")


def view(status: Status | None, lost: Lost | None, bench: Bench | None) -> View:
    """Return what the page shows.

    `status`: the last one; None before the first.  `lost`: not None if the recorder does not
    answer.  `bench`: None while it is not known.
    """
    shown = _view(status, bench) if status is not None else View(_CONNECTING)
    if lost is None:
        return shown
    gone = Headline(
        Kind.LOST,
        ("RECORDER", "LOST"),
        printable(lost.text, 200),
        printable(lost.advice, 200),
        cue="lost",
        speech="Recorder lost. Go to the terminal.",
    )
    return replace(shown, headline=gone, alarm=None, buttons=NO_BUTTONS)


def _view(status: Status, bench: Bench | None) -> View:
    due = status.due
    rows = rows_of(status)
    return View(
        headline(status),
        title=_title(status),
        instruction=instruction_words(status),
        sketch=sketch_of(bench, due.step.excitation) if bench and due else None,
        rows=rows,
        done=sum(min(row.accepted, row.planned) for row in rows),
        planned=sum(row.planned for row in rows),
        alarm=alarm_line(status),
        overload=printable(", ".join(status.overloaded), 80),
        vehicle=printable(status.vehicle, 60),
        mark="" if status.origin is Origin.REAL else status.origin.upper(),
        buttons=buttons_of(status),
    )


def headline(status: Status) -> Headline:
    """Return the word of a status."""
    if (alarm := first_obstacle(status)) is not None:
        name, advice, _ = cause_words(alarm)
        cue, speech = f"stop {alarm.code} {alarm.subject}", f"Stop. {name.capitalize()}. {advice}"
        return Headline(Kind.STOPPED, ("STOP",), name, advice, cue=cue, speech=speech)
    arms = status.phase in (Phase.IDLE, Phase.PAUSED) and next_action(status).order is not None
    if arms and (question := weights_question(status)):
        return _weights(question)
    label = status.due.step.label if status.due else ""
    match status.phase:
        case Phase.WAITING:
            why = f"Hands off: {waiting_words(status)}"
            return Headline(Kind.WAIT, ("WAIT",), why, cue=f"wait {label}")
        case Phase.ARMED:
            speech = f"Bump now. {due_words(status).capitalize()}."
            return Headline(
                Kind.BUMP,
                ("BUMP", "NOW"),
                instruction_words(status),
                cue=f"bump {label}",
                speech=speech,
            )
        case Phase.TRIGGERED | Phase.DECAY:
            return _hands_off(status)
        case Phase.ACCEPTED:
            return _accepted(status)
        case Phase.REJECTED:
            return _again(status)
        case Phase.PAUSED:
            return Headline(Kind.PAUSED, ("PAUSED",), PAUSED, cue="paused", speech="Paused.")
        case Phase.COMPLETE:
            return Headline(Kind.DONE, ("DONE",), COMPLETE, cue="done", speech=COMPLETE)
    if status.halted:
        why = halted_words(status.halted)
        advice = "Remove the reason, then start again."
        speech = f"Stopped, after {why}."
        return Headline(Kind.STOPPED, ("STOPPED",), why, advice, cue="stopped", speech=speech)
    if (step := next_action(status).step) is not None:
        why = f"Go to the terminal: step {step.title}"
        return Headline(
            Kind.STEP,
            ("STEP", str(step.value)),
            why,
            cue=f"step {step.value}",
            speech=f"Go to the terminal, for step {step.title}.",
        )
    return Headline(Kind.READY, ("READY",), instruction_words(status), cue=f"ready {label}")


def _weights(question: str) -> Headline:
    """Return the question that comes before the first run of another mass state."""
    word, why = question.split("? ")
    return Headline(
        Kind.STEP,
        tuple(f"{word}?".upper().split()),
        why,
        "Yes: the first button, or SPACE at the terminal.",
        cue=f"weights {word}",
        speech=question,
    )


def _hands_off(status: Status) -> Headline:
    seconds = max(0.0, (status.t_ns - status.bump_ns) * 1e-9) if status.bump_ns else 0.0
    left = status.peak_left
    why = HANDS_OFF if left is None else f"Hands off. {min(left, 1.0):.0%} of the peak left."
    running = next((r.label for r in status.runs if r.status is LoggedStatus.OPEN), "")
    return Headline(
        Kind.HANDS_OFF,
        ("HANDS", "OFF"),
        why,
        digits=f"{seconds:.1f}",
        digits_are="seconds since the bump",
        share=None if left is None else round(1.0 - min(max(left, 0.0), 1.0), 2),
        cue=f"hands off {running}",
        speech="Hands off.",
    )


def _accepted(status: Status) -> Headline:
    run = last_judged(status)
    what = f"{run_words(run)}, {count_words(status, run)}" if run else ""
    digits = countdown_digits(status)
    return Headline(
        Kind.ACCEPTED,
        ("ACCEPTED",),
        accepted_words(run),
        "" if digits else "The last of its kind.",
        digits,
        "seconds to the next run" if digits else "",
        cue=f"accepted {run.label if run else ''}",
        speech=f"Accepted. {what.capitalize()}.",
    )


def _again(status: Status) -> Headline:
    run = last_judged(status)
    why, advice = rejected_words(run) if run else ("", "")
    digits = countdown_digits(status)
    return Headline(
        Kind.AGAIN,
        ("AGAIN",),
        why,
        advice,
        digits,
        "seconds to the next run" if digits else "",
        cue=f"again {run.label if run else ''}",
        speech=f"Again. {_spoken_reason(run)} {advice}".strip(),
    )


def _spoken_reason(run: LoggedRun | None) -> str:
    """Return the reason of a rejection without figures, which are hard to understand by ear."""
    if run is None:
        return ""
    if run.by:
        return "Rejected by hand."
    return f"{reason_words(run.failed.code).capitalize()}." if run.failed else ""


def _title(status: Status) -> str:
    if status.phase in (Phase.ACCEPTED, Phase.REJECTED) and (run := last_judged(status)):
        return f"{run.mass_state}: {run_words(run)}, {count_words(status, run)}"
    return f"{status.due.step.mass_state}: {due_words(status)}" if status.due else ""


def alarm_line(status: Status) -> AlarmLine | None:
    """Return the gravest alarm of a status; None if there is none."""
    if not status.alarms:
        return None
    first, *others = status.alarms
    subject = f" {printable(first.subject, 60)}" if first.subject else ""
    what = f"{reason_words(first.code)}{subject}"
    return AlarmLine(
        f"{first.code} {first.subject} {first.since_ns}",
        f"{reason_words(first.code).upper()}{subject}: {printable(first.text, 160)}",
        printable(first.advice, 160),
        len(others),
        f"Alarm: {what}.",
    )


def rows_of(status: Status) -> tuple[Row, ...]:
    """Return the progress of a campaign."""
    step = status.due.step if status.due else None
    here = (step.mass_state, step.excitation) if step else None
    return tuple(
        Row(
            printable(tally.mass_state, 20),
            tally.excitation.words,
            tally.accepted,
            tally.planned,
            tally.rejected,
            (tally.mass_state, tally.excitation) == here,
        )
        for tally in status.tallies
    )


def sketch_of(bench: Bench, excitation: Excitation) -> Sketch:
    """Return the sketch of a bump; a push that cannot make it is a drop."""
    procedure = bench.campaign
    height = f"{procedure.bump_height_m * 1e3:g} mm"
    bump = BUMPS[excitation]
    fl, fr, rl, rr = (share > 0.0 for share in bump.shares)
    if procedure.method is Method.PUSH and bump.hand is not None:
        none = (False, False, False, False)
        return Sketch(Method.PUSH, none, bump.hand, f"push {height} down here")
    if procedure.method is Method.ROLL_OVER:
        return Sketch(Method.ROLL_OVER, (fl, fr, rl, rr), None, f"board, {height}")
    return Sketch(Method.DROP, (fl, fr, rl, rr), None, f"wheel on a block, {height}")


def buttons_of(status: Status) -> Buttons:
    """Return what the buttons do in a status."""
    last = status.runs[-1] if status.runs else None
    rejects = last is not None and last.status is not LoggedStatus.REJECTED
    weights = changed_weights(status) if _arms(status) else ""
    start = "Weights are off: start" if weights == BASELINE else "Weights are on: start"
    return Buttons(
        start if weights else _NEXT_WORDS.get(status.phase, "Start") if _arms(status) else "",
        weights,
        f"Reject {run_words(last)}" if last and rejects else "",
        last.label if last and rejects else "",
        "Pause" if status.phase in _RUNNING else "",
    )


def order_of(button: str, label: str, status: Status) -> Order | None:
    """Return the order of a button; None if it does nothing now.

    `label`: label that the page sent with the button.
    """
    if button == NEXT and _arms(status) and label == changed_weights(status):
        return next_action(status).order
    if button == REJECT and label and label == buttons_of(status).reject_label:
        return Reject(label)
    if button == PAUSE and status.phase in _RUNNING:
        return Pause()
    return None


def _arms(status: Status) -> bool:
    return isinstance(next_action(status).order, Arm)
