"""Gives a folder its one recorder: a lock, and a socket in a directory of a single user.

A directory is used only if it certainly belongs to this user: made by this user, not a symbolic
link, and not writable by others.  No directory has a fixed name in the system's folder for
temporary files, where another user could create it first.
"""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path

from filelock import FileLock, Timeout

from dbc.words import BumpbenchError, InputError

_DIRECTORY = "RUNTIME_DIRECTORY"
_SERVICE = Path("/run/bumpbench")
"""Directory that systemd makes for the unit; only root can make a directory there."""


class FolderLockedError(BumpbenchError):
    """Another recorder writes to this folder."""


def control_address(folder: Path) -> Path:
    """Return the socket of the recorder of a folder; the future one if none runs.

    It is in systemd's `RUNTIME_DIRECTORY` if that is set, else below the home directory: it has to
    outlive the login from which the recorder was started.  A client looks for that of the service
    first.

    Raises InputError if the directory cannot be used: it cannot be made, belongs to another user,
    or can be written by others; or if the name of the folder is not UTF-8.
    """
    if not hasattr(os, "getuid"):
        why = "has no sockets that only one user can reach"
        raise InputError("this system", why, "run the recorder on Linux or macOS")
    folder = folder.resolve()
    try:
        name = sha256(str(folder).encode()).hexdigest()[:16] + ".socket"
    except UnicodeEncodeError as error:
        raise InputError(str(folder), "has a name that is not UTF-8", "rename it") from error
    owners = {os.getuid()}
    with suppress(OSError):
        owners.add(folder.stat().st_uid)  # the user of the service, if it is another
    if _ownership_fault(_SERVICE, owners) == "" and is_running(_SERVICE / name):
        return _SERVICE / name
    state = Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser()
    of_systemd = os.environ.get(_DIRECTORY, "").split(":")[0]
    directory = Path(of_systemd) if of_systemd else state / "bumpbench" / "run"
    _make_private(directory)
    return directory / name


def is_running(address: Path) -> bool:
    """Return whether a recorder listens at an address."""
    with socket.socket(socket.AF_UNIX) as probe, suppress(OSError):
        probe.settimeout(1.0)
        probe.connect(str(address))
        return True
    return False


def _make_private(directory: Path) -> None:
    """Make a directory that no other user can enter, or check that it is one."""
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        directory.mkdir(mode=0o700, exist_ok=True)
        if fault := _ownership_fault(directory, {os.getuid()}):
            advice = f"set {_DIRECTORY} to a directory of your own"
            raise InputError(str(directory), fault, advice)
        directory.chmod(0o700)
    except OSError as error:
        why = error.strerror or str(error)
        raise InputError(str(directory), why, f"set {_DIRECTORY} to another directory") from error


def _ownership_fault(directory: Path, owners: set[int]) -> str:
    """Return why a directory is not certainly private to its owner; empty if it is."""
    try:
        status = directory.lstat()
    except OSError as error:
        return error.strerror or str(error)
    if not stat.S_ISDIR(status.st_mode):
        return "is a link, not a directory"
    if status.st_uid not in owners:
        return "belongs to another user"
    return "can be written by others" if status.st_mode & 0o022 else ""


# Allows one recorder for each folder, by a lock that is released when its process dies ------------

_LOCK = "recorder.lock"


@contextmanager
def group_readable() -> Iterator[None]:
    """Make new files of this process and its children have the mode 0640, and folders 0750."""
    # A recording belongs to its user and group, whatever the shell's umask.
    umask = os.umask(0o027)
    try:
        yield
    finally:
        os.umask(umask)


@contextmanager
def lone_recorder(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which is created if it does not exist.

    Meanwhile files and folders are made as by `group_readable`.

    Raises FolderLockedError if another process has it, InputError if the folder is not writable.
    """
    lock = FileLock(folder / _LOCK, timeout=0)
    with group_readable():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            acquired = lock.acquire()
        except Timeout as error:
            why = "another recorder writes there"
            advice = "watch it with `bumpbench tui`, or name another folder"
            raise FolderLockedError(str(folder), why, advice) from error
        except OSError as error:
            why = error.strerror or str(error)
            raise InputError(str(folder), why, "name another folder") from error
        with acquired:
            yield


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
        with suppress(FileNotFoundError, NotADirectoryError):
            (folder / _LOCK).stat()  # `exists` is silent about a folder without access
    except OSError as error:
        return f"its recorder cannot be reached: {error.strerror}"
    return "a recorder writes there, but does not answer here" if is_locked(folder) else ""
