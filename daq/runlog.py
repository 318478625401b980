"""Defines the log of a recording's runs, with the verdicts on each.

Nothing is ever deleted: a rejected run is a run with a status, an undone verdict is one more event.
The log is made from the events of the journal by `daq.runlog`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import reduce
from math import isfinite
from typing import Annotated, Any, NamedTuple

from pydantic import PlainSerializer, PlainValidator

from dbc.words import Finding, Severity

from .bench.campaign import Campaign, Step
from .runs import Event, Excitation, RunStatus

# Converts a finding to the form of journals, session files and status messages, and back ----------

_TEXTS = ("code", "subject", "unit", "text", "advice")
_FIGURES = ("value", "limit")
"""`_TEXTS`, `_FIGURES`: fields of a finding that are stored, besides `passed`."""


def finding_record(finding: Finding) -> dict[str, Any]:
    """Return a finding as a JSON object; a figure that is not finite becomes 0."""
    figures = {name: getattr(finding, name) for name in _FIGURES}
    record = {name: value if isfinite(value) else 0.0 for name, value in figures.items()}
    return {**record, **{n: getattr(finding, n) for n in _TEXTS}, "passed": finding.passed}


def read_finding(record: Any) -> Finding:
    """Return the finding of a JSON object; raises ValueError if it is not such an object."""
    if isinstance(record, Finding):
        return record
    try:
        fields: dict[str, Any] = {name: str(record[name]) for name in _TEXTS}
        fields |= {name: float(record[name]) for name in _FIGURES}
        return Finding(severity=Severity.NOTE if record["passed"] else Severity.ERROR, **fields)
    except (KeyError, TypeError) as error:
        raise ValueError("not the record of a finding") from error


StoredFinding = Annotated[Finding, PlainValidator(read_finding), PlainSerializer(finding_record)]
"""A finding in a message between recorder and terminal."""


# The run log --------------------------------------------------------------------------------------


class Code(StrEnum):
    """Codes of the events from which the log is made; the text of most is JSON (`entry`)."""

    BUMP = "bump"
    """Text: the label of the run."""
    RUN_END = "run_end"
    VERDICT = "verdict"
    """The recorder's verdict: `label`, `accepted`, `findings`."""
    ACCEPT = "accept"
    """A person's verdict: `label`, `by`, `reason`."""
    REJECT = "reject"
    UNDO = "undo"
    REDO = "redo"
    CHOOSE = "choose"
    """`mass_state`, `excitation`."""
    NOTE = "note"
    """`text`, `label`, `by`."""
    MARK = "mark"
    OVERRIDE = "override"
    """`subject`, `reason`, `by`."""
    BENCH = "bench"
    """Text: a new bench.toml in full; the last one applies to the whole recording."""
    RESUMED = "resumed"
    """A restarted recorder continues the recording; an open run is cut."""


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """A run in the log."""

    label: str
    """Label, unique in the recording: `repeat` counts attempts, accepted or not."""
    mass_state: str
    excitation: Excitation
    repeat: int
    t_ns: int
    """Time stamp of the bump, ns."""
    status: RunStatus = RunStatus.OPEN
    findings: tuple[StoredFinding, ...] = ()
    """The recorder's verdict; empty while it is open."""
    by: str = ""
    """The person who decided last; empty if the recorder did, `undo` if that was turned round."""
    reason: str = ""
    """That person's reason."""

    @property
    def failed(self) -> StoredFinding | None:
        """The first finding that did not pass; None if all did."""
        return next((finding for finding in self.findings if not finding.passed), None)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons of its rejection, in words; empty if it is not rejected."""
        if self.status is not RunStatus.REJECTED:
            return ()
        if self.by:
            return (f"rejected by {self.by}" + (f": {self.reason}" if self.reason else ""),)
        return tuple(f.text for f in self.findings if not f.passed)


@dataclass(frozen=True, slots=True)
class LoggedNote:
    """A note or a mark."""

    t_ns: int
    text: str
    label: str = ""
    """Label of its run; empty if it belongs to no run."""
    by: str = ""
    revision: int = 0
    """Revision of the log when it was made."""


@dataclass(frozen=True, slots=True)
class Override:
    """A warning of the bench check for which a person has taken responsibility."""

    t_ns: int
    subject: str
    reason: str
    by: str


class Change(NamedTuple):
    """A change of a verdict: the run before and after it."""

    before: LoggedRun
    after: LoggedRun


@dataclass(frozen=True, slots=True)
class RunLog:
    """The state of the fold; the default is the empty log."""

    runs: tuple[LoggedRun, ...] = ()
    """Runs, in order of their bumps."""
    done: tuple[Change, ...] = ()
    """Changes that can be undone, the next one last."""
    undone: tuple[Change, ...] = ()
    """Changes that can be redone, the next one last."""
    chosen: tuple[str, Excitation] | None = None
    """Mass state and excitation that a person has chosen for the next run."""
    notes: tuple[LoggedNote, ...] = ()
    overrides: tuple[Override, ...] = ()
    bench_text: str = ""
    """The last bench.toml in an event; empty if there is none."""
    revision: int = 0
    """Number of changes of the content of the session file; notes and marks do not count."""

    def run(self, label: str) -> LoggedRun | None:
        """Return the run of a label; None if there is none."""
        return next((run for run in self.runs if run.label == label), None)

    @property
    def open(self) -> LoggedRun | None:
        """The run that is being recorded; None if there is none."""
        return next((run for run in self.runs if run.status is RunStatus.OPEN), None)

    def of(self, mass_state: str, excitation: Excitation) -> tuple[LoggedRun, ...]:
        """Return the runs of one mass state and excitation."""
        return tuple(
            run for run in self.runs if (run.mass_state, run.excitation) == (mass_state, excitation)
        )

    def accepted(self, mass_state: str, excitation: Excitation) -> int:
        """Return the number of accepted runs of one mass state and excitation."""
        runs = self.of(mass_state, excitation)
        return sum(run.status is RunStatus.ACCEPTED for run in runs)


def next_step(campaign: Campaign, log: RunLog) -> Step | None:
    """Return the step of the open run, else the next one; None when all planned runs are accepted.

    A step that a person has chosen is next.  Its repeat counts attempts: each has its own label.
    """
    kinds = list(dict.fromkeys((s.mass_state, s.excitation) for s in campaign.steps))
    kinds_to_do = [kind for kind in kinds if log.accepted(*kind) < campaign.repeats]
    if log.open is not None:
        kind = (log.open.mass_state, log.open.excitation)
        return Step(*kind, log.open.repeat)
    if log.chosen is not None:
        kinds_to_do.insert(0, log.chosen)
    if not kinds_to_do:
        return None
    attempts = (run.repeat for run in log.of(*kinds_to_do[0]))
    return Step(*kinds_to_do[0], 1 + max(attempts, default=0))


def parse_label(label: str) -> Step | None:
    """Return the step of a label like `baseline_bounce_1`; None if it is not a label."""
    state, _, kind_and_number = label.partition("_")
    kind, _, number = kind_and_number.rpartition("_")
    if kind not in set(Excitation) or not number.isdecimal():
        return None
    return Step(state, Excitation(kind), int(number))


# Makes the run log as a fold over the events of the journal ---------------------------------------
#
# The events are the only source.  The recorder, a restarted recorder and the session builder all
# make the log with this fold, so they cannot disagree.


def fold(events: Iterable[Event], log: RunLog | None = None) -> RunLog:
    """Return the log after these events."""
    return reduce(advance, events, log or RunLog())


def advance(log: RunLog, event: Event) -> RunLog:
    """Return the log after one event.

    Events of other codes, and unreadable ones, change nothing: no journal must stop a recovery.
    """
    try:
        after = _advanced(log, event)
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError):
        return log
    content = (log.runs, log.bench_text, log.overrides)
    if content == (after.runs, after.bench_text, after.overrides):
        return after
    return replace(after, revision=log.revision + 1)


def _advanced(log: RunLog, event: Event) -> RunLog:
    """Return the log after one event; raises what `advance` catches for a wrong text.

    A bump whose label is no run or not new changes nothing.
    """
    t_ns, text = event.t_ns, event.text
    match event.code:
        case Code.BUMP:
            step = parse_label(text)
            if step is None or log.run(text) is not None:
                return log
            run = LoggedRun(text, step.mass_state, step.excitation, step.repeat, t_ns)
            chosen = None if log.chosen == (step.mass_state, step.excitation) else log.chosen
            return replace(log, runs=(*log.runs, run), chosen=chosen)
        case Code.BENCH:
            return replace(log, bench_text=text)
        case Code.MARK:
            mark = LoggedNote(t_ns, text, revision=log.revision)
            return replace(log, notes=(*log.notes, mark))
        case Code.UNDO if log.done:
            change = log.done[-1]
            if change.before.status is RunStatus.OPEN:
                # A run that the recorder has judged cannot be open again: its verdict turns round.
                accepted = change.after.status is RunStatus.ACCEPTED
                opposite = RunStatus.REJECTED if accepted else RunStatus.ACCEPTED
                reversed_run = replace(change.after, status=opposite, by="undo", reason="")
                change = change._replace(before=reversed_run)
            runs = _replaced(log, change.before)
            return replace(log, runs=runs, done=log.done[:-1], undone=(*log.undone, change))
        case Code.REDO if log.undone:
            redone = log.undone[-1]
            runs = _replaced(log, redone.after)
            return replace(log, runs=runs, done=(*log.done, redone), undone=log.undone[:-1])
        case Code.RESUMED if log.open:
            words = "cut: the recorder was stopped in mid-run"
            finding = Finding("cut", Severity.ERROR, words, advice="bump again")
            judged = replace(log.open, status=RunStatus.REJECTED, findings=(finding,))
            return _decided(log, Change(log.open, judged))
        case Code.VERDICT | Code.ACCEPT | Code.REJECT | Code.CHOOSE | Code.NOTE | Code.OVERRIDE:
            return _entered(log, Code(event.code), t_ns, json.loads(text))
    return log


def _entered(log: RunLog, code: Code, t_ns: int, body: Mapping[str, Any]) -> RunLog:
    """Return the log after an event whose text is a JSON object, `body`.

    A verdict on a run that is not in the log changes nothing.
    """
    if code is Code.CHOOSE:
        return replace(log, chosen=(body["mass_state"], Excitation(body["excitation"])))
    if code is Code.NOTE:
        label, by = body.get("label", ""), body.get("by", "")
        note = LoggedNote(t_ns, body["text"], label, by, log.revision)
        return replace(log, notes=(*log.notes, note))
    if code is Code.OVERRIDE:
        override = Override(t_ns, body["subject"], body["reason"], body["by"])
        return replace(log, overrides=(*log.overrides, override))
    run = log.run(body["label"])
    if run is None:
        return log
    accepted = code is Code.ACCEPT or (code is Code.VERDICT and body["accepted"])
    status = RunStatus.ACCEPTED if accepted else RunStatus.REJECTED
    if code is not Code.VERDICT:
        decided = replace(run, status=status, by=body["by"], reason=body["reason"])
        return _decided(log, Change(run, decided))
    judged = replace(run, findings=tuple(read_finding(record) for record in body["findings"]))
    if run.status is not RunStatus.OPEN:  # a person decided before, in journals of November 2026
        return replace(log, runs=_replaced(log, judged))
    return _decided(log, Change(run, replace(judged, status=status)))


def _decided(log: RunLog, change: Change) -> RunLog:
    """Return the log after a change of a verdict, which can be undone."""
    runs = _replaced(log, change.after)
    return replace(log, runs=runs, done=(*log.done, change), undone=())


def _replaced(log: RunLog, changed: LoggedRun) -> tuple[LoggedRun, ...]:
    """Return the runs of a log with a changed one in place of that of its label."""
    return tuple(changed if run.label == changed.label else run for run in log.runs)


# Makes the events from which the run log is folded ------------------------------------------------


def entry(code: Code, t_ns: int, **body: Any) -> Event:
    """Return an event with a JSON text."""
    return Event(t_ns, code, 0.0, json.dumps(body, sort_keys=True))


def verdict_entry(t_ns: int, label: str, findings: Iterable[Finding]) -> Event:
    """Return the event of the recorder's verdict on a run."""
    records = [finding_record(finding) for finding in findings]
    accepted = all(record["passed"] for record in records)
    return entry(Code.VERDICT, t_ns, label=label, accepted=accepted, findings=records)
