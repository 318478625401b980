"""Starts a worker process for the terminal, passes on its lines, and ends it with the screen."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator
from contextlib import suppress
from threading import Thread

from .lines import Done, Line, Task, Trouble, ended, parse_line, task_text


async def lines_of(task: Task, where: str) -> AsyncGenerator[Line, None]:
    """Do a task in a separate process; yield its lines, the last a `Done` or a `Trouble`.

    The process ends with the iteration, and also when this process ends in any way, because it
    watches its standard input.  `where`: subject of the error for the operator if the process ends
    without an answer.
    """
    try:
        child = subprocess.Popen(
            [sys.executable, "-m", "tui.jobs.work", task_text(task)],
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
