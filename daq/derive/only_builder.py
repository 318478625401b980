"""Lets one process at a time build sessions in a folder.

A killed recorder leaves a builder that goes on to its end, and the next recorder, or `recover`,
would write to the same temporary files.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def only_builder(folder: Path, *, wait: bool = True) -> Iterator[bool]:
    """Hold the lock of a folder, which is the folder itself: it leaves no file.

    It ends with its process.  `wait`: False to yield False at once if another process, or another
    thread, holds it; else this waits.  Yields True, also where a folder cannot be locked (Windows,
    some network file systems).
    """
    try:
        import fcntl

        fd = os.open(folder, os.O_RDONLY)
    except (ModuleNotFoundError, OSError):
        yield True
        return
    try:
        yield _locked(fd, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    finally:
        os.close(fd)


def _locked(fd: int, operation: int) -> bool:
    import fcntl

    with suppress(OSError):  # no such lock there
        try:
            fcntl.flock(fd, operation)
        except BlockingIOError:
            return False
    return True
