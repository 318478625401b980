"""A worker process as the terminal sees it: started, listened to, ended with the screen."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import AsyncGenerator
from contextlib import suppress

from .lines import Done, Line, Task, Trouble, ended, parse_line, task_text

_LONGEST_LINE = 64 << 20
"""A whole answer is one line."""


async def lines_of(task: Task, where: str) -> AsyncGenerator[Line, None]:
    """Do a task in a process of its own; yield its lines, the last a `Done` or a `Trouble`.

    The process ends with the iteration, and with this process however that ends: it watches its
    standard input.

    Parameters
    ----------
    task : Task
        What to do.
    where : str
        What a process that ended without an answer was about, for the operator.
    """
    try:
        child = await asyncio.create_subprocess_exec(
            sys.executable,
            *("-m", "tui.workers.work", task_text(task)),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
            limit=_LONGEST_LINE,
            start_new_session=True,
        )
    except OSError as error:
        what = f"no process to work in ({error.strerror or error})"
        yield Trouble(where, what, "end other programs, and try again")
        return
    assert child.stdout is not None
    try:
        async for text in child.stdout:
            line = parse_line(text)
            if line is None:
                continue
            yield line
            if isinstance(line, Done | Trouble):
                return
        yield ended(await child.wait(), where)
    finally:
        await _end(child)


async def _end(child: asyncio.subprocess.Process) -> None:
    """End a process and its children, and close its pipes."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(child.pid, signal.SIGKILL)
    await child.communicate()
