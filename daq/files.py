"""Writes files atomically: after a kill or a power cut a file is either complete or unchanged."""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from .errors import InputError


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
    """Replace a file by one that holds `data`.

    The data are on the disk before the file is renamed, and the name is on the disk when this
    returns.  A partial file of a killed process is overwritten by the next write.  The access
    rights of the file do not change.

    Raises OSError if the write failed; the file is then unchanged.
    """
    with rewritten(path) as part:
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
def rewritten(path: Path) -> Iterator[Path]:
    """Move a new file into place when the body of the `with` has written it; as `write_bytes`.

    Yields the path to write to, in the same folder.
    """
    part = path.parent / f".{path.name}.tmp"
    with _moved([part], [path]):
        yield part


@contextmanager
def replaced(targets: Sequence[Path]) -> Iterator[list[Path]]:
    """Move new files to their targets when the body of the `with` has written all of them.

    Yields the paths to write to: in the folder of each target, with the same ending, because some
    writers choose the format by it.  Raises OSError if a file cannot be synced or moved.
    """
    parts = [p.parent / f".{p.stem}.{os.getpid()}.tmp{p.suffix}" for p in targets]
    with _moved(parts, targets):
        yield parts


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


def sync_file(path: Path) -> None:
    """Return when the content of a file is on the disk."""
    _sync(path, os.O_RDWR)


def sync_folder(folder: Path) -> None:
    """Return when the names in a folder are on the disk."""
    if os.name == "posix":  # other systems cannot open a folder
        _sync(folder, os.O_RDONLY)


@contextmanager
def _moved(parts: Sequence[Path], targets: Sequence[Path]) -> Iterator[None]:
    try:
        yield
        for part in parts:
            _sync(part, os.O_RDWR)
        for part, target in zip(parts, targets, strict=True):
            with suppress(OSError):  # a new file: as the umask sets
                part.chmod(stat.S_IMODE(target.stat().st_mode))
            part.replace(target)
        for folder in {target.parent for target in targets}:
            sync_folder(folder)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)


def _sync(path: Path, mode: int) -> None:
    fd = os.open(path, mode)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)
