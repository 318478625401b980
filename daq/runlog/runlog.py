"""The book of a recording: which runs there are and what was decided, as a fold over its events.

The events in the journal are the truth.  The recorder keeps its book by this fold, a recorder that
restarts reads it back by this fold, and so does the session builder: they cannot disagree.  Nothing
is ever deleted: a rejected run is a run with a status, an undone verdict is an event more.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from math import isfinite
from typing import Any

from ..bench.campaign import Campaign, Step
from ..runs import Event, Excitation


class Code(StrEnum):
    """Codes of the events that the book is made of; the text of most is JSON (`entry`)."""

    BUMP = "bump"
    """Text: the label of the run."""
    RUN_END = "run_end"
    VERDICT = "verdict"
    """By the recorder: `label`, `accepted`, `findings`."""
    ACCEPT = "accept"
    """By a person: `label`, `by`, `reason`."""
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
    """Text: a new bench.toml in full; the last one holds for the whole recording."""
    RESUMED = "resumed"
    """A recorder took the recording up again; a run that was open is cut."""


class LoggedStatus(StrEnum):
    """What became of a run."""

    OPEN = "open"
    """It is being recorded."""
    ACCEPTED = "accepted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was judged of a run, with the measured value and its limit."""

    code: str
    """`overload`, `lost_frames`, `stale`, `not_at_rest`, `too_weak`, `double_bump`, `not_decayed`,
    `wrong_mode`, `not_repeatable`, `cut`, ... (`daq.verdict`)."""
    passed: bool
    """Whether the limit holds; a run is accepted if all do."""
    subject: str
    """The channel or message it is about; may be empty."""
    value: float
    limit: float
    """`value`, `limit`: in `unit`."""
    unit: str
    text: str
    advice: str
    """`text`, `advice`: what was found, in plain words with the numbers; what to do."""


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """A run as it stands in the book."""

    label: str
    """Unique in the recording: `repeat` counts attempts, accepted or not."""
    mass_state: str
    excitation: Excitation
    repeat: int
    t_ns: int
    """Of the bump."""
    status: LoggedStatus = LoggedStatus.OPEN
    findings: tuple[Finding, ...] = ()
    """The recorder's verdict; empty while it is open."""
    by: str = ""
    reason: str = ""
    """`by`, `reason`: the person who decided last and why; empty if the recorder did."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why it is rejected, in words; empty if it is not."""
        if self.status is not LoggedStatus.REJECTED:
            return ()
        if self.by:
            return (f"rejected by {self.by}" + (f": {self.reason}" if self.reason else ""),)
        return tuple(f.text for f in self.findings if not f.passed)


@dataclass(frozen=True, slots=True)
class Remark:
    """A note or a mark; `label` names the run it is about, if any; `revision` is the book's."""

    t_ns: int
    text: str
    label: str = ""
    by: str = ""
    revision: int = 0


@dataclass(frozen=True, slots=True)
class Override:
    """A warning of the bench check that a person answered for."""

    t_ns: int
    subject: str
    reason: str
    by: str


@dataclass(frozen=True, slots=True)
class Change:
    """A verdict, as what was before and what is after."""

    before: LoggedRun
    after: LoggedRun


@dataclass(frozen=True, slots=True)
class RunLog:
    """The state of the fold; the default is the empty book."""

    runs: tuple[LoggedRun, ...] = ()
    """In order of their bumps."""
    done: tuple[Change, ...] = ()
    undone: tuple[Change, ...] = ()
    """Verdicts that can be undone and redone, the next one last."""
    chosen: tuple[str, Excitation] | None = None
    """Mass state and excitation that a person wants next."""
    notes: tuple[Remark, ...] = ()
    overrides: tuple[Override, ...] = ()
    bench_text: str = ""
    """The last bench.toml told by an event; empty if none."""
    revision: int = 0
    """Changes so far of what a session file is made of; notes and marks are none."""

    def run(self, label: str) -> LoggedRun | None:
        """Return the run of that label."""
        return next((run for run in self.runs if run.label == label), None)

    @property
    def open(self) -> LoggedRun | None:
        """The run that is being recorded."""
        return next((run for run in self.runs if run.status is LoggedStatus.OPEN), None)

    def of(self, mass_state: str, excitation: Excitation) -> tuple[LoggedRun, ...]:
        """Return the runs of one kind."""
        return tuple(
            run for run in self.runs if (run.mass_state, run.excitation) == (mass_state, excitation)
        )

    def accepted(self, mass_state: str, excitation: Excitation) -> int:
        """Return how many runs of one kind are accepted."""
        kind = self.of(mass_state, excitation)
        return sum(run.status is LoggedStatus.ACCEPTED for run in kind)


