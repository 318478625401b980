"""Opens regular files only, so that nothing else under a file's name can hang or mislead a reader.

Opening a FIFO waits for a writer, reading a device may never end, and a symbolic link may lead to
either.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from .errors import InputError

_KINDS = {
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFDIR: "a directory",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
# Another file may take its place between the check and the opening; not on Windows.
_FLAGS = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


def open_regular(path: Path, advice: str) -> int:
    """Return a descriptor of a regular file, for reading.

    Raises InputError, with `advice`, if it is not a regular file or cannot be opened.
    """
    try:
        _check(path, path.lstat(), advice)
        fd = os.open(path, _FLAGS | getattr(os, "O_BINARY", 0))
        try:
            _check(path, os.fstat(fd), advice)
        except InputError:
            os.close(fd)
            raise
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), advice) from error
    return fd


def is_regular(path: Path) -> bool:
    """Return whether a path names a regular file, and not a symbolic link to one."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def _check(path: Path, found: os.stat_result, advice: str) -> None:
    kind = stat.S_IFMT(found.st_mode)
    if kind != stat.S_IFREG:
        raise InputError(str(path), f"is {_KINDS.get(kind, 'no file')}, not a file", advice)
