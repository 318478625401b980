"""Messages between a terminal and its worker process.

The terminal sends one task.  The worker answers with lines of progress, then with one last line:
the result, or the error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from identify import Identification


@dataclass(frozen=True, slots=True)
class IdentifyTask:
    """Identify a session; the answer is an `Outcome`."""

    session: str


@dataclass(frozen=True, slots=True)
class ReportTask:
    """Write a session's report as HTML, and as PDF."""

    session: str
    html: str
    pdf: str


@dataclass(frozen=True, slots=True)
class ListTask:
    """List the recordings and sessions of a folder, one item a session."""

    folder: str


Task = IdentifyTask | ReportTask | ListTask


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """One run and its status."""

    label: str
    status: str
    """`accepted` or `rejected`."""
    reasons: tuple[str, ...]
    """Reasons why it was not used."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The content of the screens of one identification."""

    session: str
    """The session file."""
    result: Identification
    """Without its fit."""
    overrides: tuple[str, ...]
    """Warnings that a person overrode, with reason and name."""
    runs: tuple[RunOutcome, ...]

    @property
    def used(self) -> int:
        """Number of runs that the result is based on."""
        return sum(run.status == "accepted" for run in self.runs)


@dataclass(frozen=True, slots=True)
class Progress:
    """Share of the work that is done, 0..1, and the next stage."""

    share: float
    text: str = ""


@dataclass(frozen=True, slots=True)
class Item:
    """One of several answers, sent as soon as it is ready."""

    body: Any


@dataclass(frozen=True, slots=True)
class Done:
    """The answer."""

    body: Any


@dataclass(frozen=True, slots=True)
class Trouble:
    """There is no answer: the place, what is wrong, what to do; as `dbc.errors.BumpbenchError`."""

    where: str
    what: str
    advice: str

    @property
    def text(self) -> str:
        """All of it on one line."""
        return f"{self.where}: {self.what} ({self.advice})"


Line = Progress | Item | Done | Trouble
