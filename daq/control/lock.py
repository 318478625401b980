"""Allows one recorder for each folder, by a lock that is released when its process dies."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from ..errors import FolderLockedError, InputError
from ..files import write_text

_LOCK, _HOLDER = "recorder.lock", "recorder.pid"
"""Lock file, and file with the number of the process: some versions of filelock empty the lock
file."""
_UMASK = 0o027
"""Removes all rights of others: a recording belongs to its user and group, whatever the shell's
umask."""


@contextmanager
def group_readable() -> Iterator[None]:
    """Make new files of this process and its children have the mode 0640, and folders 0750."""
    umask = os.umask(_UMASK)
    try:
        yield
    finally:
        os.umask(umask)


@contextmanager
def lone_recorder(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which is created if it does not exist.

    A new folder in which nothing else was made is removed at the end: of a recorder that finds no
    bus, nothing is left.  Meanwhile files and folders are made as by `group_readable`.

    Raises FolderLockedError, with the number of the process, if another process holds the lock.
    Raises InputError if the folder cannot be written to.
    """
    lock, is_new = FileLock(folder / _LOCK, timeout=0), not folder.exists()
    with group_readable():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except Timeout as error:
            why = f"another recorder ({_holder(folder)}) writes there"
            advice = "watch it with `bumpbench tui`, or name another folder"
            raise FolderLockedError(str(folder), why, advice) from error
        except OSError as error:
            why = error.strerror or str(error)
            raise InputError(str(folder), why, "name another folder") from error
        try:
            with suppress(OSError):  # the journal reports a full disk
                write_text(folder / _HOLDER, f"{os.getpid()}\n")
            yield
        finally:
            with suppress(OSError):
                (folder / _HOLDER).unlink()
            with suppress(OSError):
                if is_new and [each.name for each in folder.iterdir()] == [_LOCK]:
                    (folder / _LOCK).unlink()
                    folder.rmdir()
            lock.release()


def is_locked(folder: Path) -> bool:
    """Return whether a process holds the lock of a folder; False if that cannot be known."""
    try:
        if (folder / _LOCK).exists():  # else it would be made here
            with FileLock(folder / _LOCK, timeout=0):
                pass
    except Timeout:
        return True
    except OSError:  # without access to the folder
        return False
    return False


def unreachable_words(folder: Path) -> str:
    """Return a text that the recorder of a folder cannot be reached; empty if none runs."""
    try:
        (folder / _LOCK).exists()
    except OSError as error:
        return f"its recorder cannot be reached: {error.strerror}"
    if not is_locked(folder):
        return ""
    return f"a recorder ({_holder(folder)}) writes there, but does not answer here"


def _holder(folder: Path) -> str:
    try:
        return f"pid {int((folder / _HOLDER).read_text('ascii')[:20])}"
    except (OSError, ValueError):
        return "pid unknown"