def entry(code: Code, t_ns: int, value: float = 0.0, **body: Any) -> Event:
    """Return an event with a JSON text; dataclasses in lists become objects."""
    return Event(t_ns, code, value, json.dumps(body, sort_keys=True))


def verdict_entry(t_ns: int, label: str, findings: Iterable[Finding]) -> Event:
    """Return the event of the recorder's verdict on a run."""
    told = [asdict(finding) for finding in findings]
    for finding in told:  # JSON has no other numbers, and no client could read the status
        for key in ("value", "limit"):
            finding[key] = finding[key] if isfinite(finding[key]) else 0.0
    accepted = all(finding["passed"] for finding in told)
    return entry(Code.VERDICT, t_ns, label=label, accepted=accepted, findings=told)


def next_step(campaign: Campaign, book: RunLog) -> Step | None:
    """Return what is to be bumped next; None when every planned run is accepted.

    The repeat of the step counts attempts, so every attempt has a label of its own.
    """
    kinds = list(dict.fromkeys((s.mass_state, s.excitation) for s in campaign.steps))
    wanted = [kind for kind in kinds if book.accepted(*kind) < campaign.repeats]
    if book.open is not None:
        kind = (book.open.mass_state, book.open.excitation)
        return Step(*kind, book.open.repeat)
    if book.chosen is not None:
        wanted.insert(0, book.chosen)
    if not wanted:
        return None
    attempts = (run.repeat for run in book.of(*wanted[0]))
    return Step(*wanted[0], 1 + max(attempts, default=0))


def fold(events: Iterable[Event], book: RunLog | None = None) -> RunLog:
    """Return the book after these events."""
    book = book or RunLog()
    for event in events:
        book = advance(book, event)
    return book


def advance(book: RunLog, event: Event) -> RunLog:
    """Return the book after one event; an event that is none of the book's changes nothing.

    So does one that cannot be read: a journal of another version must not stop a recovery.
    """
    after = _advanced(book, event)
    content = (book.runs, book.bench_text, book.overrides)
    if content == (after.runs, after.bench_text, after.overrides):
        return after
    return replace(after, revision=book.revision + 1)


def _advanced(book: RunLog, event: Event) -> RunLog:
    match event.code:
        case Code.BUMP:
            return _bumped(book, event)
        case Code.BENCH:
            return replace(book, bench_text=event.text)
        case Code.MARK:
            mark = Remark(event.t_ns, event.text, revision=book.revision)
            return replace(book, notes=(*book.notes, mark))
        case Code.UNDO:
            return _stepped_back(book)
        case Code.REDO:
            return _stepped_forth(book)
        case Code.RESUMED:
            return _cut(book)
        case Code.VERDICT | Code.ACCEPT | Code.REJECT | Code.CHOOSE | Code.NOTE | Code.OVERRIDE:
            try:
                body = json.loads(event.text)
                return _entered(book, Code(event.code), event.t_ns, body)
            except (ValueError, KeyError, TypeError):
                return book
    return book


