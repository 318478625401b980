"""Reads TOML files that persons write: limits their size, and names the line of a mistake."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from dbc.words import InputError

MAX_CONFIG_BYTES = 1_000_000
"""Largest size of a bench.toml or channel map, bytes."""

Place = tuple[str | int, ...]
"""Keys and positions that lead to a value."""


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_File = TypeVar("_File", bound=Table)
_HEADER = re.compile(r"\s*\[(\[?)\s*([^\[\]]+?)\s*\]")
_KEY = re.compile(r"""\s*([\w.'"-]+)\s*=""")


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


def toml_tables(text: str, where: str) -> dict[str, Any]:
    """Return the tables of a TOML text; `where`: its name, for messages.

    Raises InputError with its line if it is not TOML, has `true` in place of a number, or a text
    that no session file can store.
    """
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        what = str(error)
        if line := re.search(r" \(at line (\d+), column (\d+)\)", what):
            where, what = f"{where}:{line[1]}", f"{what[: line.start()]}, column {line[2]}"
        raise InputError(where, f"is not TOML: {what}", "correct that line") from error
    for place, value in _values(document, ()):
        if isinstance(value, bool) and "structure" not in place:
            raise _mistake(text, where, place, "{}: is true or false, not a number or a text")
        if isinstance(value, str) and "\0" in value:
            raise _mistake(text, where, place, "{}: has the character NUL")
    return document


def _values(value: object, place: Place) -> Iterator[tuple[Place, object]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _values(item, (*place, key))
    elif isinstance(value, list):
        for position, item in enumerate(value):
            yield from _values(item, (*place, position))
    else:
        yield place, value


def validated(document: Mapping[str, Any], text: str, where: str, model: type[_File]) -> _File:
    """Return the tables of a TOML text as a model.

    `where`: its name, for messages.  Raises InputError with file, line and key.
    """
    try:
        return model.model_validate(document)
    except ValidationError as error:
        first, *others = error.errors(include_url=False)
        if first["type"] == "missing":  # rather an unknown key of its table
            same = (o for o in others if o["loc"][:-1] == first["loc"][:-1])
            first = next((o for o in same if o["type"] == "extra_forbidden"), first)
        place = first["loc"]
        what = first["msg"].removeprefix("Value error, ")  # prefix for errors of our own checks
        what = (
            what.replace("Input should be", "must be")
            .replace("tuple", "list")
            .partition(", unable to parse")[0]
        )
        if first["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            schema = model.model_json_schema()
            tables = (schema, *schema["$defs"].values())
            known = sorted({key for table in tables for key in table.get("properties", ())})
            name = str(place[-1])
            advice = f"remove it or correct its name{_nearest(name, known)}"
            if name in known:
                advice = "remove it: it has no meaning here"
            raise _mistake(text, where, place, "unknown key {}", advice) from error
        if first["type"] == "missing":
            raise _mistake(text, where, place, "{} is missing", "state it") from error
        known = re.findall("'([^']*)'", str(first.get("ctx", {}).get("expected", "")))
        near = _nearest(first["input"], known) if isinstance(first["input"], str) else ""
        raise _mistake(text, where, place, f"{{}}: {what}", f"correct that value{near}") from error


def _mistake(
    text: str, where: str, place: Place, what: str, advice: str = "correct that value"
) -> InputError:
    """Return what is wrong with the value at a place; `{}` in `what` stands for its key."""
    line = line_of(text, place)
    key = ".".join(str(part) for part in place) or "the file"
    return InputError(f"{where}:{line}" if line else where, what.replace("{}", key, 1), advice)


def _nearest(given: str, known: Sequence[str]) -> str:
    near = get_close_matches(given, known, 1)
    return f"; did you mean {near[0]}?" if near else ""


def line_of(text: str, loc: Sequence[str | int]) -> int:
    """Return the line of a value, or of the table in which it is missing; 0 if there is none.

    `loc`: keys and positions, as Pydantic returns them.
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
