"""A worker process as the terminal sees it: started, listened to, ended with the screen."""

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
    """Do a task in a process of its own; yield its lines, the last a `Done` or a `Trouble`.

    The process ends with the iteration, and with this process however that ends: it watches its
    standard input.

    `where`: what a process that ended without an answer was about, for the operator.
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
        what = f"no process to work in ({error.strerror or error})"
        yield Trouble(where, what, "end other programs, and try again")
        return
    heard: asyncio.Queue[bytes | int] = asyncio.Queue()
    # A thread, not the loop's own subprocess: that one must be awaited to its end, and is left with
    # open pipes by a screen that is closed twice in a row.
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
