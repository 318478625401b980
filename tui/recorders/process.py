"""Starts recorders from a terminal; they go on when it is closed or disconnected."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

from daq import InputError
from daq.control.address import group_readable

LOG = "recorder.log"
"""Name of the log in a recorder's folder."""

Process = subprocess.Popen[bytes]


def start_recorder(folder: Path, *arguments: str) -> Process:
    """Start the recorder of a folder; it runs until a client shuts it down.

    `folder`: for journal, sessions and the log.  `arguments`: further ones and options of
    `bumpbench record`.  Raises InputError if the folder or its log cannot be written.
    """
    log_path, nothing = folder / LOG, subprocess.DEVNULL
    command = [sys.executable, "-m", "tui", "record", "--keep-on", *arguments]
    command += ["--out", str(folder), "--log", str(log_path)]
    try:
        with group_readable():
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(log_path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)
        with os.fdopen(descriptor, "ab") as log:
            # Its own session: a signal that ends the terminal's processes does not reach it.
            return subprocess.Popen(
                command, stdin=nothing, stdout=nothing, stderr=log, start_new_session=True
            )
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(folder), reason, "name another folder") from error


def failure(process: Process, folder: Path) -> str:
    """Return why a started recorder has failed: the last line of its log; empty if it has not."""
    code = process.poll()
    if not code:
        return ""
    if code < 0:
        return f"the recorder was ended by {signal.Signals(-code).name}"
    lines = list[str]()
    with suppress(OSError):
        lines = (folder / LOG).read_text("utf-8", "replace").split("\n")
    last_line = next((line for line in reversed(lines) if line.strip()), "its log is empty")
    reason = last_line.rpartition("bumpbench: ")[2].removeprefix("error: ")
    return f"the recorder ended: {reason}"
