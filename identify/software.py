"""The version and the hash of the program that makes the numbers."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path

import daq
import dbc

VERSION = "0.1.0"
"""That of pyproject.toml; to look it up in the installed metadata loads a reader of e-mail."""

_PACKAGES = (Path(dbc.__file__).parent, Path(daq.__file__).parent, Path(__file__).parent)

_KINDS = (".py", ".toml", ".dbc")
"""Endings of the files that affect the numbers; compiled copies and pages do not."""


@cache
def software_sha256() -> str:
    """Return the hash of the modules of `dbc`, `daq` and `identify` and their shipped tables.

    A version says which program it should be; the hash also shows a change made in place.
    """
    return hash_of(_PACKAGES)


def hash_of(folders: Sequence[Path]) -> str:
    """Return SHA-256 over names and contents of those files in some folders."""
    whole = sha256()
    for folder in folders:
        for path in sorted(_files(folder)):
            name, content = path.removeprefix(f"{folder.parent}/").encode(), Path(path).read_bytes()
            whole.update(b"%s\0%d\0%s" % (name, len(content), content))
    return whole.hexdigest()


def _files(folder: Path) -> Iterator[str]:
    """Yield the files of those kinds; `Path.rglob` takes as long as to read them."""
    for place, _, names in os.walk(folder):
        yield from (f"{place}/{name}" for name in names if name.endswith(_KINDS))
