"""Reads TOML files that persons write; limits their size and refuses unknown keys."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from ..errors import InputError
from .bench_tables import Table
from .mistakes import mistake, not_toml

MAX_CONFIG_BYTES = 1_000_000
"""Largest size of a bench.toml or channel map, bytes."""

_AnyTable = TypeVar("_AnyTable", bound=Table)


def toml_text(path: Path, advice: str) -> str:
    """Return the text of a file.

    Raises InputError, with `advice`, if it cannot be read, is no file, is too large or not UTF-8.
    """
    try:
        if path.exists() and not path.is_file():  # a FIFO waits for ever, a device never ends
            what = "is a directory" if path.is_dir() else "is not a regular file"
            raise InputError(str(path), what, advice)
        if path.stat().st_size > MAX_CONFIG_BYTES:
            raise InputError(str(path), "is larger than 1 MB", advice)
        return path.read_text("utf-8-sig")
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), advice) from error
    except UnicodeDecodeError as error:
        raise InputError(str(path), "is not UTF-8 text", "save it as UTF-8") from error


def holds_toml(path: Path) -> bool:
    """Return whether a file within the size limit holds tables of TOML.  Raises OSError."""
    with path.open("rb") as file:
        head = file.read(MAX_CONFIG_BYTES + 1)
    try:
        return len(head) <= MAX_CONFIG_BYTES and bool(tomllib.loads(head.decode("utf-8-sig")))
    except (ValueError, RecursionError):
        return False


def validated(text: str, where: str, model: type[_AnyTable]) -> _AnyTable:
    """Return the tables of a TOML text.

    `where`: its name, for messages.  Raises InputError with file, line and key.
    """
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise not_toml(error, where) from error
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise mistake(error, text, where, Table.__subclasses__()) from error
