"""Does long work of the terminal in a separate process.

The terminal sends one task.  The worker answers with its progress, then with the result or the
error; all are pickled.  It ends when its standard input does: a terminal that is killed leaves no
work behind.
"""

from __future__ import annotations

import asyncio
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from dbc import BumpbenchError, InputError
from dbc.words import printable

from ..output import Stage

if TYPE_CHECKING:
    from identify import Identification

Task = Callable[[Stage], Any]
"""Returns the answer: a `functools.partial` of a function of a module."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """The content of the screens of one identification."""

    session: str
    result: Identification
    """Without its fit."""
    overrides: tuple[str, ...]
    """Warnings that a person overrode, with reason and name."""
    runs: tuple[tuple[str, str], ...]
    """Label and status of each run: `accepted` if the result is based on it, else `rejected`."""


def identify_session(path: str, stage: Stage) -> Outcome:
    """Identify a session file; return what the screens show of it."""
    from daq import read_session
    from daq.sessions import overrides_of
    from identify import identify, usable_session

    stage(0.05, "reading")
    session = read_session(path)
    result = identify(session, stage, stop=_answer_requested.is_set)
    result = replace(result, estimation=None)
    runs = tuple((run.label, str(run.status)) for run in usable_session(session).runs)
    return Outcome(path, result, overrides_of(session.provenance), runs)


def report_session(session: str, html: str, pdf: str, stage: Stage) -> dict[str, Any]:
    """Write a session's report; return the size of each file, bytes, and the verdict."""
    from .reporting import write_report

    sizes: dict[str, int] = {}

    def written(file: Path) -> None:
        sizes[str(file)] = file.stat().st_size

    report = write_report(Path(session), Path(html), Path(pdf), stage, written)
    return {"files": sizes, "verdict": str(report.result.quality.verdict)}


# The terminal's end -------------------------------------------------------------------------------

START = "from tui.jobs.worker import main; main()"
"""Program of the worker's process: run with -m, its classes would be others than the terminal's."""


@dataclass(frozen=True, slots=True)
class _Progress:
    done: float
    """Ratio of the work that is done, 0..1."""
    text: str


async def answer_of(task: Task, subject: str, stage: Stage, request: asyncio.Event) -> Any:
    """Do a task in a separate process and return its answer.

    The process ends with this call, also when it is cancelled or this process is killed.
    `subject`: of an error that names none itself.  `request`: set to get the answer so far.  Raises
    BumpbenchError if there is no answer.
    """
    command, pipe, nothing = [sys.executable, "-c", START], subprocess.PIPE, subprocess.DEVNULL
    try:
        worker = subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=nothing, start_new_session=True
        )
    except OSError as error:
        reason = f"no process can be started ({error.strerror or error})"
        raise InputError(subject, reason, "end other programs, and try again") from error
    messages: asyncio.Queue[Any] = asyncio.Queue()  # progress, last the answer or an error
    loop = asyncio.get_running_loop()

    def listen() -> None:
        """Send the task; pass on each message, last that the process ended; close its pipes."""
        with suppress(RuntimeError, OSError), worker:  # the loop or the process has ended
            assert worker.stdin is not None
            assert worker.stdout is not None
            with suppress(OSError, EOFError, pickle.UnpicklingError):  # the process has ended
                pickle.dump((task, subject), worker.stdin)
                worker.stdin.flush()
                while True:
                    loop.call_soon_threadsafe(messages.put_nowait, pickle.load(worker.stdout))
            code = worker.wait()
            how = f"by signal {-code}" if code < 0 else f"with code {code}"
            reason = f"the work was ended from outside ({how})"
            death = InputError(subject, reason, "the recording is untouched: start it again")
            loop.call_soon_threadsafe(messages.put_nowait, death)  # read only without an answer

    # A thread is used instead of the loop's own subprocess, which must be awaited to its end, and
    # which a screen that is closed twice in a row leaves with open pipes.
    Thread(target=listen, name="worker", daemon=True).start()

    async def pass_request_on() -> None:
        """Have the worker end with the answer so far, once `request` is set."""
        await request.wait()
        with suppress(OSError, ValueError):  # the process has ended
            assert worker.stdin is not None
            worker.stdin.write(b"take")
            worker.stdin.flush()

    passing_on = asyncio.create_task(pass_request_on())
    try:
        while isinstance(message := await messages.get(), _Progress):
            stage(message.done, message.text)
    finally:
        passing_on.cancel()
        worker.kill()  # its children end with it
    if isinstance(message, BumpbenchError):
        raise message
    return message


# The worker's end ---------------------------------------------------------------------------------


_answer_requested = Event()
"""Set once the terminal asks for the answer so far."""


def main() -> None:
    """Do one task and write its messages, pickled, to stdout."""
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)  # output of a library must not come between the messages
        with suppress(OSError, AttributeError):
            os.nice(10)  # the recorder has priority
        task, subject = pickle.load(sys.stdin.buffer)

        def watch_stdin() -> None:
            while os.read(0, 4):
                _answer_requested.set()
            os._exit(1)  # the terminal has ended

        def send(message: Any) -> None:
            pickle.dump(message, out)
            out.flush()

        Thread(target=watch_stdin, daemon=True).start()
        try:
            send(task(lambda done, text: send(_Progress(done, text))))
        except BumpbenchError as error:
            send(error)
        except MemoryError:
            send(InputError(subject, "needs more memory than there is", "end other programs"))
        except Exception as error:
            reason = printable(f"{type(error).__name__}: {error}")
            send(InputError(subject, reason, "report this; the recording is untouched"))
