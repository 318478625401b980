"""Messages between a terminal and its worker process: one JSON object a line.

The terminal puts one task on the worker's command line.  The worker answers with lines of progress,
then with one last line: the result, or the error.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from dbc import BumpbenchError
from dbc.errors import printable


@dataclass(frozen=True, slots=True)
class IdentifyTask:
    """Identify a session, leaving out the runs `without`; the answer is an `Outcome`."""

    session: str
    without: tuple[str, ...] = ()
    task: Literal["identify"] = "identify"


@dataclass(frozen=True, slots=True)
class ReportTask:
    """Write a session's report as HTML, and as PDF unless `pdf` is empty."""

    session: str
    html: str
    pdf: str
    task: Literal["report"] = "report"


@dataclass(frozen=True, slots=True)
class CompareTask:
    """Compare sessions with the first of them."""

    sessions: tuple[str, ...]
    task: Literal["compare"] = "compare"


@dataclass(frozen=True, slots=True)
class ExportTask:
    """Write a session in the format of another tool, next to the session file."""

    session: str
    form: str
    replace: bool = False
    """True if existing files may be replaced; otherwise they are refused."""
    task: Literal["export"] = "export"


@dataclass(frozen=True, slots=True)
class ListTask:
    """List the recordings and sessions of a folder, one item a session."""

    folder: str
    task: Literal["list"] = "list"


Task = Annotated[
    IdentifyTask | ReportTask | CompareTask | ExportTask | ListTask, Field(discriminator="task")
]
_TASK: TypeAdapter[Task] = TypeAdapter(Task)


@dataclass(frozen=True, slots=True)
class Progress:
    """Share of the work that is done, 0..1, and the next stage."""

    share: float
    text: str = ""
    line: Literal["progress"] = "progress"


@dataclass(frozen=True, slots=True)
class Item:
    """One of several answers, sent as soon as it is ready."""

    body: dict[str, Any]
    line: Literal["item"] = "item"


@dataclass(frozen=True, slots=True)
class Done:
    """The answer."""

    body: dict[str, Any]
    line: Literal["done"] = "done"


@dataclass(frozen=True, slots=True)
class Trouble:
    """There is no answer: the place, what is wrong, what to do; as `dbc.errors.BumpbenchError`."""

    where: str
    what: str
    advice: str
    line: Literal["trouble"] = "trouble"

    @property
    def text(self) -> str:
        """All of it on one line."""
        return f"{self.where}: {self.what} ({self.advice})"


Line = Annotated[Progress | Item | Done | Trouble, Field(discriminator="line")]
_LINE: TypeAdapter[Line] = TypeAdapter(Line)


def task_text(task: Task) -> str:
    """Return a task as the argument of a worker."""
    return json.dumps(asdict(task))


def parse_task(text: str) -> Task:
    """Return the task that `task_text` wrote.

    Raises ValueError if it is none.
    """
    return _TASK.validate_json(text)


def line_bytes(line: Line) -> bytes:
    """Return a line for the pipe; numbers that are not finite are written as Python does."""
    return json.dumps(asdict(line)).encode() + b"\n"


def parse_line(text: bytes) -> Line | None:
    """Return the parsed line of a worker; None for other output, such as a library's."""
    try:
        return _LINE.validate_json(text)
    except ValidationError:
        return None


def trouble_of(error: Exception, where: str) -> Trouble:
    """Return an error as the last line of a worker."""
    if isinstance(error, BumpbenchError):
        return Trouble(error.where, error.what, error.advice)
    if isinstance(error, MemoryError):
        return Trouble(printable(where), "needs more memory than there is", "end other programs")
    what = printable(f"{type(error).__name__}: {error}")
    return Trouble(printable(where), what, "report this; the recording is untouched")


def ended(returncode: int, where: str) -> Trouble:
    """Return the error of a worker that ended without a last line."""
    how = f"by signal {-returncode}" if returncode < 0 else f"with code {returncode}"
    advice = "the recording is untouched: start it again"
    return Trouble(printable(where), f"the work was ended from outside ({how})", advice)
