"""Starts a display beside a recorder or a terminal, and ends it with them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

from daq import InputError

from ..terminal.words import DisplayLink

_END_S = 2.0
"""Time that a display may take to end, s; it takes 0.1."""


@contextmanager
def display_beside_recorder(folder: Path, host: str | None, control: bool) -> Iterator[None]:
    """Serve the display of a recorder; it writes link and code to the recorder's stderr.

    Nothing waits for it.  `host`: as of `tui.display.link.listen_on`; None for no display.  Raises
    InputError if it cannot listen there.
    """
    if not _is_wanted(host, control):
        yield
        return
    with _display(folder, str(host), "display", control, subprocess.DEVNULL, None):
        yield


@contextmanager
def display_beside_terminal(
    folder: Path, host: str | None, operator: str, control: bool
) -> Iterator[DisplayLink | None]:
    """Serve the display of a folder's recorder; yield how to open it, None if none is wanted.

    Parameters and errors are those of `display_beside_recorder`.
    """
    if not _is_wanted(host, control):
        yield None
        return
    from .link import Served

    with (
        TemporaryFile("w+") as errors,  # not a pipe, which somebody would have to read
        _display(folder, str(host), operator, control, subprocess.PIPE, errors) as process,
    ):
        assert process.stdout is not None
        if not (line := process.stdout.readline()):
            errors.seek(0)
            lines = errors.read().strip().splitlines() or ["it did not start"]
            raise InputError("display", lines[-1], "start it alone: bumpbench display")
        served = Served(**json.loads(line))
        yield DisplayLink(tuple(served.lines(colours=False)), served.code)


def _is_wanted(host: str | None, control: bool) -> bool:
    """Return True if a display is wanted; raise InputError if it cannot be served."""
    if host is None:
        if control:
            raise InputError("--control", "needs a display", "add --display lan")
        return False
    try:
        from .link import listen_on
    except ImportError as error:
        reason = "aiohttp is not installed"
        raise InputError("--display", reason, "install bumpbench[web]") from error
    listen_on(host)[1].close()
    return True


@contextmanager
def _display(
    folder: Path, host: str, operator: str, control: bool, stdout: int, stderr: IO[str] | None
) -> Iterator[subprocess.Popen[str]]:
    """Run a display until the block ends: its stdin closes, also if this process is killed."""
    words = ["display", str(folder.resolve()), "--display", host, "--operator", operator, "--json"]
    command = [sys.executable, "-m", "tui", *words, *(["--control"] if control else [])]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=stdout, stderr=stderr, text=True) as process:
        try:
            yield process
        finally:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
