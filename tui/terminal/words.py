"""The state in words and symbols: characters, bell, banner, display's link."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from daq.control.messages import Phase, Status
from daq.runlog import LoggedRun
from daq.runs import RunStatus
from daq.verdict.words import WORDS
from dbc.words import printable

from .campaign import NextAction, cause_words, frames_stand_still, shown_obstacle
from .feed import Lost


@dataclass(frozen=True, slots=True)
class Glyphs:
    """The characters of one set."""

    name: str
    """Value of `--glyphs`: `braille` or `blocks`."""
    dots: tuple[int, int]
    """Sub-columns and sub-rows of a cell of a trace."""
    good: str
    bad: str
    warn: str
    now: str
    bus: str
    paused: str
    full: str
    empty: str
    """`full`, `empty`: pieces of a bar."""
    trigger: str
    axis: str
    overload: str

    def bar(self, n_full: int, n_pieces: int) -> str:
        """Return a bar of so many pieces; the first `n_full` of them are full."""
        return (self.full * n_full).ljust(n_pieces, self.empty)


_BRAILLE = Glyphs("braille", (2, 4), "✓", "✗", "!", "▶", "●", "○", "■", "·", "┊", "│", "▲")
_BLOCKS = Glyphs("blocks", (2, 2), "√", "x", "!", "►", "●", "○", "■", "·", "│", "│", "▲")


def choose_glyphs(wanted: str, environment: Mapping[str, str]) -> Glyphs:
    """Return the wanted set; for `auto` the best that the terminal reports to support.

    `wanted`: from the command line.  `environment`: `TERM` of the Linux console and of old ones
    have no braille; Windows Terminal sets `WT_SESSION`, the old console host does not.
    """
    if wanted != "auto":
        return _BLOCKS if wanted == _BLOCKS.name else _BRAILLE
    old_terminal = environment.get("TERM", "") in ("linux", "vt100", "vt220", "dumb")
    old_console = environment.get("OS") == "Windows_NT" and "WT_SESSION" not in environment
    return _BLOCKS if old_terminal or old_console else _BRAILLE


class Signal(Enum):
    """An event that is signalled; the value has the times at which the bell rings, s."""

    ARMED = (0.0,)
    ACCEPTED = (0.0, 0.2)
    REJECTED = (0.0, 0.2, 0.4)
    ALARM = (0.0, 0.2, 0.8, 1.0)
    LOST = (0.0, 0.2, 0.4, 1.0, 1.2, 1.4)


_SIGNALLED_PHASES = (Phase.ARMED, Phase.ACCEPTED, Phase.REJECTED)


def signal_of(previous: Status | Lost | None, news: Status | Lost) -> Signal | None:
    """Return the signal for news: of a verdict first, then of an alarm, then ARMED.

    `previous`: the status before a status, or the present loss before a loss; None without.  Then
    a status gives no signal, and only then a loss gives one.
    """
    if isinstance(news, Lost):
        return None if news.starting or previous is not None else Signal.LOST
    if not isinstance(previous, Status):
        return None
    is_new_phase = news.phase is not previous.phase and news.phase in _SIGNALLED_PHASES
    phase_signal = Signal[news.phase.name] if is_new_phase else None
    known_alarms = {(alarm.code, alarm.subject) for alarm in previous.alarms}
    has_new_alarm = any(
        (alarm.code, alarm.subject) not in known_alarms
        for alarm in news.alarms
        if alarm.code != "restamped"  # it needs no immediate action
    )
    if has_new_alarm and phase_signal in (None, Signal.ARMED):
        return Signal.ALARM
    return phase_signal


@dataclass(frozen=True, slots=True)
class DisplayLink:
    """The link of the display, as text and code."""

    lines: tuple[str, ...]
    """Link, warning and number, in words."""
    code: tuple[str, ...]
    """The link as a QR code, two rows of it in a line; empty if only this machine can open it."""


HANDS_OFF = "Hands off. Recording the bump."
PAUSED = "Bumps are not counted; frames are still recorded."
COMPLETE = "Every planned run is accepted."


def run_words(run: LoggedRun) -> str:
    """Return `bounce 3`: kind of bump and repeat."""
    return f"{run.excitation.words} {run.repeat}"


def due_words(status: Status) -> str:
    """Return `bounce 3 of 5` for the run that is due; empty if none is."""
    due = status.due
    if due is None:
        return ""
    number = due.accepted + 1
    of_planned = f", {due.planned} planned" if number > due.planned else f" of {due.planned}"
    return f"{due.step.excitation.words} {number}{of_planned}"


def instruction_words(status: Status) -> str:
    """Return how to make the bump that is due, in one line; empty if none is."""
    return printable(" ".join(due.instruction.split()), 300) if (due := status.due) else ""


def last_judged(status: Status) -> LoggedRun | None:
    """Return the last judged run; None if there is none."""
    return next((run for run in reversed(status.runs) if run.status is not RunStatus.OPEN), None)


def count_words(status: Status, run: LoggedRun) -> str:
    """Return `3 of 5 accepted` for the kind of a run."""
    kind = (run.mass_state, run.excitation)
    tally = next((t for t in status.tallies if (t.mass_state, t.excitation) == kind), None)
    return f"{tally.accepted} of {tally.planned} accepted" if tally else ""


def countdown_digits(status: Status) -> str:
    """Return the seconds to the next run; empty if none arms itself, or no frames arrive."""
    if status.countdown_s is None or frames_stand_still(status):
        return ""
    return f"{math.ceil(status.countdown_s)}"


def waiting_words(status: Status) -> str:
    """Return why a run is not armed yet."""
    moving = printable(", ".join(status.not_at_rest), 48)
    return f"not at rest: {moving}" if moving else "filling the seconds before the bump"


def unarmed_words(status: Status) -> str:
    """Return why no run arms itself after the one just accepted; empty if one does."""
    run, due = last_judged(status), status.due.step if status.due else None
    if status.countdown_s is not None:
        return ""
    goes_on = run and due and (run.mass_state, run.excitation) == (due.mass_state, due.excitation)
    return "Pauses after this run." if goes_on else "The last of its kind."


def accepted_words(status: Status, run: LoggedRun | None) -> str:
    """Return in plain words how an accepted run compares with the first one of its kind."""
    if run is None or not (hz := _frequency_hz(run)):
        return "good: every check passed"
    accepted_kind = (run.mass_state, run.excitation, RunStatus.ACCEPTED)
    of_kind = (r for r in status.runs if (r.mass_state, r.excitation, r.status) == accepted_kind)
    first_run = next(of_kind, run)
    if first_run.label == run.label or not (first_hz := _frequency_hz(first_run)):
        return f"good: the car swings at {hz:.2f} Hz"
    percent = max(1, math.ceil(100.0 * abs(hz / first_hz - 1.0)))
    return f"good: like the first within {percent} %"


def _frequency_hz(run: LoggedRun) -> float:
    """Return the frequency of a run's motion, as its check found it; 0 if it found none."""
    return next((f.value for f in run.findings if f.code == "motion"), 0.0)


