"""Files that are complete or absent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ...errors import InputError
from ...files import replaced


@contextmanager
def written_whole(targets: Sequence[Path], force: bool) -> Iterator[list[Path]]:
    """Let files be written beside their places; they are moved there when all are done.

    `targets`: where they shall be.  `force`: whether files that are there may be replaced.  Yields
    the paths to write to: same folder, same suffix.  Raises InputError if one is there already, or
    cannot be written.
    """
    for target in targets:
        if not target.parent.is_dir():
            raise InputError(str(target), "there is no such folder", "make it, or name another")
        if target.is_dir():
            raise InputError(str(target), "is a directory", "name a file")
        if target.exists() and not force:
            advice = "name another file with --out, or say --force"
            raise InputError(str(target), "is there already", advice)
    try:
        with replaced(targets) as parts:
            yield parts
    except OSError as error:
        what = f"cannot be written: {error.strerror or error}"
        advice = "check folder, rights and free space"
        raise InputError(str(targets[0]), what, advice) from error
