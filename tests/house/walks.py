"""Traces a walk through the code while it runs: which files of the packages it passes."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).parents[2]
PACKAGES = tuple(str(ROOT / package) + "/" for package in ("dbc", "daq", "identify", "tui"))


@contextmanager
def walked() -> Iterator[set[str]]:
    """Yield the set of files in which a function is called until the `with` ends, in any thread.

    The bodies of modules and classes, which run once at an import, do not count.
    """
    files: set[str] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code.co_filename.startswith(PACKAGES) and code.co_flags & 2:
            files.add(str(Path(code.co_filename).relative_to(ROOT)))

    before = sys.getprofile()
    threading.setprofile(note)
    sys.setprofile(note)
    try:
        yield files
    finally:
        sys.setprofile(before)
        threading.setprofile(None)
