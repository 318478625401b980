"""Describes a mistake in bench.toml: its line, its key, and the nearest known name."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from ..errors import InputError

_HEADER = re.compile(r"\s*\[(\[?)\s*([^\[\]]+?)\s*\]")
_KEY = re.compile(r"""\s*([\w.'"-]+)\s*=""")
_QUOTED = re.compile(r"'([^']*)'")
_AT_LINE = re.compile(r" \(at line (\d+), column (\d+)\)")

Place = tuple[str | int, ...]
"""Keys and positions that lead to a value."""


def mistake(
    error: ValidationError, text: str, where: str, tables: Iterable[type[BaseModel]]
) -> InputError:
    """Return the first mistake in one line.

    `text`: the file.  `where`: its name.  `tables`: the models whose fields are the known keys.
    """
    tables = tuple(tables)
    first = _first(error)
    types = {table.__name__ for table in tables}
    key = ".".join(str(part) for part in first["loc"] if part not in types) or "the file"
    line = line_of(text, first["loc"])
    place = f"{where}:{line}" if line else where
    if first["type"] == "extra_forbidden":
        known = sorted({name for table in tables for name in table.model_fields})
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


def not_toml(error: ValueError | RecursionError, where: str) -> InputError:
    """Return in one line why a text is not TOML; `where`: the name of the file."""
    what = str(error)
    if at := _AT_LINE.search(what):
        where, what = f"{where}:{at[1]}", f"{what[: at.start()]}, column {at[2]}"
    return InputError(where, f"is not TOML: {what}", "correct that line")


def _first(error: ValidationError) -> ErrorDetails:
    """Return the first mistake; for a missing key, an unknown key of its table if there is one."""
    first, *others = error.errors(include_url=False)
    if first["type"] == "missing":
        for other in others:
            if other["type"] == "extra_forbidden" and other["loc"][:-1] == first["loc"][:-1]:
                return other
    return first


def line_of(text: str, loc: Sequence[str | int]) -> int:
    """Return the line of a value, or of the table in which it is missing; 0 if there is none.

    `loc`: keys and positions, with names of types between them, as Pydantic returns them.
    """
    found, deepest = 0, 0
    table: Place = ()
    counts: dict[Place, int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if header := _HEADER.match(line):
            table = _entered(_parts(header[2]), counts, bool(header[1]))
            place = table
        elif key := _KEY.match(line):
            place = (*table, *_parts(key[1]))
        else:
            continue
        if len(place) > deepest and (_leads_to(place, loc) or place == (*loc, 0)):
            found, deepest = number, len(place)
    return found


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


def _leads_to(place: Place, loc: Sequence[str | int]) -> bool:
    """Return True if a place is the beginning of `loc` without its names of types."""
    rest = iter(loc)
    if not all(part in rest for part in place):
        return False
    return loc[:1] == place[:1]


def _nearest(given: str, known: Sequence[str]) -> str:
    near = get_close_matches(given, known, 1)
    return f"; did you mean {near[0]}?" if near else ""
