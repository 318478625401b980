"""Reads TOML files that persons write: limits their size, and names the key of a mistake."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Never, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from dbc.words import InputError

MAX_CONFIG_BYTES = 1_000_000
"""Largest size of a bench.toml or channel map, bytes."""
STRICT = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
"""Refuses keys that are not known, and numbers that are not finite."""


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = STRICT


def _refused_key(_: object) -> Never:
    """Raise the error of an unknown key."""
    raise PydanticCustomError("extra_forbidden", "it cannot be stated")


NO_KEY = BeforeValidator(_refused_key)
"""Marks a field of a table that is set by the program: as a key in the file it is unknown."""

_File = TypeVar("_File")
_UNKNOWN_KEY = ("extra_forbidden", "unexpected_keyword_argument")
"""Pydantic's types of the error of an unknown key: in a model, and in a dataclass."""


def toml_text(path: Path, advice: str) -> str:
    """Return the text of a file.

    Raises InputError, with `advice`, if it cannot be read, is no file, is too large or not UTF-8.
    """
    try:
        if path.exists() and not path.is_file():  # a FIFO waits for ever, a device never ends
            fault = "is a directory" if path.is_dir() else "is not a regular file"
            raise InputError(str(path), fault, advice)
        if path.stat().st_size > MAX_CONFIG_BYTES:
            raise InputError(str(path), "is larger than 1 MB", advice)
        return path.read_text("utf-8-sig")
    except OSError as error:
        raise InputError(str(path), error.strerror or str(error), advice) from error
    except UnicodeDecodeError as error:
        raise InputError(str(path), "is not UTF-8 text", "save it as UTF-8") from error


def toml_tables(text: str, where: str) -> dict[str, Any]:
    """Return the tables of a TOML text; `where`: its name, for messages.

    Raises InputError if it is not TOML, or has `true` for a number, or a NUL, which HDF5 refuses.
    """
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        fault = str(error)
        if line := re.search(r" \(at line (\d+), column (\d+)\)", fault):
            where, fault = f"{where}:{line[1]}", f"{fault[: line.start()]}, column {line[2]}"
        raise InputError(where, f"is not TOML: {fault}", "correct that line") from error
    for path, value in _values(document, ()):
        fault = "has the character NUL" if isinstance(value, str) and "\0" in value else ""
        if isinstance(value, bool) and "structure" not in path:
            fault = "is true or false, not a number or a text"
        if fault:
            raise InputError(where, f"{key_at(document, path)}: {fault}", "correct that value")
    return document


def _values(value: object, path: tuple[str | int, ...]) -> Iterator[tuple[Any, object]]:
    """Yield each value within tables and arrays, with its path of keys and positions."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _values(item, (*path, key))
    elif isinstance(value, list):
        for position, item in enumerate(value):
            yield from _values(item, (*path, position))
    else:
        yield path, value


def validated(document: Mapping[str, Any], where: str, model: TypeAdapter[_File]) -> _File:
    """Return the tables of a TOML text as an object of the class of `model`.

    `where`: its name, for messages.  Raises InputError with file and key.
    """
    try:
        return model.validate_python(document)
    except ValidationError as error:
        mistake, *others = error.errors(include_url=False)
        if mistake["type"] == "missing":  # rather an unknown key of its table: a misspelt one
            of_table = (o for o in others if o["loc"][:-1] == mistake["loc"][:-1])
            mistake = next((o for o in of_table if o["type"] in _UNKNOWN_KEY), mistake)
        key = key_at(document, mistake["loc"])
        fault = mistake["msg"].removeprefix("Value error, ")  # prefix for errors of our own checks
        fault = fault.replace("Input should be", "must be").replace("tuple", "list")
        fault, advice = f"{key}: {fault.partition(', unable to parse')[0]}", "correct that value"
        if mistake["type"] in _UNKNOWN_KEY:
            fault, advice = f"unknown key {key}", "remove it or correct its name"
        elif mistake["type"] == "missing":
            fault, advice = f"{key} is missing", "state it"
        raise InputError(where, fault, advice) from error


def key_at(document: Mapping[str, Any], path: Sequence[str | int]) -> str:
    """Return the key at a path: ``channel.acc_fl.gain``, ``weight.2.mass_kg``.

    `path`: keys, and positions from 0 in arrays, as Pydantic returns them.  A table of an array
    has its name, or its number from 1.
    """
    value: Any = document
    words = []
    for key in path:
        if isinstance(key, int) and not isinstance(value, list):
            continue  # the only table of its kind, outside an array
        try:
            value = value[key]
        except (LookupError, TypeError):
            value = None
        is_named = isinstance(key, int) and isinstance(value, dict) and "name" in value
        words.append(str(value["name"] if is_named else key + 1 if isinstance(key, int) else key))
    return ".".join(words) or "the file"
