"""Defines the log of a recording's runs, with the verdicts on each.

Nothing is ever deleted: a rejected run is a run with a status, an undone verdict is one more event.
The log is made from the events of the journal by `daq.runlog.fold`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from ..bench.campaign import Campaign, Step
from ..runs import Excitation
from .stored_finding import StoredFinding


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
    LEAVE_OUT = "leave_out"
    """A person rejects several runs at once: `reasons` by label, `by`."""
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


class LoggedStatus(StrEnum):
    """Status of a run."""

    OPEN = "open"
    """It is being recorded."""
    ACCEPTED = "accepted"
    REJECTED = "rejected"


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
    status: LoggedStatus = LoggedStatus.OPEN
    findings: tuple[StoredFinding, ...] = ()
    """The recorder's verdict; empty while it is open."""
    by: str = ""
    """The person who decided last; empty if the recorder did."""
    reason: str = ""
    """That person's reason."""

    @property
    def failed(self) -> StoredFinding | None:
        """The first finding that did not pass; None if all did."""
        return next((finding for finding in self.findings if not finding.passed), None)

    @property
    def reasons(self) -> tuple[str, ...]:
        """The reasons of its rejection, in words; empty if it is not rejected."""
        if self.status is not LoggedStatus.REJECTED:
            return ()
        if self.by:
            return (f"rejected by {self.by}" + (f": {self.reason}" if self.reason else ""),)
        return tuple(f.text for f in self.findings if not f.passed)


@dataclass(frozen=True, slots=True)
class Remark:
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


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a verdict: the run before and after it."""

    before: LoggedRun
    after: LoggedRun
    joined: bool = False
    """True if it is undone and redone together with the previous change."""


@dataclass(frozen=True, slots=True)
class RunLog:
    """The state of the fold; the default is the empty log."""

    runs: tuple[LoggedRun, ...] = ()
    """Runs, in order of their bumps."""
    done: tuple[Change, ...] = ()
    """Verdicts that can be undone, the next one last."""
    undone: tuple[Change, ...] = ()
    """Verdicts that can be redone, the next one last."""
    chosen: tuple[str, Excitation] | None = None
    """Mass state and excitation that a person has chosen for the next run."""
    notes: tuple[Remark, ...] = ()
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
        return next((run for run in self.runs if run.status is LoggedStatus.OPEN), None)

    def of(self, mass_state: str, excitation: Excitation) -> tuple[LoggedRun, ...]:
        """Return the runs of one mass state and excitation."""
        return tuple(
            run for run in self.runs if (run.mass_state, run.excitation) == (mass_state, excitation)
        )

    def accepted(self, mass_state: str, excitation: Excitation) -> int:
        """Return the number of accepted runs of one mass state and excitation."""
        kind = self.of(mass_state, excitation)
        return sum(run.status is LoggedStatus.ACCEPTED for run in kind)


def weights_change(log: RunLog, step: Step) -> bool:
    """Return True if a step is of another mass state than the last run."""
    return bool(log.runs) and log.runs[-1].mass_state != step.mass_state


def next_step(campaign: Campaign, log: RunLog) -> Step | None:
    """Return the next step of a campaign; None when every planned run is accepted.

    The repeat of the step counts attempts, so every attempt has its own label.
    """
    kinds = list(dict.fromkeys((s.mass_state, s.excitation) for s in campaign.steps))
    wanted = [kind for kind in kinds if log.accepted(*kind) < campaign.repeats]
    if log.open is not None:
        kind = (log.open.mass_state, log.open.excitation)
        return Step(*kind, log.open.repeat)
    if log.chosen is not None:
        wanted.insert(0, log.chosen)
    if not wanted:
        return None
    attempts = (run.repeat for run in log.of(*wanted[0]))
    return Step(*wanted[0], 1 + max(attempts, default=0))


def parse_label(label: str) -> Step | None:
    """Return the step of a label like `baseline_bounce_1`; None if it is not a label."""
    state, _, rest = label.partition("_")
    kind, _, number = rest.rpartition("_")
    if kind not in set(Excitation) or not number.isdecimal():
        return None
    return Step(state, Excitation(kind), int(number))
