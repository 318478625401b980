"""`bumpbench` on a disk that misbehaves: `python -m tests.daq.crash_recorder KIND NUMBER ...`.

The kinds are those of `FailingDisk`, whose operation of that number fails, and `small`: a disk with
room for so many bytes, until there is a file `more_room` in the working directory.  What follows
are the arguments of `bumpbench`.  In the environment, `HELD_BYTES` makes the memory smaller in
which blocks wait for the disk.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path

from daq.journal import segment as backlog
from daq.journal.segment import SyncedFile
from daq.recorder import recorder
from tui.cli import run

from .crash_disk import FailingDisk, SmallDisk
from .crash_jobs import die_with_parent

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


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