def rejected_words(run: LoggedRun) -> tuple[str, str]:
    """Return why a run was rejected and what to do; a rejection by a person has no advice."""
    failed_check = run.failed
    most_characters = 110  # to be read from a distance, where a page shows them large
    if run.by or failed_check is None:
        return printable("; ".join(run.reasons), most_characters), ""
    advice = f"{failed_check.advice[:1].upper()}{failed_check.advice[1:]}".rstrip(".")
    why = f"{reason_words(failed_check.code).upper()}: {failed_check.text}"
    return printable(why, most_characters), printable(f"{advice}." if advice else "", 90)


def reason_words(code: str) -> str:
    """Return the code of a finding as words: `double bump`."""
    return code.replace("_", " ")


def halted_words(code: str) -> str:
    """Return why the run loop stopped by itself."""
    reason = WORDS[code].title if code in WORDS else reason_words(code)
    return f"three rejects for one reason: {printable(reason, 60)}"


@dataclass(frozen=True, slots=True)
class Banner:
    """Three lines, to be read from three metres: symbol, word and title; two lines of text."""

    kind: str
    """`armed`, `moving`, `good`, `bad` or `quiet`: chooses the colour."""
    symbol: str
    word: str
    title: str
    """Action of SPACE, and the run: after symbol and word, so that no terminal cuts off the key."""
    event: str
    """Second line: the present event."""
    addition: str = ""
    """Third line: further news for the operator."""
    digits: str = ""
    """Seconds, in digits three lines high; may be empty."""
    folds: bool = True
    """True if a long `event` may continue in the third line; else it is cut."""


