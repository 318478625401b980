"""Where a recorder stands, as its status tells: what is due, how many runs there are."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..bench.config import Bench
from ..bench.procedure import instruction
from ..control.messages import DiskStatus, Due, QueueStatus, SessionStatus, Tally
from ..runlog.runlog import Change, LoggedRun, LoggedStatus, RunLog, next_step
from ..runs import Excitation

NO_DISK = DiskStatus(1 << 62, 0, 0, 0.0)
NO_QUEUE = QueueStatus(0, 0, 1)
"""Of a recorder that has no disk and no queue of its own."""
_TOLD_WHOLE = 100
"""Runs that a status tells all of; a long campaign has sixty."""


@dataclass(frozen=True, slots=True)
class Host:
    """What surrounds a recorder: the part of its status that it does not know itself."""

    recording: str
    folder: str
    software: str
    """Identity of the recording, where it is, name and version of the program."""
    disk: DiskStatus
    queue: QueueStatus
    session: SessionStatus
    """`disk`, `queue`, `session`: as they stand."""


def due(bench: Bench, book: RunLog) -> Due | None:
    """Return the step that is to be done next, None when the campaign is complete."""
    step = next_step(bench.campaign, book)
    if step is None:
        return None
    tally = _tally(bench, book, (step.mass_state, step.excitation))
    told = instruction(bench.procedure, step.excitation)
    return Due(step, tally.accepted, tally.planned, tally.rejected, told)


def tallies(bench: Bench, book: RunLog) -> tuple[Tally, ...]:
    """Return how many runs there are of each kind, those of the campaign first."""
    kinds = [(step.mass_state, step.excitation) for step in bench.campaign.steps]
    kinds += [(run.mass_state, run.excitation) for run in book.runs]
    return tuple(_tally(bench, book, kind) for kind in dict.fromkeys(kinds))


def told_runs(book: RunLog) -> tuple[LoggedRun, ...]:
    """Return the runs for a status; of those long ago only what stood against them.

    A recorder of weeks may have thousands, and tells its status ten times a second.
    """
    old, new = book.runs[:-_TOLD_WHOLE], book.runs[-_TOLD_WHOLE:]
    against = (
        replace(run, findings=tuple(finding for finding in run.findings if not finding.passed))
        for run in old
    )
    return (*against, *new)


def undo_text(book: RunLog) -> str:
    """Return what would be undone, in words; empty if nothing."""
    return _words(book.done)


def redo_text(book: RunLog) -> str:
    """Return what would be redone, in words; empty if nothing."""
    return _words(book.undone)


def _words(changes: tuple[Change, ...]) -> str:
    return f"{changes[-1].after.label} {changes[-1].after.status}" if changes else ""


def _tally(bench: Bench, book: RunLog, kind: tuple[str, Excitation]) -> Tally:
    planned = {(step.mass_state, step.excitation) for step in bench.campaign.steps}
    rejected = sum(run.status is LoggedStatus.REJECTED for run in book.of(*kind))
    repeats = bench.campaign.repeats if kind in planned else 0
    return Tally(*kind, book.accepted(*kind), repeats, rejected)
