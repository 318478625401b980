"""Writes files atomically: after a kill or a power cut a file is either complete or unchanged."""

from __future__ import annotations

import glob
import hashlib
import os
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from dbc.words import InputError


def make_room(path: Path) -> None:
    """Create the folder of a file that a user names, before long work: a wrong name fails at once.

    Raises InputError if it cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        raise InputError(str(path.parent), "is not a folder", "name another folder") from error
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), "name another file") from error


def refuse_existing(
    path: Path, *, replace: bool, option: str = "--out", inputs: Iterable[Path] = ()
) -> None:
    """Raise InputError if a file to write exists, is a folder or is read by the same command.

    This is the rule of every command: an existing file is replaced only after the explicit word
    ``--force`` (`replace`), because it may hold measured data or somebody's work.  Three kinds of
    files are made again without it, because nothing measured is in them: what is drawn for reading
    (pages, PDF, figures), the table of a batch beside the batch's own rows, and the session of a
    recording whose journal still has all that the session has.  What a command reads it
    never replaces.  `option`: the option that names the file.  `inputs`: files that are read.
    """
    place = path.resolve()
    if any(place == one.resolve() for one in inputs):
        raise InputError(str(path), "is read here", f"name another file with {option}")
    if path.is_dir():
        raise InputError(str(path), "is a directory", f"name a file with {option}")
    if os.path.lexists(path) and not replace:
        advice = f"name another file with {option}, or use --force"
        raise InputError(str(path), "exists already", advice)


def write_bytes(path: Path, data: bytes | memoryview) -> None:
    """Replace a file by one that holds `data`; as `replaced`."""
    with replaced([path]) as (part,):
        part.write_bytes(data)


def write_named(path: Path, data: bytes) -> None:
    """Write a file that a user names, and its folder; an older one stays complete until then.

    Raises InputError if it cannot be written.
    """
    make_room(path)
    try:
        write_bytes(path, data)
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), "name another file") from error


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_text(path: Path, text: str) -> None:
    """Replace a file by one that holds `text` in UTF-8; as `write_bytes`."""
    write_bytes(path, text.encode())


@contextmanager
def replaced(targets: Sequence[Path]) -> Iterator[list[Path]]:
    """Move new files to their targets when the body of the `with` has written all of them.

    This is the only way in which a file is written anew.  Yields empty files to write to, in the
    folder of each target, with its ending and a random name (``O_EXCL``).  The data
    are on the disk before a file gets its name, and the name when this returns.  Access rights of
    a replaced file stay; a link is replaced, not followed.  A later write deletes what a killed
    process left.  Raises OSError if a file cannot be written, synced or moved; the targets are
    then unchanged.
    """
    parts: list[Path] = []
    try:
        for target in targets:
            # What a killed process left is deleted: no file is written for an hour.
            stem, suffix = glob.escape(target.stem), glob.escape(target.suffix)
            with suppress(OSError):
                for old in target.parent.glob(f".{stem}.*.tmp{suffix}"):
                    if time.time() - old.stat().st_mtime > 3600.0:
                        old.unlink()
            part = target.parent / f".{target.stem}.{secrets.token_hex(8)}.tmp{target.suffix}"
            fd = os.open(part, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
            parts.append(part)
            with suppress(OSError):  # a new file: as the umask sets
                before = target.lstat()
                if stat.S_ISREG(before.st_mode):
                    part.chmod(stat.S_IMODE(before.st_mode) | stat.S_IWUSR)
            os.close(fd)
        yield list(parts)
        for part in parts:
            with part.open("r+b") as file:
                os.fsync(file.fileno())
        for part, target in zip(parts, targets, strict=True):
            with suppress(OSError):
                before = target.lstat()
                if stat.S_ISREG(before.st_mode):
                    part.chmod(stat.S_IMODE(before.st_mode))
            part.replace(target)
        for folder in {target.parent for target in targets}:
            sync_folder(folder)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)


def sync_data(fd: int) -> None:
    """Return when the data written to an open file are on the disk; its times may follow later.

    macOS has no fdatasync, and its fsync leaves the data in the drive's own memory: F_FULLFSYNC
    (fcntl(2) of macOS) does not.  A drive without F_FULLFSYNC is synced as on other systems.
    """
    with suppress(ModuleNotFoundError):  # Windows has no fcntl
        import fcntl

        whole: int | None = getattr(fcntl, "F_FULLFSYNC", None)
        if whole is not None:
            with suppress(OSError):
                fcntl.fcntl(fd, whole)
                return
    getattr(os, "fdatasync", os.fsync)(fd)


def sync_folder(folder: Path) -> None:
    """Return when the names in a folder are on the disk."""
    if os.name == "posix":  # other systems cannot open a folder
        fd = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def is_regular(path: Path) -> bool:
    """Return whether a path names a regular file, and not a symbolic link to one."""
    return path.is_file() and not path.is_symlink()


def open_regular(path: Path, advice: str) -> int:
    """Return a descriptor of a regular file, for reading: a FIFO would wait for a writer.

    Raises InputError, with `advice`, if it is not a regular file or cannot be opened.
    """
    if os.path.lexists(path) and not is_regular(path):
        raise InputError(str(path), "is not a regular file", advice)
    try:
        return os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), advice) from error
