"""The addresses of a folder's recorder: two sockets in a directory of this user alone."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from ..errors import InputError

MAX_PATH_BYTES = 100
"""Longest path of a Unix socket, bytes: the kernel truncates it at 108 without an error."""
_DIRECTORY = "RUNTIME_DIRECTORY"


@dataclass(frozen=True, slots=True)
class Address:
    """Endpoints of one recorder."""

    control: str
    """``ipc://`` endpoint of requests and replies."""
    news: str
    """``ipc://`` endpoint of published messages."""

    @property
    def paths(self) -> tuple[Path, Path]:
        """The files of the two sockets."""
        return Path(self.control.removeprefix("ipc://")), Path(self.news.removeprefix("ipc://"))


def control_address(folder: Path) -> Address:
    """Return the address of a folder's recorder; its directory is made if it is not there.

    The directory is systemd's `RUNTIME_DIRECTORY` if that is set, else one in /tmp, and not the
    user's run-time directory, which is deleted when the last login ends: a recorder outlives it.

    Raises InputError if the directory cannot be made, belongs to another user, or its path is too
    long; or if the name of the folder is not UTF-8.
    """
    if not hasattr(os, "getuid"):
        what = "has no sockets that only one user can reach"
        raise InputError("this system", what, "run the recorder on Linux or macOS")
    try:
        str(folder.resolve()).encode()
    except UnicodeEncodeError as error:
        raise InputError(str(folder), "has a name that is not UTF-8", "rename it") from error
    named = os.environ.get(_DIRECTORY, "").split(":")[0]
    directory = Path(named) if named else Path("/tmp", f"bumpbench-{os.getuid()}")
    _make_private(directory)
    name = sha256(os.fsencode(folder.resolve())).hexdigest()[:16]
    control, news = directory / f"{name}.control", directory / f"{name}.news"
    if len(os.fsencode(control)) > MAX_PATH_BYTES:
        advice = f"set {_DIRECTORY} to a shorter path"
        raise InputError(str(directory), "is too long for the path of a socket", advice)
    return Address(f"ipc://{control}", f"ipc://{news}")


def _make_private(directory: Path) -> None:
    """Make a directory that no other user can enter, or check that it is one."""
    try:
        directory.mkdir(mode=0o700, exist_ok=True)
        found = directory.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
            advice = f"set {_DIRECTORY} to a directory of your own"
            raise InputError(str(directory), "belongs to somebody else", advice)
        if stat.S_IMODE(found.st_mode) & 0o077:
            directory.chmod(0o700)
    except OSError as error:
        what = error.strerror or str(error)
        raise InputError(str(directory), what, f"set {_DIRECTORY} to another directory") from error
