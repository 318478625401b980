"""Writes files atomically, complete or unchanged after a kill or a power cut; JSON without NaN."""

from __future__ import annotations

import glob
import hashlib
import json
import os
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any

from dbc.words import InputError


def strict(value: object) -> object:
    """Return a copy of a document in which every number that is not finite is None.

    JSON has no such numbers, and readers in other languages refuse NaN.  Arrays become lists.
    """
    match value:
        case Mapping():
            return {str(key): strict(item) for key, item in value.items()}
        case list() | tuple():
            return [strict(item) for item in value]
        case float():
            return value if isfinite(value) else None
        case _:
            as_list = getattr(value, "tolist", None)
            return value if as_list is None else strict(as_list())


def json_in_html(document: Mapping[str, object], **form: Any) -> str:
    """Return a document as JSON of which no text can end the HTML element that holds it.

    `form`: how `json.dumps` lays it out.
    """
    text = json.dumps(strict(document), allow_nan=False, **form)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def input_bytes(path: Path, advice: str, most_bytes: int = -1) -> bytes:
    """Return the first bytes of a file that a user names; all of them if `most_bytes` is -1.

    `advice`: what to name instead.  Raises InputError if the file is missing, empty, no regular
    file, or cannot be read.
    """
    where = str(path)
    try:
        if not path.is_file():
            problem = "is a directory" if path.is_dir() else "is not a regular file"
            raise InputError(where, problem if path.exists() else "no such file", advice)
        with path.open("rb") as file:
            content = file.read(most_bytes)
    except OSError as error:
        what = f"cannot be read: {error.strerror or error}"
        raise InputError(where, what, "check rights and disk") from error
    if not content:
        raise InputError(where, "is empty", "check that it is the right file")
    return content


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

    Every command replaces an existing file only after the explicit word ``--force`` (`replace`),
    because it may hold measured data or somebody's work.  Without it are made again: pages and
    figures, the table of a batch, and the session of a recording whose journal has it all.  What a
    command reads it never replaces.  `option`: that names the file.  `inputs`: files that are read.
    """
    if path.resolve() in {input_path.resolve() for input_path in inputs}:
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
    """Write a file that a user names, and its folder; an older one stays until it is whole.

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


@contextmanager
def replaced(targets: Sequence[Path]) -> Iterator[list[Path]]:
    """Move new files to their targets when the body of the `with` has written all of them.

    This is the only way in which a file is written anew.  Yields empty files to write to, in the
    folder of each target, with its ending and a random name.  The data are on the disk before a
    file gets its name, and the name when this returns.  Access rights of a replaced file stay; a
    link is replaced, not followed.  What a killed process left is deleted after an hour.  Raises
    OSError if a file cannot be written, synced or moved; targets not yet moved are unchanged.
    """
    new_files: list[Path] = []
    try:
        for target in targets:
            stem, suffix = glob.escape(target.stem), glob.escape(target.suffix)
            with suppress(OSError):
                for leftover in target.parent.glob(f".{stem}.*.tmp{suffix}"):
                    if time.time() - leftover.stat().st_mtime > 3600.0:  # s
                        leftover.unlink()
            new_file = target.parent / f".{target.stem}.{secrets.token_hex(8)}.tmp{target.suffix}"
            os.close(os.open(new_file, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666))
            new_files.append(new_file)
        yield list(new_files)
        for new_file, target in zip(new_files, targets, strict=True):
            with new_file.open("r+b") as file:
                sync_data(file.fileno())
            with suppress(OSError):  # a new file has the rights that the umask gives
                old_state = target.lstat()
                if stat.S_ISREG(old_state.st_mode):
                    new_file.chmod(stat.S_IMODE(old_state.st_mode))
        for new_file, target in zip(new_files, targets, strict=True):
            new_file.replace(target)
        for folder in {target.parent for target in targets}:
            sync_folder(folder)
    finally:
        for new_file in new_files:
            new_file.unlink(missing_ok=True)


def sync_data(fd: int) -> None:
    """Return when the data written to an open file are on the disk; its times may follow later.

    macOS has no fdatasync, and its fsync leaves the data in the drive's own memory: F_FULLFSYNC
    (fcntl(2) of macOS) does not.  A drive without F_FULLFSYNC is synced as on other systems.
    """
    with suppress(ModuleNotFoundError):  # Windows has no fcntl
        import fcntl

        full_sync: int | None = getattr(fcntl, "F_FULLFSYNC", None)
        if full_sync is not None:
            with suppress(OSError):
                fcntl.fcntl(fd, full_sync)
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
