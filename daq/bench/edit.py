"""Changes a bench.toml and keeps everything else that a person wrote in it.

Text in, text out.  A table is cut out of the text, changed by tomlkit, and put back, so that the
comments between tables stay where they are.  Each result is checked as `parse_bench` checks a file.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from ..errors import InputError
from ..runs import Excitation
from ..vehicle import BodyWeight, Fact, HubWeight, Structure
from .campaign import Method
from .config import default_bench_text, parse_bench
from .ready_maps import completed

WHERE = "bench.toml"
Weight = BodyWeight | HubWeight
_Row = Mapping[str, Any]

_OPTIONAL = {"sigma_kg": 0.0, "height_m": 0.0, "position_sigma_m": 0.0}
"""Keys of a weight that are left out where they have these values."""


def with_vehicle(text: str, name: str, structure: Structure) -> str:
    """Return the text with another name of the vehicle and another structure of its model."""
    stated = _document(text).get("vehicle", {})
    flags = {flag: getattr(structure, flag) for flag in Structure.__dataclass_fields__}
    before = stated.get("structure", {})
    changed = {f: v for f, v in flags.items() if before.get(f, getattr(Structure(), f)) != v}
    text = _with_keys(text, ("vehicle",), {"name": name})
    return _checked(_with_keys(text, ("vehicle", "structure"), changed))


def with_facts(text: str, facts: Sequence[Fact]) -> str:
    """Return the text with these facts and no others."""
    _document(text)
    rows = [{"quantity": str(f.quantity), "value": f.value, "sigma": f.sigma} for f in facts]
    return _checked(_with_rows(text, "fact", rows))


def with_weights(text: str, weights: Sequence[Weight]) -> str:
    """Return the text with these added weights and no others."""
    _document(text)
    rows = []
    for weight in weights:
        row: dict[str, Any] = {"mass_kg": weight.mass_kg, "sigma_kg": weight.sigma_kg}
        if isinstance(weight, HubWeight):
            row["hub"] = str(weight.corner)
        else:
            row |= {"x_m": weight.x_m, "y_m": weight.y_m, "height_m": weight.height_m}
            row["position_sigma_m"] = weight.position_sigma_m
        rows.append(_without_defaults(row))
    return _checked(_with_rows(text, "weight", rows))


def with_channel(text: str, name: str, sign: float | None = None, tare: float | None = None) -> str:
    """Return the text with another sign or tare (SI) of a channel; None keeps the old one.

    If the text has no channels of its own, the channels in force are written out in full.

    Raises InputError if there is no such channel, or the sign is neither 1 nor -1.
    """
    document = _document(text)
    known = [channel.name for channel in parse_bench(text, WHERE, Path(), "").channels]
    if name not in known:
        advice = f"name one of {', '.join(known)}"
        raise InputError(WHERE, f"there is no channel {name}", advice)
    if sign not in (None, 1, -1):
        raise InputError(WHERE, f"channel {name}: sign {sign} is not 1 or -1", "state 1 or -1")
    rows = list(document.get("channel", []))
    if name not in [row["name"] for row in rows]:
        rows = completed(document, default_bench_text())["channel"]
    stated = {"sign": None if sign is None else int(sign), "tare": tare}
    changed = {key: value for key, value in stated.items() if value is not None}
    rows = [row | changed if row["name"] == name else row for row in rows]
    return _checked(_with_rows(text, "channel", rows))


def with_campaign(
    text: str,
    excitations: Iterable[Excitation],
    repeats: int,
    method: Method,
    bump_height_m: float,
    accept_after_s: float,
) -> str:
    """Return the text with another campaign; instructions and duration of the bump are kept."""
    _document(text)
    before, kinds = parse_bench(text, WHERE, Path(), "").campaign, tuple(excitations)
    height_mm = float(f"{bump_height_m * 1e3:.12g}")  # 0.07 m is 70 mm, not 70.00000000000001
    changed = {
        key: value
        for key, old, new, value in (
            ("excitations", before.excitations, kinds, [str(kind) for kind in kinds]),
            ("repeats", before.repeats, repeats, repeats),
            ("method", before.method, method, str(method)),
            ("bump_height_mm", before.bump_height_m, bump_height_m, height_mm),
            ("accept_after_s", before.accept_after_s, accept_after_s, accept_after_s),
        )
        if old != new
    }
    return _checked(_with_keys(text, ("campaign",), changed))


def _document(text: str) -> dict[str, Any]:
    """Return the tables of a bench.toml; a mistake that is there already is named, not replaced."""
    parse_bench(text, WHERE, Path(), "")
    return tomllib.loads(text)


def _checked(text: str) -> str:
    """Return the text; raises InputError if it is no valid bench.toml."""
    parse_bench(text, WHERE, Path(), "")  # the databases do not matter here
    return text


def _without_defaults(row: _Row) -> dict[str, Any]:
    return {key: value for key, value in row.items() if _OPTIONAL.get(key) != value}


# Tables within the text ---------------------------------------------------------------------------


def _places(text: str, header: str) -> list[tuple[int, int]]:
    """Return where tables with a header begin and, after their last key, end: offsets in `text`."""
    lines = text.splitlines(keepends=True)
    starts = [i for i, line in enumerate(lines) if re.match(r"\s*\[", line)] + [len(lines)]
    places = []
    for start, stop in pairwise(starts):
        if re.match(rf"\s*{re.escape(header)}\s*(#|$)", lines[start]):
            while stop > start + 1 and re.match(r"\s*(#|$)", lines[stop - 1]):
                stop -= 1
            places.append((len("".join(lines[:start])), len("".join(lines[:stop]))))
    return places


def _changed(text: str, change: Callable[[Any], None]) -> str:
    """Return a piece of TOML that was changed as a document."""
    try:
        document = tomlkit.parse(text if text.endswith("\n") else text + "\n")
        change(document)
    except TOMLKitError as error:
        raise InputError(WHERE, f"is not TOML: {error}", "correct that line") from error
    return tomlkit.dumps(document)


def _set(table: Any, values: _Row) -> None:
    """Set keys of a table; a comment after a value stays."""
    for key, value in values.items():
        if key in table and table[key] != value:
            before = table[key].trivia
            table[key] = value
            trivia = table[key].trivia
            trivia.comment_ws, trivia.comment = before.comment_ws, before.comment
        elif key not in table:
            table[key] = value


def _with_keys(text: str, path: tuple[str, ...], values: _Row) -> str:
    """Return the text with other values of keys of a table, which may not be there yet."""
    if not values:
        return text

    def change(document: Any) -> None:
        table = document
        for key in path:
            table = table.setdefault(key, tomlkit.inline_table() if table is not document else {})
        _set(table, values)

    if places := _places(text, f"[{'.'.join(path)}]"):
        start, stop = places[0]
        return text[:start] + _changed(text[start:stop], change) + text[stop:]
    outermost = _places(text, f"[{path[0]}]")
    if path[0] in tomllib.loads(text) and not outermost:
        return _changed(text, change)  # written with dots, or in one line
    new = tomlkit.dumps({path[-1]: dict(values)}).replace(f"[{path[-1]}]", f"[{'.'.join(path)}]", 1)
    if outermost:
        _, stop = outermost[0]
        return f"{text[:stop]}\n{new}{text[stop:]}"
    return f"{text}\n{new}" if not text or text.endswith("\n") else f"{text}\n\n{new}"


def _with_rows(text: str, key: str, rows: Sequence[_Row]) -> str:
    """Return the text with other tables of an array.

    A row that is there already keeps its lines; a changed one keeps the comments of its place.
    """
    stated = [_without_defaults(row) for row in tomllib.loads(text).get(key, [])]
    places = _places(text, f"[[{key}]]")
    if len(places) != len(stated):  # written in one line
        text = _changed(text, lambda document: document.remove(key))
        stated, places = [], []
    pieces = [text[start:stop] for start, stop in places]
    written: list[str] = []  # the table of each row; first only of those that are there already
    unmatched = list(range(len(stated)))
    for row in rows:
        same = next((i for i in unmatched if stated[i] == row), None)
        if same is not None:
            unmatched.remove(same)
        written.append(pieces[same] if same is not None else "")
    for i, row in enumerate(rows):
        if written[i]:
            continue
        if i in unmatched and len(rows) == len(stated):
            written[i] = _changed(pieces[i], partial(_set_row, key=key, row=row))
        else:
            written[i] = tomlkit.dumps({key: [dict(row)]})
    for i, (start, stop) in reversed(list(enumerate(places))):  # earlier places stay right
        after = text[stop:]
        text = text[:start] + (written[i] + after if i < len(written) else after.lstrip("\n"))
    added = "\n".join(written[len(places) :])
    if not added:
        return text
    if present := _places(text, f"[[{key}]]"):
        stop = present[-1][1]
        return f"{text[:stop]}\n{added}{text[stop:]}"
    return f"{text.rstrip()}\n\n{added}" if text.strip() else added


def _set_row(document: Any, key: str, row: _Row) -> None:
    """Give the only table of an array the keys and values of a row."""
    table = document[key][0]
    for name in [name for name in table if name not in row]:
        table.remove(name)
    _set(table, row)
