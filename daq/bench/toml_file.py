"""Reads TOML files that persons write: limits their size, and names the line of a mistake."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from ..errors import InputError
from .bench_tables import Table

MAX_CONFIG_BYTES = 1_000_000
"""Largest size of a bench.toml or channel map, bytes."""

Place = tuple[str | int, ...]
"""Keys and positions that lead to a value."""

_AnyTable = TypeVar("_AnyTable", bound=Table)
_HEADER = re.compile(r"\s*\[(\[?)\s*([^\[\]]+?)\s*\]")
_KEY = re.compile(r"""\s*([\w.'"-]+)\s*=""")
_QUOTED = re.compile(r"'([^']*)'")
_AT_LINE = re.compile(r" \(at line (\d+), column (\d+)\)")


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
        what = str(error)
        if at := _AT_LINE.search(what):
            where, what = f"{where}:{at[1]}", f"{what[: at.start()]}, column {at[2]}"
        raise InputError(where, f"is not TOML: {what}", "correct that line") from error
    try:
        return model.model_validate(document)
    except ValidationError as error:
        raise _mistake(error, text, where) from error


def _mistake(error: ValidationError, text: str, where: str) -> InputError:
    """Return the first mistake in one line; before a missing key, an unknown one of its table."""
    first, *others = error.errors(include_url=False)
    if first["type"] == "missing":
        for other in others:
            if other["type"] == "extra_forbidden" and other["loc"][:-1] == first["loc"][:-1]:
                first = other
                break
    types = {table.__name__ for table in Table.__subclasses__()}
    key = ".".join(str(part) for part in first["loc"] if part not in types) or "the file"
    line = line_of(text, first["loc"])
    place = f"{where}:{line}" if line else where
    if first["type"] == "extra_forbidden":
        known = sorted({name for table in Table.__subclasses__() for name in table.model_fields})
        name = str(first["loc"][-1])
        advice = f"remove it or correct its name{_nearest(name, known)}"
        if name in known:
            advice = "remove it: it has no meaning here"
        return InputError(place, f"unknown key {key}", advice)
    if first["type"] == "missing":
        return InputError(place, f"{key} is missing", "state it")
    what = first["msg"].removeprefix("Value error, ")  # prefix for errors of our own checks
    what = what.replace("Input should be", "must be").partition(", unable to parse")[0]
    known = _QUOTED.findall(str(first.get("ctx", {}).get("expected", "")))
    given: Any = first["input"]
    near = _nearest(given, known) if isinstance(given, str) else ""
    return InputError(place, f"{key}: {what}", f"correct that value{near}")


def _nearest(given: str, known: Sequence[str]) -> str:
    near = get_close_matches(given, known, 1)
    return f"; did you mean {near[0]}?" if near else ""


def line_of(text: str, loc: Sequence[str | int]) -> int:
    """Return the line of a value, or of the table in which it is missing; 0 if there is none.

    `loc`: keys and positions, with names of types between them, as Pydantic returns them.
    """
    line_number, deepest = 0, 0
    table: Place = ()
    counts: dict[Place, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = place = _entered(_parts(header[2]), counts, bool(header[1]))
        elif key := _KEY.match(line):
            place = (*table, *_parts(key[1]))
        else:
            continue
        parts = iter(loc)
        leads = place[:1] == tuple(loc[:1]) and all(part in parts for part in place)
        if len(place) > deepest and (leads or place == (*loc, 0)):
            line_number, deepest = number, len(place)
    return line_number


def channel_line(text: str, name: str) -> int:
    """Return the line of a channel's signal; 0 if the file does not state the channel.

    `text`: a bench.toml without mistakes.  `name`: the channel.
    """
    names = [channel.get("name") for channel in tomllib.loads(text).get("channel", [])]
    return line_of(text, ("channel", names.index(name), "signal")) if name in names else 0


def _parts(name: str) -> Place:
    return tuple(part.strip(" '\"") for part in name.split("."))


def _entered(names: Place, counts: dict[Place, int], is_array: bool) -> Place:
    """Return the place of a table; a table of an array has its position after its name."""
    place: Place = ()
    for depth, name in enumerate(names):
        place = (*place, name)
        if is_array and depth == len(names) - 1:
            counts[place] = counts.get(place, -1) + 1
        if place in counts:
            place = (*place, counts[place])
    return place
