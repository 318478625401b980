"""Stores rows as they finish: one JSON line each, on the disk as soon as it is written."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Self

from dbc import InputError
from identify.batch import Cell

from .work import FAILED, software

_BEGINNING = b'{"file": "'
"""First bytes of each row."""


class RowJournal:
    """The rows of a batch, stored next to its table; rows are appended and never rewritten.

    The rest of a line that was being written when the process was killed is cut off.  One batch at
    a time may write.

    `path`: the file; created if necessary.  Raises InputError if it cannot be written, another
    batch is writing to it, or it is something else.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._stream = path.open("a+b")
        except OSError as error:
            raise InputError(
                str(path), error.strerror or "cannot be written", "choose another --out"
            ) from None
        try:
            _lock(self._stream)
        except OSError:
            self._stream.close()
            raise InputError(
                str(path), "another batch is writing to it", "wait for it, or choose another --out"
            ) from None
        try:
            self.verdicts = self._read()
        except InputError:
            self._stream.close()
            raise

    def append(self, row: dict[str, Cell]) -> None:
        """Add a row; it survives whatever happens after.

        Raises InputError if the disk is full.
        """
        try:
            self._stream.write(json.dumps(row, allow_nan=False).encode() + b"\n")
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise InputError(
                str(self.path),
                error.strerror or "cannot be written",
                "make room, and run the same command to continue",
            ) from None
        _note(self.verdicts, row)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file, which frees it for others."""
        self._stream.close()

    def _read(self) -> dict[str, str]:
        """Return hash to verdict of what is done with this version, and cut off a torn line.

        Nothing is cut from a file that has neither a row nor the beginning of one.
        """
        verdicts: dict[str, str] = {}
        whole = 0
        self._stream.seek(0)
        for number, line in enumerate(self._stream, start=1):
            if line.endswith(b"\n"):
                _note(verdicts, _row(self.path, number, line))
                whole += len(line)
            elif not whole and not _BEGINNING.startswith(line[: len(_BEGINNING)]):
                _row(self.path, number, line)
        self._stream.truncate(whole)
        return verdicts


def _note(verdicts: dict[str, str], row: dict[str, Cell]) -> None:
    """Note a result that need not be computed again; a failure may be due to the machine."""
    if row["verdict"] != FAILED and row["software"] == software():
        verdicts[str(row["sha256"])] = str(row["verdict"])


def rows_in(path: Path) -> Iterator[tuple[int, dict[str, Cell]]]:
    """Yield the place and the content of each row of a journal.

    Raises InputError with the number of a line that is not a row.
    """
    with path.open("rb") as stream:
        place = 0
        for number, line in enumerate(stream, start=1):
            yield place, _row(path, number, line)
            place += len(line)


def _row(path: Path, number: int, line: bytes) -> dict[str, Cell]:
    """Return the row in a line; raises InputError with its number if it is none."""
    try:
        row: dict[str, Cell] = json.loads(line)
        row["file"], row["sha256"], row["verdict"], row["software"]
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}:{number}", "is not a row of a batch", "choose another --out"
        ) from None
    return row


def _lock(stream: IO[bytes]) -> None:
    """Lock a file for this process, as long as it is open.

    Raises OSError if another process holds it.
    """
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows: two batches into one file are not detected there
        return
    fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
