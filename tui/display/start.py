"""Starts a display next to a recorder or a terminal, and ends it with them."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from daq import InputError

from ..terminal.state.display_link import DisplayLink
from .served import Served

_END_S = 2.0
"""Time that a display may take to end, s; it takes 0.1."""


@contextmanager
def display_beside_recorder(folder: Path, host: str | None, control: bool) -> Iterator[None]:
    """Serve the display of a recorder in this process; the display writes link and code to stderr.

    Nothing waits for it.  `host`: as of `tui.display.link.address_of`; None for no display.  Raises
    InputError if it cannot listen there.
    """
    if _wanted(host, control):
        with _ending(_start(folder, str(host), "display", control, subprocess.DEVNULL, None)):
            yield
    else:
        yield


@contextmanager
def display_beside_terminal(
    folder: Path, host: str | None, operator: str, control: bool
) -> Iterator[DisplayLink | None]:
    """Serve the display of a folder's recorder; yield how to open it, None if none is wanted.

    Parameters and errors are those of `display_beside_recorder`.
    """
    if not _wanted(host, control):
        yield None
        return
    from .link import is_loopback, link_lines, qr_lines

    process = _start(folder, str(host), operator, control, subprocess.PIPE, subprocess.PIPE)
    with _ending(process):
        assert process.stdout is not None
        assert process.stderr is not None
        if not (line := process.stdout.readline()):
            said = process.stderr.read().strip().splitlines() or ["it did not start"]
            raise InputError("display", said[-1], "start it alone: bumpbench display")
        served = Served(**json.loads(line))
        words = tuple(link_lines(served, colours=False))
        code = () if is_loopback(served.host) else tuple(qr_lines(served.link))
        yield DisplayLink(words, code)


def _wanted(host: str | None, control: bool) -> bool:
    """Return True if a display is wanted.

    Raises InputError if it cannot be served.
    """
    if host is None:
        if control:
            raise InputError("--display-control", "needs a display", "add --display lan")
        return False
    try:
        from .link import address_of, port_of
    except ImportError as error:
        raise InputError(
            "--display", "aiohttp is not installed", "install bumpbench[web]"
        ) from error
    port_of(address_of(host))
    return True


def _start(
    folder: Path, host: str, operator: str, control: bool, stdout: int, stderr: int | None
) -> subprocess.Popen[str]:
    arguments = ["--host", host, "--operator", operator, *(["--control"] if control else [])]
    return subprocess.Popen(
        [sys.executable, "-m", "tui.display.attached", str(folder.resolve()), *arguments],
        stdin=subprocess.PIPE,
        stdout=stdout,
        stderr=stderr,
        text=True,
    )


@contextmanager
def _ending(process: subprocess.Popen[str]) -> Iterator[None]:
    """End a display when the block ends: its stdin closes, also if this process is killed."""
    with process:
        try:
            yield
        finally:
            assert process.stdin is not None
            process.stdin.close()
            try:
                process.wait(_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
