"""Notes the blocks that this process runs; the marked sources of a recording call `mark`.

In a process that a test starts this file is imported as `mutate_probe`, from the copy of the tree:
such a process writes what it has run when it ends.  One that is killed leaves nothing.
"""

import atexit
import json
import os
from multiprocessing import util
from pathlib import Path

seen: set[str] = set()
mark = seen.add
CURRENT = "current test"
"""File with the name of the test that runs."""


class Child:
    """Records the blocks that a process started by a test runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.test = (folder / CURRENT).read_text("utf-8")

    def leave(self) -> None:
        """Write the blocks that were run."""
        part = self.folder / f"{os.getpid()}.part"
        part.write_text(json.dumps([self.test, sorted(seen)]), "utf-8")
        part.replace(part.with_suffix(".json"))  # it may be killed, or read, meanwhile


def record_children(folder: Path) -> None:
    """Let processes that are forked from this one leave what they have run."""

    def forked(_: object) -> None:
        seen.clear()
        util.Finalize(None, Child(folder).leave, exitpriority=0)

    util.register_after_fork(record_children, forked)


if __name__ == "mutate_probe":
    here = Path(__file__).parents[1] / "reached"
    atexit.register(Child(here).leave)
    record_children(here)
