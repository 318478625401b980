"""Makes the run log as a fold over the events of the journal.

The events are the only source.  The recorder, a restarted recorder and the session builder all make
the log with this fold, so they cannot disagree.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from dbc.finding import Finding, Severity

from ..runs import Event, Excitation
from .runlog import (
    Change,
    Code,
    LoggedRun,
    LoggedStatus,
    Override,
    Remark,
    RunLog,
    parse_label,
)
from .stored_finding import read_finding


def fold(events: Iterable[Event], log: RunLog | None = None) -> RunLog:
    """Return the log after these events."""
    log = log or RunLog()
    for event in events:
        log = advance(log, event)
    return log


def advance(log: RunLog, event: Event) -> RunLog:
    """Return the log after one event.

    Other events, and events that cannot be read, change nothing: a journal of another version must
    not stop a recovery.
    """
    after = _advanced(log, event)
    content = (log.runs, log.bench_text, log.overrides)
    if content == (after.runs, after.bench_text, after.overrides):
        return after
    return replace(after, revision=log.revision + 1)


def _advanced(log: RunLog, event: Event) -> RunLog:
    match event.code:
        case Code.BUMP:
            return _bumped(log, event)
        case Code.BENCH:
            return replace(log, bench_text=event.text)
        case Code.MARK:
            mark = Remark(event.t_ns, event.text, revision=log.revision)
            return replace(log, notes=(*log.notes, mark))
        case Code.UNDO:
            return _stepped_back(log)
        case Code.REDO:
            return _stepped_forth(log)
        case Code.RESUMED:
            return _cut(log)
        case (
            Code.VERDICT
            | Code.ACCEPT
            | Code.REJECT
            | Code.LEAVE_OUT
            | Code.CHOOSE
            | Code.NOTE
            | Code.OVERRIDE
        ):
            try:
                body = json.loads(event.text)
                return _entered(log, Code(event.code), event.t_ns, body)
            except (ValueError, KeyError, TypeError):
                return log
    return log


def _entered(log: RunLog, code: Code, t_ns: int, body: Mapping[str, Any]) -> RunLog:
    if code is Code.CHOOSE:
        return replace(log, chosen=(body["mass_state"], Excitation(body["excitation"])))
    if code is Code.NOTE:
        about, by = body.get("label", ""), body.get("by", "")
        note = Remark(t_ns, body["text"], about, by, log.revision)
        return replace(log, notes=(*log.notes, note))
    if code is Code.OVERRIDE:
        override = Override(t_ns, body["subject"], body["reason"], body["by"])
        return replace(log, overrides=(*log.overrides, override))
    if code is Code.LEAVE_OUT:
        return _all_left_out(log, body["reasons"], body["by"])
    run = log.run(body["label"])
    if run is None:
        return log
    if code is Code.VERDICT:
        findings = tuple(read_finding(record) for record in body["findings"])
        status = LoggedStatus.ACCEPTED if body["accepted"] else LoggedStatus.REJECTED
        return _judged(log, run, status, findings)
    status = LoggedStatus.ACCEPTED if code is Code.ACCEPT else LoggedStatus.REJECTED
    return _decided(log, run, replace(run, status=status, by=body["by"], reason=body["reason"]))


def _bumped(log: RunLog, event: Event) -> RunLog:
    step = parse_label(event.text)
    if step is None or log.run(event.text) is not None:
        return log
    run = LoggedRun(event.text, step.mass_state, step.excitation, step.repeat, event.t_ns)
    chosen = None if log.chosen == (step.mass_state, step.excitation) else log.chosen
    return replace(log, runs=(*log.runs, run), chosen=chosen)


def _all_left_out(log: RunLog, reasons: Mapping[str, str], by: str) -> RunLog:
    """Return the log with several runs rejected as one decision."""
    known = {run.label: run for run in log.runs}
    changes: list[Change] = []
    for label, reason in reasons.items():
        run = known.get(label)
        if run is not None and run.status is LoggedStatus.ACCEPTED:
            after = replace(run, status=LoggedStatus.REJECTED, by=by, reason=reason)
            changes.append(Change(run, after, joined=bool(changes)))
    return _changed(log, changes) if changes else log


def _decided(log: RunLog, before: LoggedRun, after: LoggedRun) -> RunLog:
    return _changed(log, [Change(before, after)])


def _changed(log: RunLog, changes: Sequence[Change]) -> RunLog:
    runs = _replaced(log, [change.after for change in changes])
    return replace(log, runs=runs, done=(*log.done, *changes), undone=())


def _judged(
    log: RunLog, run: LoggedRun, status: LoggedStatus, findings: tuple[Finding, ...]
) -> RunLog:
    """Return the log after the recorder's verdict."""
    if run.status is LoggedStatus.OPEN:
        return _decided(log, run, replace(run, status=status, findings=findings))
    # A person was faster: the recorder's verdict counts if that person's verdict is undone.
    beneath = replace(run, status=status, findings=findings, by="", reason="")

    def known(one: LoggedRun) -> LoggedRun:
        if one.label != run.label:
            return one
        return beneath if one.status is LoggedStatus.OPEN else replace(one, findings=findings)

    def all_known(changes: Iterable[Change]) -> tuple[Change, ...]:
        return tuple(Change(known(each.before), known(each.after), each.joined) for each in changes)

    runs = tuple(known(one) for one in log.runs)
    return replace(log, runs=runs, done=all_known(log.done), undone=all_known(log.undone))


def _stepped_back(log: RunLog) -> RunLog:
    if not log.done:
        return log
    first = len(log.done) - 1
    while first and log.done[first].joined:
        first -= 1
    back = [_reversible(change) for change in reversed(log.done[first:])]
    runs = _replaced(log, [change.before for change in back])
    return replace(log, runs=runs, done=log.done[:first], undone=(*log.undone, *back))


def _reversible(change: Change) -> Change:
    """Return a change with what its run is once it is undone.

    A run that has ended cannot be open again: undoing gives the other verdict.  A run that a person
    rejected while it was recorded is open again until the recorder judges it.
    """
    if change.before.status is not LoggedStatus.OPEN or change.after.by:
        return change
    accepted = change.after.status is LoggedStatus.ACCEPTED
    other = LoggedStatus.REJECTED if accepted else LoggedStatus.ACCEPTED
    return replace(change, before=replace(change.after, status=other, by="undo", reason=""))


def _stepped_forth(log: RunLog) -> RunLog:
    if not log.undone:
        return log
    first = len(log.undone) - 1
    while first and log.undone[first - 1].joined:
        first -= 1
    forth = log.undone[first:][::-1]
    runs = _replaced(log, [change.after for change in forth])
    return replace(log, runs=runs, done=(*log.done, *forth), undone=log.undone[:first])


def _cut(log: RunLog) -> RunLog:
    text = "cut: the recorder was stopped in mid-run"
    finding = Finding("cut", Severity.ERROR, text, advice="bump again")
    rejected = (each.after for each in log.done if each.before.status is LoggedStatus.OPEN)
    unjudged = {run.label for run in rejected if run.by}
    for run in log.runs:
        if run.status is LoggedStatus.OPEN or run.label in unjudged:
            log = _judged(log, run, LoggedStatus.REJECTED, (finding,))
    return log


def _replaced(log: RunLog, changed: Iterable[LoggedRun]) -> tuple[LoggedRun, ...]:
    """Return the runs of a log with those of the same labels in place of them."""
    latest = {run.label: run for run in changed}
    return tuple(latest.get(run.label, run) for run in log.runs)
