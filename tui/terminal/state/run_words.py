"""Texts on the run that is due and on the last judged run, for banner and display."""

from __future__ import annotations

import math

from daq import Status
from daq.errors import printable
from daq.runlog import LoggedRun, LoggedStatus

from .obstacle import frames_stand_still

HANDS_OFF = "Hands off. Recording the bump."
PAUSED = "Bumps are not counted; frames are still recorded."
COMPLETE = "Every planned run is accepted."


def run_words(run: LoggedRun) -> str:
    """Return `bounce 3` and the like; in the added state, with its name."""
    return f"{run.excitation.words} {run.repeat}"


def due_words(status: Status) -> str:
    """Return `bounce 3 of 5` for the run that is due; empty if none is."""
    due = status.due
    if due is None:
        return ""
    number = due.accepted + 1
    kind = due.step.excitation.words
    if number > due.planned:
        return f"{kind} {number}, {due.planned} planned"
    return f"{kind} {number} of {due.planned}"


def instruction_words(status: Status) -> str:
    """Return how to make the bump that is due, in one line; empty if none is."""
    return printable(" ".join(due.instruction.split()), 300) if (due := status.due) else ""


def last_judged(status: Status) -> LoggedRun | None:
    """Return the last judged run; None if there is none."""
    judged = [run for run in status.runs if run.status is not LoggedStatus.OPEN]
    return judged[-1] if judged else None


def count_words(status: Status, run: LoggedRun) -> str:
    """Return `3 of 5 accepted` for the kind of a run."""
    kind = (run.mass_state, run.excitation)
    same = next((t for t in status.tallies if (t.mass_state, t.excitation) == kind), None)
    return f"{same.accepted} of {same.planned} accepted" if same else ""


def countdown_digits(status: Status) -> str:
    """Return the seconds to the next run; empty if none arms itself, or no frames arrive."""
    if status.countdown_s is None or frames_stand_still(status):
        return ""
    return f"{math.ceil(status.countdown_s)}"


def waiting_words(status: Status) -> str:
    """Return why a run is not armed yet."""
    moving = printable(", ".join(status.not_at_rest), 48)
    return f"not at rest: {moving}" if moving else "filling the seconds before the bump"


def accepted_words(run: LoggedRun | None) -> str:
    """Return the measured figures of an accepted run."""
    found = {f.code: f.text for f in run.findings} if run else {}
    shown = [found[code] for code in ("motion", "mirrored") if found.get(code)]
    return printable("; ".join(shown), 160) or "every check passed"


def rejected_words(run: LoggedRun) -> tuple[str, str]:
    """Return why a run was rejected and what to do; a rejection by a person has no advice."""
    failed = run.failed
    if run.by or failed is None:
        return printable("; ".join(run.reasons), 110), ""
    advice = f"{failed.advice[:1].upper()}{failed.advice[1:]}".rstrip(".")
    why = f"{reason_words(failed.code).upper()}: {failed.text}"
    return printable(why, 110), printable(f"{advice}." if advice else "", 90)


def proposal_words(status: Status) -> str:
    """Return a line on runs that differ from the others, and the key to leave them out; or ""."""
    number = len(status.proposed)
    if not number:
        return ""
    if number == 1:
        return "1 run is unlike the others of its kind: L leaves it out."
    return f"{number} runs are unlike the others of their kind: L leaves them out."


def reason_words(code: str) -> str:
    """Return the code of a finding as words: `double bump`."""
    return code.replace("_", " ")


def halted_words(code: str) -> str:
    """Return why the run loop stopped by itself."""
    from daq.verdict import WORDS

    reason = WORDS[code].title if code in WORDS else reason_words(code)
    return f"three rejects for one reason: {printable(reason, 60)}"
