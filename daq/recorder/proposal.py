"""Proposes which accepted runs to leave out, and makes the event of leaving them out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..bench.config import Bench
from ..control.messages import LeftOut
from ..runlog.entries import entry
from ..runlog.runlog import Code, LoggedRun, LoggedStatus, RunLog
from ..runs import Event, Excitation
from ..verdict import RunMeasure
from ..verdict.consistent import left_out
from .orders import OrderError


@dataclass(frozen=True, slots=True)
class ComparedKind:
    """The accepted runs of one kind, and which of them to leave out."""

    accepted: tuple[LoggedRun, ...]
    known: int
    """Number of these runs that are measured: after a restart, measures come later than runs."""
    out: tuple[LeftOut, ...]


Compared = Mapping[tuple[str, Excitation], ComparedKind]
"""The kinds of runs, by mass state and excitation."""


def compared(
    bench: Bench, log: RunLog, measures: Mapping[str, RunMeasure], before: Compared
) -> Compared:
    """Return the runs to leave out, of every kind that has more accepted runs than planned.

    `before`: the last result with this bench, or empty.  It is kept for a kind whose accepted runs
    are the same, because the comparison of hundreds of runs takes a tenth of a second.
    """
    kinds = dict.fromkeys((run.mass_state, run.excitation) for run in log.runs)
    now = {}
    for kind in kinds:
        accepted = tuple(run for run in log.of(*kind) if run.status is LoggedStatus.ACCEPTED)
        known = {run.label: measures[run.label] for run in accepted if run.label in measures}
        last = before.get(kind)
        if last is None or (last.accepted, last.known) != (accepted, len(known)):
            last = ComparedKind(accepted, len(known), _left_out(bench, accepted, known))
        now[kind] = last
    return now


def proposed(found: Compared) -> tuple[LeftOut, ...]:
    """Return the runs to leave out, of all kinds."""
    return tuple(run for kind in found.values() for run in kind.out)


def _left_out(
    bench: Bench, accepted: Sequence[LoggedRun], known: Mapping[str, RunMeasure]
) -> tuple[LeftOut, ...]:
    """Return the runs of one kind to leave out.

    Runs of the other side or axle are compared among themselves.  A run that a person has accepted
    is kept, because a person has decided on it.
    """
    decided = {run.label for run in accepted if run.by}
    found: list[LeftOut] = []
    for wheels in dict.fromkeys(measure.wheels for measure in known.values()):
        alike = {label: m for label, m in known.items() if m.wheels == wheels}
        planned = bench.campaign.repeats - (len(accepted) - len(alike))
        out = left_out(bench.channels, bench.bump_s, alike, planned)
        found += [LeftOut(label, text) for label, text in out.items() if label not in decided]
    return tuple(found)


def left_out_event(found: tuple[LeftOut, ...], by: str, t_ns: int) -> Event:
    """Return the event that leaves these runs out as one decision.

    Raises OrderError if there is none.
    """
    if not found:
        raise OrderError("there is no proposal to leave runs out")
    reasons = {run.label: f"unlike the others: {run.text}" for run in found}
    return entry(Code.LEAVE_OUT, t_ns, reasons=reasons, by=by)