def banner(status: Status | None, lost: Lost | None, action: NextAction, glyphs: Glyphs) -> Banner:
    """Return the banner of a status, or of a recorder that does not answer."""
    if lost is not None and lost.starting:
        return Banner("quiet", glyphs.paused, "STARTING", "", lost.text, lost.advice)
    if lost is not None:
        text, advice = printable(lost.text, 300), printable(lost.advice, 200)
        return Banner("bad", glyphs.bad, "RECORDER LOST", "X = start it again", text, advice)
    if status is None:
        return Banner("quiet", glyphs.paused, "CONNECTING", "", "waiting for the recorder")
    if (alarm := shown_obstacle(status)) is not None:
        name, advice, details = cause_words(alarm)
        return Banner("bad", glyphs.bad, "STOP", name, advice, details)
    instruction, title = instruction_words(status), due_words(status)
    match status.phase:
        case Phase.WAITING:
            why = waiting_words(status)
            return Banner("armed", glyphs.paused, "WAITING", title, why, "Hands off until ARMED.")
        case Phase.ARMED:
            title += f"   at rest {glyphs.good}  pre-trigger {glyphs.good}"
            return Banner("armed", glyphs.bus, "ARMED", title, instruction, digits="-.-")
        case Phase.TRIGGERED:
            age = seconds_since_bump(status)
            return Banner("moving", glyphs.now, "TRIGGERED", title, HANDS_OFF, digits=age)
        case Phase.DECAY:
            age, words = seconds_since_bump(status), f"Hands off.  {_decay_words(status, glyphs)}"
            return Banner("moving", glyphs.now, "DECAY", title, words, digits=age)
        case Phase.ACCEPTED:
            return _accepted_banner(status, action, glyphs)
        case Phase.REJECTED:
            return _rejected_banner(status, action, glyphs)
        case Phase.PAUSED:
            return Banner("quiet", glyphs.paused, "PAUSED", _spaced(action.words, title), PAUSED)
        case Phase.COMPLETE:
            return Banner("good", glyphs.good, "COMPLETE", action.words, COMPLETE)
    if status.halted:
        words, why = _spaced(action.words, title), halted_words(status.halted)
        return Banner("bad", glyphs.bad, "STOPPED", words, why, "F1 = what to do")
    if action.step is not None:
        return Banner("good", glyphs.good, "DONE", action.words, "This step is complete.")
    due = f"next: {status.due.step.mass_state} {title}" if status.due else ""
    return Banner("quiet", glyphs.paused, "IDLE", _spaced(action.words, due), instruction)


def _spaced(*parts: str) -> str:
    """Return the parts that are not empty, with room between them."""
    return "   ".join(filter(None, parts))


def seconds_since_bump(status: Status) -> str:
    """Return the seconds since the bump as digits; empty without one."""
    return f"{max(0.0, (status.t_ns - status.bump_ns) * 1e-9):.1f}" if status.bump_ns else ""


def remaining_motion(status: Status) -> float | None:
    """Return the ratio of the present motion to its peak, 0..1; None while it is not known."""
    return None if status.peak_left is None else min(max(status.peak_left, 0.0), 1.0)


def _decay_words(status: Status, glyphs: Glyphs) -> str:
    """Return the percentage of the peak that remains, and a bar that fills; empty if unknown."""
    if (remaining := remaining_motion(status)) is None:
        return ""
    return f"{remaining:3.0%} of the peak left  [{glyphs.bar(round((1.0 - remaining) * 20), 20)}]"


def _accepted_banner(status: Status, action: NextAction, glyphs: Glyphs) -> Banner:
    run, seconds = last_judged(status), countdown_digits(status)
    next_run = f"The next run arms itself in {seconds} s." if seconds else unarmed_words(status)
    run_and_count = f"{run_words(run)}   {count_words(status, run)}" if run else ""
    title, words = _spaced(action.words, run_and_count), accepted_words(status, run)
    addition = _spaced(next_run, "Bksp = reject")
    return Banner("good", glyphs.good, "ACCEPTED", title, words, addition, seconds)


def _rejected_banner(status: Status, action: NextAction, glyphs: Glyphs) -> Banner:
    run = last_judged(status)
    if run is None:
        return Banner("bad", glyphs.bad, "REJECTED", action.words, "")
    seconds = countdown_digits(status)
    again = f"{action.words}, or in {seconds} s" if seconds and action.words else action.words
    title = _spaced(again, run_words(run), "kept, not counted")
    why, advice = rejected_words(run)
    return Banner(
        "bad", glyphs.bad, "REJECTED", title, why, advice or "U = undo.", seconds, folds=False
    )
