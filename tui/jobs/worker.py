"""Does long work of the terminal in a separate process.

The terminal sends one task.  The worker answers with lines of progress, then with one last line:
the result, or the error; all are pickled.  It ends when its standard input does: a terminal that is
killed leaves no work behind.
"""

from __future__ import annotations

import asyncio
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from dbc import BumpbenchError
from dbc.words import printable

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
    """There is no answer: the place, what is wrong, what to do; as `dbc.words.BumpbenchError`."""

    where: str
    what: str
    advice: str

    @property
    def text(self) -> str:
        """All of it on one line."""
        return f"{self.where}: {self.what} ({self.advice})"


Line = Progress | Item | Done | Trouble
Send = Callable[[Line], None]

START = "from tui.jobs.worker import main; main()"
"""Program of the worker's process: run with -m, its classes would be others than the terminal's."""


# The terminal's end -------------------------------------------------------------------------------


async def lines_of(
    task: Task, where: str, stop: asyncio.Event | None = None
) -> AsyncGenerator[Line, None]:
    """Do a task in a separate process; yield its lines, the last a `Done` or a `Trouble`.

    The process ends with the iteration, and also when this process ends in any way, because it
    watches its standard input.  `where`: subject of an error that names none itself.  `stop`: set
    to get the answer so far.
    """
    try:
        child = subprocess.Popen(
            [sys.executable, "-c", START],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError as error:
        reason = f"no process can be started ({error.strerror or error})"
        yield Trouble(where, reason, "end other programs, and try again")
        return
    lines: asyncio.Queue[Line] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def listen() -> None:
        """Send the task; pass on each line, last that the process has ended; close its pipes."""
        with suppress(RuntimeError, OSError), child:  # the loop is closed, or it has ended
            assert child.stdin is not None
            assert child.stdout is not None
            with suppress(OSError, EOFError, pickle.UnpicklingError):  # it has ended
                pickle.dump((task, where), child.stdin)
                child.stdin.flush()
                while True:
                    loop.call_soon_threadsafe(lines.put_nowait, pickle.load(child.stdout))
            code = child.wait()
            how = f"by signal {-code}" if code < 0 else f"with code {code}"
            reason = f"the work was ended from outside ({how})"
            trouble = Trouble(where, reason, "the recording is untouched: start it again")
            loop.call_soon_threadsafe(lines.put_nowait, trouble)

    # A thread is used instead of the loop's own subprocess, which must be awaited to its end, and
    # which a screen that is closed twice in a row leaves with open pipes.
    Thread(target=listen, name="worker", daemon=True).start()

    async def send_stop(stop: asyncio.Event) -> None:
        await stop.wait()
        with suppress(OSError, ValueError):  # it has ended
            assert child.stdin is not None
            child.stdin.write(b"stop\n")
            child.stdin.flush()

    sending = asyncio.create_task(send_stop(stop)) if stop is not None else None
    try:
        while True:
            line = await lines.get()
            yield line
            if isinstance(line, Done | Trouble):
                return
    finally:
        if sending is not None:
            sending.cancel()
        with suppress(ProcessLookupError, PermissionError):
            if hasattr(os, "killpg"):  # with its children
                os.killpg(child.pid, signal.SIGKILL)
            else:  # Windows; its children end with it
                child.kill()


# The worker's end ---------------------------------------------------------------------------------


_stopped = Event()
"""Set once the terminal takes the answer so far."""


def main() -> None:
    """Do one task and write its lines to stdout."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # output of a library must not come between the lines
        with suppress(OSError, AttributeError):
            os.nice(10)  # the recorder has priority
        task, where = pickle.load(sys.stdin.buffer)

        def watch_stdin() -> None:
            while os.read(0, 4096):
                _stopped.set()
            os._exit(1)  # the terminal has ended

        def send(line: Line) -> None:
            pickle.dump(line, out)
            out.flush()

        Thread(target=watch_stdin, daemon=True).start()
        try:
            send(Done(_WORK[type(task)](task, send)))
        except BumpbenchError as error:
            send(Trouble(error.where, error.what, error.advice))
        except MemoryError:
            send(Trouble(where, "needs more memory than there is", "end other programs"))
        except Exception as error:
            reason = printable(f"{type(error).__name__}: {error}")
            send(Trouble(where, reason, "report this; the recording is untouched"))


def _identify(task: IdentifyTask, send: Send) -> Outcome:
    from daq import read_session
    from daq.sessions import overrides_of
    from identify import identify, usable_session

    send(Progress(0.05, "reading"))
    session = read_session(task.session)
    result = identify(
        session, lambda share, text: send(Progress(share, text)), stop=_stopped.is_set
    )
    runs = tuple(
        RunOutcome(run.label, str(run.status), run.reasons) for run in usable_session(session).runs
    )
    result = replace(result, estimation=None, residuals=())
    return Outcome(task.session, result, overrides_of(session.provenance), runs)


def _report(task: ReportTask, send: Send) -> dict[str, Any]:
    from .reporting import write_report

    sizes: dict[str, int] = {}  # bytes

    def written(file: Path) -> None:
        sizes[str(file)] = file.stat().st_size

    def stage(share: float, text: str) -> None:
        send(Progress(share, text))

    session, html, pdf = (Path(name) for name in (task.session, task.html, task.pdf))
    report = write_report(session, html, pdf, stage, written)
    return {"files": sizes, "verdict": str(report.result.quality.verdict)}


def _list(task: ListTask, send: Send) -> dict[str, Any]:
    from .session_list import sessions_in

    count = 0
    for entry in sessions_in(Path(task.folder)):
        send(Item(entry))
        count += 1
    return {"count": count}


_WORK: dict[type, Callable[[Any, Send], Any]] = {
    IdentifyTask: _identify,
    ReportTask: _report,
    ListTask: _list,
}
