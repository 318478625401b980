"""Does long work of the terminal in a separate process: `python -m tui.jobs.work TASK`.

TASK is JSON (`lines.task_text`); every line on stdout is a `lines.Line`.  The process
ends when its standard input does: a terminal that is killed leaves no work behind.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
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
    line_bytes,
    parse_task,
    trouble_of,
)

Send = Callable[[Line], None]
_NICE = 10
"""Niceness of the worker: the recorder has priority."""
_READ = 0.05


def main(argument: str) -> None:
    """Do one task and write its lines to stdout."""
    # Output of a library must not come between the lines.
    out = os.dup(1)
    os.dup2(2, 1)
    with suppress(OSError, AttributeError):
        os.nice(_NICE)
    threading.Thread(target=_end_with_stdin, daemon=True).start()

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

    from .comparing import identified
    from .comparison_rows import comparison_lines

    def stage(done: float, text: str = "") -> None:
        send(Progress(done, text))

    stage(_READ, "reading")
    results = identified(task.sessions, stage)
    labels = [f"{i + 1} {Path(path).stem}" for i, path in enumerate(task.sessions)]
    return {"lines": list(comparison_lines(compare(labels, results)))}


def _export(task: ExportTask) -> dict[str, Any]:
    from daq import read_session
    from daq.formats import ExportFormat, export_session

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