def _entered(book: RunLog, code: Code, t_ns: int, body: Mapping[str, Any]) -> RunLog:
    if code is Code.CHOOSE:
        return replace(book, chosen=(body["mass_state"], Excitation(body["excitation"])))
    if code is Code.NOTE:
        about, by = body.get("label", ""), body.get("by", "")
        note = Remark(t_ns, body["text"], about, by, book.revision)
        return replace(book, notes=(*book.notes, note))
    if code is Code.OVERRIDE:
        override = Override(t_ns, body["subject"], body["reason"], body["by"])
        return replace(book, overrides=(*book.overrides, override))
    run = book.run(body["label"])
    if run is None:
        return book
    if code is Code.VERDICT:
        findings = tuple(Finding(**finding) for finding in body["findings"])
        status = LoggedStatus.ACCEPTED if body["accepted"] else LoggedStatus.REJECTED
        return _judged(book, run, status, findings)
    status = LoggedStatus.ACCEPTED if code is Code.ACCEPT else LoggedStatus.REJECTED
    return _decided(book, run, replace(run, status=status, by=body["by"], reason=body["reason"]))


def _bumped(book: RunLog, event: Event) -> RunLog:
    step = parse_label(event.text)
    if step is None or book.run(event.text) is not None:
        return book
    run = LoggedRun(event.text, step.mass_state, step.excitation, step.repeat, event.t_ns)
    chosen = None if book.chosen == (step.mass_state, step.excitation) else book.chosen
    return replace(book, runs=(*book.runs, run), chosen=chosen)


def _decided(book: RunLog, before: LoggedRun, after: LoggedRun) -> RunLog:
    done = (*book.done, Change(before, after))
    return replace(book, runs=_replaced(book, after), done=done, undone=())


def _judged(
    book: RunLog, run: LoggedRun, status: LoggedStatus, findings: tuple[Finding, ...]
) -> RunLog:
    """Return the book after the recorder's verdict."""
    if run.status is LoggedStatus.OPEN:
        return _decided(book, run, replace(run, status=status, findings=findings))
    # A person was faster: what was found lies beneath that verdict, and comes up if it is undone.
    beneath = replace(run, status=status, findings=findings, by="", reason="")

    def known(one: LoggedRun) -> LoggedRun:
        if one.label != run.label:
            return one
        return beneath if one.status is LoggedStatus.OPEN else replace(one, findings=findings)

    return replace(
        book,
        runs=tuple(known(one) for one in book.runs),
        done=tuple(Change(known(each.before), known(each.after)) for each in book.done),
        undone=tuple(Change(known(each.before), known(each.after)) for each in book.undone),
    )


def _stepped_back(book: RunLog) -> RunLog:
    if not book.done:
        return book
    change = book.done[-1]
    # Nobody can be put back into a run that has ended: the other verdict is what is meant.  One
    # that a person has rejected while it is recorded is open again until the recorder judges it.
    before = change.before
    if before.status is LoggedStatus.OPEN and not change.after.by:
        accepted = change.after.status is LoggedStatus.ACCEPTED
        other = LoggedStatus.REJECTED if accepted else LoggedStatus.ACCEPTED
        before = replace(change.after, status=other, by="undo", reason="")
    undone = (*book.undone, Change(before, change.after))
    return replace(book, runs=_replaced(book, before), done=book.done[:-1], undone=undone)


def _stepped_forth(book: RunLog) -> RunLog:
    if not book.undone:
        return book
    change = book.undone[-1]
    done = (*book.done, change)
    return replace(book, runs=_replaced(book, change.after), done=done, undone=book.undone[:-1])


def _cut(book: RunLog) -> RunLog:
    text = "cut: the recorder was stopped in mid-run"
    finding = Finding("cut", False, "", 0.0, 0.0, "", text, "bump again")
    rejected = (each.after for each in book.done if each.before.status is LoggedStatus.OPEN)
    unjudged = {run.label for run in rejected if run.by}
    for run in book.runs:
        if run.status is LoggedStatus.OPEN or run.label in unjudged:
            book = _judged(book, run, LoggedStatus.REJECTED, (finding,))
    return book


def _replaced(book: RunLog, after: LoggedRun) -> tuple[LoggedRun, ...]:
    return tuple(after if run.label == after.label else run for run in book.runs)


def parse_label(label: str) -> Step | None:
    """Return the step of a label like `baseline_bounce_1`; None if it is none."""
    state, _, rest = label.partition("_")
    kind, _, number = rest.partition("_")
    if kind not in set(Excitation) or not number.isdecimal():
        return None
    return Step(state, Excitation(kind), int(number))
