"""The state that the page shows, as a pure function of the recorder's status.

The page decides nothing: it shows these words, and speaks or sounds when `cue` changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from daq import Status
from daq.bench import Origin
from daq.control import Phase
from daq.errors import printable
from daq.runlog import LoggedRun, LoggedStatus

from ..terminal.state.feed import Lost
from ..terminal.state.next_action import next_action, weights_question
from ..terminal.state.obstacle import cause_words, first_obstacle
from ..terminal.state.run_words import (
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
from .buttons import NO_BUTTONS, Buttons, buttons_of
from .pieces import AlarmLine, Row, Sketch, alarm_line, rows_of, sketch_of

if TYPE_CHECKING:
    from daq import Bench


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
