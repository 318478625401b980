"""`bumpbench` on a disk that misbehaves: `python -m tests.daq.crash_recorder KIND NUMBER ...`.

The kinds are those of `FailingDisk`, whose operation of that number fails, and `small`: a disk with
room for so many bytes, until there is a file `more_room` in the working directory.  What follows
are the arguments of `bumpbench`.  In the environment, `HELD_BYTES` makes the memory smaller in
which blocks wait for the disk.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from daq.journal import segment as backlog
from daq.journal.segment import SyncedFile
from daq.recorder import recorder
from tui.cli import run

from .crash_frames import FailingDisk, SmallDisk

MORE_ROOM = Path("more_room")
_MORE_BYTES = 100_000_000


class _Refilled(SmallDisk):
    """A small disk that gets room when a file asks for it."""

    def create(self, path: Path) -> SyncedFile:
        if MORE_ROOM.exists():
            self.free = _MORE_BYTES
        return super().create(path)


def main(arguments: list[str]) -> int:
    """Run a command with a recorder on such a disk, and return its exit code."""
    die_with_parent()  # a campaign that is killed leaves no recorder behind
    kind, number, *command = arguments
    if held := os.environ.get("HELD_BYTES"):
        vars(backlog)["HELD_BYTES"] = int(held)
    if kind != "sound":
        disk = _Refilled(int(number)) if kind == "small" else FailingDisk(kind, int(number))
        vars(recorder)["Recorder"] = partial(recorder.Recorder, create=disk.create)
    return run(command)


def die_with_parent() -> None:
    """End this process as soon as the one that started it has ended; on Linux only."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
        if os.getppid() == 1:  # it ended while this process was starting
            sys.exit(1)


Part = Callable[[], Any]


def timed(part: Part) -> tuple[Any, str, float]:
    """Return the result of a part of a campaign, why it failed (empty if not), and its time, s."""
    began_s, result, failed = time.monotonic(), None, ""
    try:
        result = part()
    except AssertionError as error:
        failed = str(error) or repr(error)
    return result, failed, time.monotonic() - began_s


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
