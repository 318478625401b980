"""Text of the banner: the state as symbol, word and digits, readable without colour."""

from __future__ import annotations

from dataclasses import dataclass

from daq import Status
from daq.control import Phase
from daq.errors import printable

from .feed import Lost
from .glyphs import Glyphs
from .next_action import NextAction
from .obstacle import cause_words, first_obstacle
from .run_words import (
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
    proposal_words,
    rejected_words,
    run_words,
    waiting_words,
)

_BAR = 20


@dataclass(frozen=True, slots=True)
class Banner:
    """Three lines, to be read from three metres."""

    kind: str
    """`armed`, `moving`, `good`, `bad`, `quiet`: chooses the colour, which only adds to the
    words."""
    symbol: str
    word: str
    """The state in one word."""
    title: str
    """The run, after symbol and word."""
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
    if lost is not None and lost.starting:
        return Banner("quiet", glyphs.paused, "STARTING", "", lost.text, lost.advice)
    if lost is not None:
        otherwise = printable(lost.advice, 200)
        advice = f"X = start it again   ({otherwise})"
        return Banner("bad", glyphs.bad, "RECORDER LOST", "", printable(lost.text, 300), advice)
    if status is None:
        return Banner("quiet", glyphs.paused, "CONNECTING", "", "waiting for the recorder")
    if (alarm := first_obstacle(status)) is not None:
        name, advice, details = cause_words(alarm)
        return Banner("bad", glyphs.bad, "STOP", name, advice, details)
    instruction, title = instruction_words(status), due_words(status)
    match status.phase:
        case Phase.WAITING:
            why = waiting_words(status)
            return Banner("armed", glyphs.paused, "WAITING", title, why, "Hands off until ARMED.")
        case Phase.ARMED:
            good = glyphs.good
            rest = f"at rest {good}  pre-trigger {good}"
            return Banner(
                "armed", glyphs.bus, "ARMED", f"{title}   {rest}", instruction, digits="-.-"
            )
        case Phase.TRIGGERED:
            return Banner(
                "moving", glyphs.now, "TRIGGERED", title, HANDS_OFF,
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
            return Banner("quiet", glyphs.paused, "PAUSED", title, PAUSED, action.words)
        case Phase.COMPLETE:
            first = proposal_words(status) or COMPLETE
            return Banner("good", glyphs.good, "COMPLETE", "", first, action.words)
    if status.halted:
        first = halted_words(status.halted)
        return Banner(
            "bad", glyphs.bad, "STOPPED", title, first, f"F1 = what to do   {action.words}"
        )
    if action.step is not None:
        first = proposal_words(status) or "This step is complete."
        return Banner("good", glyphs.good, "DONE", "", first, action.words)
    return Banner("quiet", glyphs.paused, "IDLE", f"next: {title}", instruction, action.words)


def _age(status: Status) -> str:
    return f"{max(0.0, (status.t_ns - status.bump_ns) * 1e-9):.1f}" if status.bump_ns else ""


def _left(status: Status, glyphs: Glyphs) -> str:
    if status.peak_left is None:
        return ""
    share = min(max(status.peak_left, 0.0), 1.0)
    full = round((1.0 - share) * _BAR)
    return f"{share:3.0%} of the peak left  [{glyphs.full * full}{glyphs.empty * (_BAR - full)}]"


def _accepted(status: Status, action: NextAction, glyphs: Glyphs) -> Banner:
    run = last_judged(status)
    seconds = countdown_digits(status)
    after = f"The next run arms itself in {seconds} s." if seconds else "The last of its kind."
    second = "   ".join(part for part in (after, "Bksp = reject", action.words) if part)
    title = f"{run_words(run)}   {count_words(status, run)}" if run else ""
    return Banner("good", glyphs.good, "ACCEPTED", title, accepted_words(run), second, seconds)


def _rejected(status: Status, action: NextAction, glyphs: Glyphs) -> Banner:
    run = last_judged(status)
    if run is None:
        return Banner("bad", glyphs.bad, "REJECTED", "", "", action.words)
    title = f"{run_words(run)}   kept, not counted   {action.words}".rstrip()
    seconds = countdown_digits(status)
    if seconds and action.words:
        title = f"{title}, or in {seconds} s"
    why, advice = rejected_words(run)
    return Banner(
        "bad", glyphs.bad, "REJECTED", title, why, advice or "U = undo.", seconds, folds=False
    )
