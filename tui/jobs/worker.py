"""Does long work of the terminal in a separate process: `python -m tui.jobs.worker TASK`.

TASK is JSON (`lines.task_text`); every line on the child's stdout is a `lines.Line`.  The child
ends when its standard input does: a terminal that is killed leaves no work behind.
"""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from threading import Thread
from typing import Any

from .lines import (
    CompareTask,
    Done,
    ExportTask,
    IdentifyTask,
    Item,
    Line,
    ListTask,
    Progress,
    ReportTask,
    Task,
    Trouble,
    ended,
    line_bytes,
    parse_line,
    parse_task,
    task_text,
    trouble_of,
)

Send = Callable[[Line], None]
_NICE = 10
"""Niceness of the worker: the recorder has priority."""
_READ = 0.05


# The terminal's end -------------------------------------------------------------------------------


async def lines_of(task: Task, where: str) -> AsyncGenerator[Line, None]:
    """Do a task in a separate process; yield its lines, the last a `Done` or a `Trouble`.

    The process ends with the iteration, and also when this process ends in any way, because it
    watches its standard input.  `where`: subject of the error for the operator if the process ends
    without an answer.
    """
    try:
        child = subprocess.Popen(
            [sys.executable, "-m", "tui.jobs.worker", task_text(task)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError as error:
        what = f"no process can be started ({error.strerror or error})"
        yield Trouble(where, what, "end other programs, and try again")
        return
    heard: asyncio.Queue[bytes | int] = asyncio.Queue()
    # A thread is used instead of the loop's own subprocess, which must be awaited to its end, and
    # which a screen that is closed twice in a row leaves with open pipes.
    arguments = (child, heard, asyncio.get_running_loop())
    Thread(target=_listen, args=arguments, name="worker", daemon=True).start()
    try:
        while isinstance(text := await heard.get(), bytes):
            line = parse_line(text)
            if line is None:
                continue
            yield line
            if isinstance(line, Done | Trouble):
                return
        yield ended(text, where)
    finally:
        _end(child)


def _end(child: subprocess.Popen[bytes]) -> None:
    """End a process and its children."""
    with suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(child.pid, signal.SIGKILL)
        else:  # Windows; its children end with it
            child.kill()


def _listen(
    child: subprocess.Popen[bytes],
    heard: asyncio.Queue[bytes | int],
    loop: asyncio.AbstractEventLoop,
) -> None:
    """Pass on each line of a process, last its exit code; close its pipes."""
    with suppress(RuntimeError), child:  # the loop is closed
        assert child.stdout is not None
        for text in child.stdout:
            loop.call_soon_threadsafe(heard.put_nowait, text)
        loop.call_soon_threadsafe(heard.put_nowait, child.wait())


# The worker's end ---------------------------------------------------------------------------------


def main(argument: str) -> None:
    """Do one task and write its lines to stdout."""
    # Output of a library must not come between the lines.
    out = os.dup(1)
    os.dup2(2, 1)
    with suppress(OSError, AttributeError):
        os.nice(_NICE)
    Thread(target=_end_with_stdin, daemon=True).start()

    def send(line: Line) -> None:
        _write(out, line_bytes(line))

    task = parse_task(argument)
    try:
        send(Done(answer(task, send)))
    except Exception as error:
        send(trouble_of(error, _subject(task)))


def _end_with_stdin() -> None:
    while os.read(0, 4096):
        pass
    os._exit(1)


def _write(descriptor: int, data: bytes) -> None:
    while data:
        data = data[os.write(descriptor, data) :]


def _subject(task: Task) -> str:
    match task:
        case CompareTask():
            return ", ".join(Path(path).name for path in task.sessions)
        case ListTask():
            return task.folder
        case _:
            return task.session


def answer(task: Task, send: Send) -> dict[str, Any]:
    """Do a task in this process, send its progress, and return the answer."""
    match task:
        case IdentifyTask():
            return _identify(task, send)
        case ReportTask():
            return _report(task, send)
        case CompareTask():
            return _compare(task, send)
        case ExportTask():
            return _export(task)
        case ListTask():
            return _list(task, send)


def _identify(task: IdentifyTask, send: Send) -> dict[str, Any]:
    from daq import read_session
    from identify import identify

    from .outcome_of import outcome_of, without

    send(Progress(_READ, "reading"))
    session = without(read_session(task.session), task.without)
    result = identify(session, lambda share, text: send(Progress(share, text)))
    send(Progress(0.95, "drawing"))
    return asdict(outcome_of(task.session, session, result, task.without))


def _report(task: ReportTask, send: Send) -> dict[str, Any]:
    from .reporting import write_report

    sizes: dict[str, int] = {}

    def written(place: Path) -> None:
        sizes[str(place)] = place.stat().st_size

    def stage(share: float, text: str) -> None:
        send(Progress(share, text))

    pdf = Path(task.pdf) if task.pdf else None
    _, quality = write_report(Path(task.session), Path(task.html), pdf, stage, written)
    return {"files": sizes, "verdict": str(quality.verdict)}


def _compare(task: CompareTask, send: Send) -> dict[str, Any]:
    from identify.compare import compare

    from .comparing import comparison_lines, identified, labels_of

    def stage(done: float, text: str = "") -> None:
        send(Progress(done, text))

    stage(_READ, "reading")
    results = identified(task.sessions, stage)
    labels = labels_of([Path(path) for path in task.sessions])
    return {"lines": list(comparison_lines(compare(labels, results)))}


def _export(task: ExportTask) -> dict[str, Any]:
    from daq import read_session
    from daq.formats.export.export import ExportFormat, export_session

    form = ExportFormat(task.form)
    path = Path(task.session)
    place = path.with_suffix(form.suffix)
    done = export_session(read_session(path), place, form, force=task.replace)
    return {"paths": [str(path) for path in done.paths], "notes": list(done.notes)}


def _list(task: ListTask, send: Send) -> dict[str, Any]:
    from .session_list import sessions_in

    count = 0
    for entry in sessions_in(Path(task.folder)):
        send(Item(asdict(entry)))
        count += 1
    return {"count": count}


if __name__ == "__main__":
    main(sys.argv[1])
