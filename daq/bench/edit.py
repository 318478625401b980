"""Changes a bench.toml and keeps everything else that a person wrote in it.

Text in, text out, by tomlkit.  Each result is checked as `parse_bench` checks a file.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AoT, Comment

from dbc.words import InputError

from ..runs import Excitation
from ..vehicle import BodyWeight, Fact, HubWeight, Structure
from .campaign import Method
from .config import default_bench_text, parse_bench
from .sensors import completed

WHERE = "bench.toml"
Weight = BodyWeight | HubWeight
_Row = Mapping[str, Any]


def with_vehicle(text: str, name: str, structure: Structure) -> str:
    """Return the text with another name of the vehicle and another structure of its model."""

    def change(document: Any) -> None:
        _set_keys(document, ("vehicle",), {"name": name})
        before = document["vehicle"].get("structure", {})
        flags = {flag: getattr(structure, flag) for flag in Structure.__dataclass_fields__}
        changed = {f: v for f, v in flags.items() if before.get(f, getattr(Structure(), f)) != v}
        _set_keys(document, ("vehicle", "structure"), changed)

    return _edited(text, change)


def with_facts(text: str, facts: Sequence[Fact]) -> str:
    """Return the text with these facts and no others."""
    rows = [{"quantity": str(f.quantity), "value": f.value, "sigma": f.sigma} for f in facts]
    return _edited(text, lambda document: _set_rows(document, "fact", rows))


def with_weights(text: str, weights: Sequence[Weight]) -> str:
    """Return the text with these added weights and no others."""
    rows = []
    for weight in weights:
        row: dict[str, Any] = {"mass_kg": weight.mass_kg, "sigma_kg": weight.sigma_kg}
        if isinstance(weight, HubWeight):
            row["hub"] = str(weight.corner)
        else:
            row |= {"x_m": weight.x_m, "y_m": weight.y_m, "height_m": weight.height_m}
            row["position_sigma_m"] = weight.position_sigma_m
        rows.append(_without_defaults(row))
    return _edited(text, lambda document: _set_rows(document, "weight", rows))


def with_channel(text: str, name: str, sign: float | None = None, tare: float | None = None) -> str:
    """Return the text with another sign or tare (SI) of a channel; None keeps the old one.

    If the text has no channels of its own, the channels in force are written out in full.  Raises
    InputError if there is no such channel.
    """

    def change(document: Any) -> None:
        rows = list(tomllib.loads(text).get("channel", []))
        if name not in [row["name"] for row in rows]:
            rows = completed(tomllib.loads(text), default_bench_text())["channel"]
        if name not in (known := [row["name"] for row in rows]):
            advice = f"name one of {', '.join(known)}"
            raise InputError(WHERE, f"there is no channel {name}", advice)
        stated = {"sign": None if sign is None else int(sign), "tare": tare}
        changed = {key: value for key, value in stated.items() if value is not None}
        rows = [row | changed if row["name"] == name else row for row in rows]
        _set_rows(document, "channel", rows)

    return _edited(text, change)


def with_campaign(
    text: str,
    excitations: Iterable[Excitation],
    repeats: int,
    method: Method,
    bump_height_m: float,
    accept_after_s: float,
) -> str:
    """Return the text with another campaign; instructions and duration of the bump are kept."""
    stated = {
        "excitations": [str(excitation) for excitation in excitations],
        "repeats": repeats,
        "method": str(method),
        "bump_height_mm": float(f"{bump_height_m * 1e3:.12g}"),  # 0.07 m is 70 mm
        "accept_after_s": accept_after_s,
    }
    return _edited(text, lambda document: _set_keys(document, ("campaign",), stated))


def _without_defaults(row: _Row) -> dict[str, Any]:
    """Return a row without the keys of a weight that may be left out where they are 0."""
    optional = ("sigma_kg", "height_m", "position_sigma_m")
    return {key: value for key, value in row.items() if key not in optional or value != 0.0}


# Tables within the document -----------------------------------------------------------------------


def _edited(text: str, change: Callable[[Any], None]) -> str:
    """Return the text after a change of its document.

    Raises InputError if the text or its result is no valid bench.toml: a mistake that is there
    already is named, not replaced.  The databases do not matter here.
    """
    parse_bench(text, WHERE, Path(), "")
    document = tomlkit.parse(text)
    change(document)
    after = tomlkit.dumps(document)
    parse_bench(after, WHERE, Path(), "")
    return after


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


def _set_keys(document: Any, path: Sequence[str], values: _Row) -> None:
    """Set keys of a table, which may not be there yet."""
    if values:
        table = document
        for key in path:
            table = table.setdefault(key, tomlkit.table())
        _set(table, values)


def _set_rows(document: Any, key: str, rows: Sequence[_Row]) -> None:
    """Replace the tables of an array; a table that stays keeps its lines and comments."""
    stated = document.get(key, [])
    if [_without_defaults(row) for row in stated] == list(rows):
        return
    if not isinstance(stated, AoT):  # none, or written in one line
        document.pop(key, None)
        stated = tomlkit.aot()
    for position, row in enumerate(rows):
        if position == len(stated):
            stated.append(tomlkit.table())
        table = stated[position]
        for name in [name for name in table if name not in row]:
            table.remove(name)
        _set(table, row)
    comments = [
        item
        for table in stated.body[len(rows) :]
        for _, item in table.value.body
        if isinstance(item, Comment)
    ]
    del stated[len(rows) :]
    if not rows:
        document.pop(key, None)
    elif key not in document:
        document.append(key, stated)
    for comment in comments:  # some stand above the table that follows
        (stated[-1] if rows else document).add(comment)
