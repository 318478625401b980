"""Text of the banner: the state as symbol, word and digits, readable without colour."""

from __future__ import annotations

import math
from dataclasses import dataclass

from daq import Status
from daq.control import Phase
from daq.errors import printable
from daq.runlog import LoggedRun, LoggedStatus

from .feed import Lost
from .glyphs import Glyphs
from .next_action import NextAction

_BAR = 20


@dataclass(frozen=True, slots=True)
class Banner:
    """Three lines that are read from three metres."""

    kind: str
    """`armed`, `moving`, `good`, `bad`, `quiet`: chooses the colour, which only adds to the
    words."""
    symbol: str
    word: str
    """The state in one word."""
    title: str
    """The run, behind symbol and word."""
    first: str
    """Present event."""
    second: str = ""
    """Next step of the operator."""
    digits: str = ""
    """Seconds, in digits three lines high; may be empty."""
    folds: bool = True
    """True if a long `first` may continue in the second line; else it is cut."""


def banner(status: Status | None, lost: Lost | None, action: NextAction, glyphs: Glyphs) -> Banner:
    """Return the banner of a status, or of a recorder that does not answer."""
    if lost is not None:
        otherwise = printable(lost.advice, 200)
        advice = f"X = start it again   ({otherwise})"
        return Banner("bad", glyphs.bad, "RECORDER LOST", "", printable(lost.text, 300), advice)
    if status is None:
        return Banner("quiet", glyphs.paused, "CONNECTING", "", "waiting for the recorder")
    instruction = printable(" ".join(due.instruction.split()), 300) if (due := status.due) else ""
    title = _title(status)
    match status.phase:
        case Phase.WAITING:
            moving = printable(", ".join(status.not_at_rest), 48)
            why = f"not at rest: {moving}" if moving else "filling the seconds before the bump"
            return Banner("armed", glyphs.paused, "WAITING", title, why, "Hands off until ARMED.")
        case Phase.ARMED:
            good = glyphs.good
            rest = f"at rest {good}  pre-trigger {good}"
            return Banner(
                "armed", glyphs.bus, "ARMED", f"{title}   {rest}", instruction, digits="-.-"
            )
        case Phase.TRIGGERED:
            return Banner(
                "moving", glyphs.now, "TRIGGERED", title, "Hands off. Recording the bump.",
                digits=_age(status),
            )  # fmt: skip
        case Phase.DECAY:
            return Banner(
                "moving", glyphs.now, "DECAY", title, f"Hands off.  {_left(status, glyphs)}",
                digits=_age(status),
            )  # fmt: skip
        case Phase.ACCEPTED:
            return _accepted(status, action, glyphs)
        case Phase.REJECTED:
            return _rejected(status, action, glyphs)
        case Phase.PAUSED:
            first = "Bumps are not counted; frames are still recorded."
            return Banner("quiet", glyphs.paused, "PAUSED", title, first, action.words)
        case Phase.COMPLETE:
            first = "Every planned run is accepted."
            return Banner("good", glyphs.good, "COMPLETE", "", first, action.words)
    if status.halted:
        first = f"three rejects for one reason: {printable(_reason(status.halted), 60)}"
        return Banner(
            "bad", glyphs.bad, "STOPPED", title, first, f"F1 = what to do   {action.words}"
        )
    if action.step is not None:
        return Banner("good", glyphs.good, "DONE", "", "This step is complete.", action.words)
    return Banner("quiet", glyphs.paused, "IDLE", f"next: {title}", instruction, action.words)


def run_words(run: LoggedRun) -> str:
    """Return `bounce 3` and the like; the added state says so."""
    return f"{run.excitation.words} {run.repeat}"


def _reason(code: str) -> str:
    return code.replace("_", " ")


def _title(status: Status) -> str:
    due = status.due
    if due is None:
        return ""
    number = due.accepted + 1
    kind = due.step.excitation.words
    if number > due.planned:
        return f"{kind} {number}, {due.planned} planned"
    return f"{kind} {number} of {due.planned}"


def _last(status: Status) -> LoggedRun | None:
    judged = [run for run in status.runs if run.status is not LoggedStatus.OPEN]
    return judged[-1] if judged else None


def _count(status: Status, run: LoggedRun) -> str:
    kind = (run.mass_state, run.excitation)
    same = next((t for t in status.tallies if (t.mass_state, t.excitation) == kind), None)
    return f"{same.accepted} of {same.planned} accepted" if same else ""


def _age(status: Status) -> str:
    return f"{max(0.0, (status.t_ns - status.bump_ns) * 1e-9):.1f}" if status.bump_ns else ""


def _left(status: Status, glyphs: Glyphs) -> str:
    if status.peak_left is None:
        return ""
    share = min(max(status.peak_left, 0.0), 1.0)
    full = round((1.0 - share) * _BAR)
    return f"{share:3.0%} of the peak left  [{glyphs.full * full}{glyphs.empty * (_BAR - full)}]"


def _countdown(status: Status) -> str:
    return f"{math.ceil(status.countdown_s)}" if status.countdown_s is not None else ""


def _accepted(status: Status, action: NextAction, glyphs: Glyphs) -> Banner:
    run = _last(status)
    figures = next((f.text for f in run.findings if f.code == "motion"), "") if run else ""
    seconds = _countdown(status)
    after = f"The next run arms itself in {seconds} s." if seconds else "The last of its kind."
    second = "   ".join(part for part in (after, "Bksp = reject", action.words) if part)
    title = f"{run_words(run)}   {_count(status, run)}" if run else ""
    first = printable(figures, 100) or "every check passed"
    return Banner("good", glyphs.good, "ACCEPTED", title, first, second, seconds)


def _rejected(status: Status, action: NextAction, glyphs: Glyphs) -> Banner:
    run = _last(status)
    if run is None:
        return Banner("bad", glyphs.bad, "REJECTED", "", "", action.words)
    failed = next((finding for finding in run.findings if not finding.passed), None)
    title = f"{run_words(run)}   kept, not counted   {action.words}".rstrip()
    if status.countdown_s is not None and action.words:
        title = f"{title}, or in {_countdown(status)} s"
    if run.by or failed is None:
        why, advice = "; ".join(run.reasons), "U = undo"
    else:
        why, advice = f"{_reason(failed.code).upper()}: {failed.text}", failed.advice
    advice = f"{advice[:1].upper()}{advice[1:]}".rstrip(".") + "." if advice else ""
    return Banner(
        "bad",
        glyphs.bad,
        "REJECTED",
        title,
        printable(why, 110),
        printable(advice, 90),
        _countdown(status),
        folds=False,
    )
