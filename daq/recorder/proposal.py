"""Proposes which accepted runs to leave out, and makes the event of leaving them out."""

from __future__ import annotations

from collections.abc import Mapping

from ..bench.config import Bench
from ..control.messages import LeftOut
from ..runlog.entries import entry
from ..runlog.runlog import Code, LoggedStatus, RunLog
from ..runs import Event
from ..verdict import RunMeasure
from ..verdict.consistent import left_out
from .orders import OrderError


def proposed(bench: Bench, log: RunLog, measures: Mapping[str, RunMeasure]) -> tuple[LeftOut, ...]:
    """Return the runs to leave out, of every kind that has more accepted runs than planned.

    Runs of the other side or axle are compared among themselves.  A run that a person has accepted
    is kept, because a person has decided on it.
    """
    kinds = dict.fromkeys((run.mass_state, run.excitation) for run in log.runs)
    found: list[LeftOut] = []
    for kind in kinds:
        accepted = [run for run in log.of(*kind) if run.status is LoggedStatus.ACCEPTED]
        known = {run.label: measures[run.label] for run in accepted if run.label in measures}
        decided = {run.label for run in accepted if run.by}
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
