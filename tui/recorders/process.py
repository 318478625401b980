"""Starts recorders from a terminal; they go on when it is closed or disconnected."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

LOG = "recorder.log"

Process = subprocess.Popen[bytes]


def start_recorder(
    bench: Path | None, folder: Path, interface: str | None = None, channel: str | None = None
) -> Process:
    """Start the recorder of a folder, idle; it runs until a client shuts it down.

    `bench`: bench.toml; the shipped one if None.  `folder`: for journal, sessions and the log.
    `interface` and `channel`: replace those of the file.
    """
    arguments = ["tui", "record", *([str(bench.resolve())] if bench else [])]
    arguments += ["--out", str(folder.resolve()), "--keep-on", "--idle"]
    arguments += ["--log", str(folder.resolve() / LOG)]
    arguments += ["--interface", interface] if interface else []
    arguments += ["--channel", channel] if channel else []
    return _start(arguments, folder)


def start_demo_recorder(folder: Path, speed: float, fault: str, bench: Path | None) -> Process:
    """Start a recorder on a simulated bench, which bumps its car whenever a run is armed.

    `speed`: simulated seconds per second.  `fault`: fault that spoils a run (`daq.sim.bench`);
    empty for nothing.  `bench`: the shipped one if None.
    """
    arguments = ["tui.recorders.played", "demo", str(folder.resolve()), "--speed", f"{speed:g}"]
    arguments += ["--fault", fault] if fault else []
    arguments += ["--bench", str(bench.resolve())] if bench else []
    return _start([*arguments, "--log", str(folder.resolve() / LOG)], folder)


def start_replay_recorder(folder: Path, session: Path, speed: float) -> Process:
    """Start a recorder on the frames of a recorded session."""
    arguments = ["tui.recorders.played", "replay", str(folder.resolve()), str(session.resolve())]
    return _start([*arguments, "--speed", f"{speed:g}"], folder)


def failure(process: Process, folder: Path) -> str:
    """Return why a started recorder has failed, in words; empty while it runs or after its end."""
    code = process.poll()
    if not code:
        return ""
    if code < 0:
        return f"the recorder was ended by {signal.Signals(-code).name}"
    return f"the recorder ended: {last_line(folder)}"


def last_line(folder: Path) -> str:
    """Return the last line of a recorder's log; it says why the recorder ended."""
    try:
        text = (folder / LOG).read_text("utf-8", "replace")
    except OSError:
        return "no log"
    lines = [line for line in text.split("\n") if line.strip()]
    if not lines:
        return "its log is empty"
    stamp, _, line = lines[-1].partition("bumpbench: ")
    return (line or stamp).removeprefix("error: ")


def _start(arguments: list[str], folder: Path) -> Process:
    from daq import InputError
    from daq.control.address import group_readable

    from .log import require_log

    require_log(folder / LOG)
    try:
        with group_readable():
            folder.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(folder / LOG, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o640)
        with os.fdopen(descriptor, "ab") as log:
            # Its own session: a signal that ends the terminal's processes does not reach it.
            return subprocess.Popen(
                [sys.executable, "-m", *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,
            )
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(str(folder), reason, "name another folder") from error
