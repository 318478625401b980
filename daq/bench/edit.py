"""Changes a bench.toml and keeps everything else that a person wrote in it.

Text in, text out.  Comments, order and spelling of unchanged parts are kept; a weight or a fact
that does not change keeps its lines.  Each result is checked as `parse_bench` checks a file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, InlineTable, SingleKey, Table, Whitespace

from ..errors import InputError
from ..runs import Excitation
from ..vehicle import BodyWeight, Fact, HubWeight, Structure
from .campaign import Method
from .config import default_bench_text, parse_bench
from .ready_maps import PREFIX, ready_map, ready_tables

WHERE = "bench.toml"
Weight = BodyWeight | HubWeight
_Row = Mapping[str, Any]

_OPTIONAL = {"sigma_kg": 0.0, "height_m": 0.0, "position_sigma_m": 0.0}
"""Keys of a weight that are left out where they have these values."""


def with_vehicle(text: str, name: str, structure: Structure) -> str:
    """Return the text with another name of the vehicle and another structure of its model."""
    document = _document(text)
    table = _table(document, "vehicle")
    _set(table, "name", name)
    flags = {flag: getattr(structure, flag) for flag in Structure.__dataclass_fields__}
    stated = table.get("structure", {})
    changed = {f: v for f, v in flags.items() if stated.get(f, getattr(Structure(), f)) != v}
    for flag, value in changed.items():
        _set(_table(table, "structure"), flag, value)
    return _checked(document)


def with_facts(text: str, facts: Sequence[Fact]) -> str:
    """Return the text with these facts and no others."""
    document = _document(text)
    rows = [{"quantity": str(f.quantity), "value": f.value, "sigma": f.sigma} for f in facts]
    _put_tables(document, "fact", rows)
    return _checked(document)


def with_weights(text: str, weights: Sequence[Weight]) -> str:
    """Return the text with these added weights and no others."""
    document = _document(text)
    _put_tables(document, "weight", [_weight_row(weight) for weight in weights])
    return _checked(document)


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
    if not document.get("channel"):
        _append(document, "channel", _channels_in_force(document))
    elif name not in [table["name"] for table in document["channel"]]:
        for table in _channels_in_force(document):
            document["channel"].append(table)
    for table in cast(AoT, document["channel"]):
        if table["name"] == name:
            if sign is not None:
                _set(table, "sign", int(sign))
            if tare is not None:
                _set(table, "tare", tare)
    return _checked(document)


def with_campaign(
    text: str,
    excitations: Iterable[Excitation],
    repeats: int,
    method: Method,
    bump_height_m: float,
    accept_after_s: float,
) -> str:
    """Return the text with another campaign; instructions and duration of the bump are kept."""
    document = _document(text)
    before = parse_bench(text, WHERE, Path(), "")
    kinds = tuple(excitations)
    procedure = before.procedure
    table = _table(document, "campaign")
    for key, old, new, value in (
        ("excitations", before.campaign.excitations, kinds, [str(kind) for kind in kinds]),
        ("repeats", before.campaign.repeats, repeats, repeats),
        ("method", procedure.method, method, str(method)),
        # 0.07 m is 70 mm, not 70.00000000000001
        ("bump_height_mm", procedure.bump_height_m, bump_height_m,
         float(f"{bump_height_m * 1e3:.12g}")),
        ("accept_after_s", procedure.accept_after_s, accept_after_s, accept_after_s),
    ):  # fmt: skip
        if old != new:
            _set(table, key, value)
    return _checked(document)


def _document(text: str) -> tomlkit.TOMLDocument:
    parse_bench(text, WHERE, Path(), "")  # a mistake that is there already is named, not replaced
    try:
        return tomlkit.parse(text if not text or text.endswith("\n") else text + "\n")
    except TOMLKitError as error:
        raise InputError(WHERE, f"is not TOML: {error}", "correct that line") from error


def _checked(document: tomlkit.TOMLDocument) -> str:
    text = tomlkit.dumps(document)
    parse_bench(text, WHERE, Path(), "")  # the databases do not matter here
    return text


def _weight_row(weight: Weight) -> dict[str, Any]:
    row: dict[str, Any] = {"mass_kg": weight.mass_kg, "sigma_kg": weight.sigma_kg}
    if isinstance(weight, HubWeight):
        row["hub"] = str(weight.corner)
    else:
        row |= {"x_m": weight.x_m, "y_m": weight.y_m, "height_m": weight.height_m}
        row["position_sigma_m"] = weight.position_sigma_m
    return {key: value for key, value in row.items() if _OPTIONAL.get(key) != value}


def _channels_in_force(document: tomlkit.TOMLDocument) -> list[Table]:
    """Return the channels that apply although the bench.toml does not state them."""
    if "sensor" in document:
        sensors = [
            (t["name"], f"{PREFIX}{t['layout']}" if t.get("layout") else t["dbc"])
            for t in document["sensor"].unwrap()
        ]
        return [_new_table(row) for row in ready_tables(sensors, document.unwrap())["channel"]]
    dbc = str(document.get("dbc", ""))
    ready = dbc.startswith(PREFIX)
    text = ready_map(dbc.removeprefix(PREFIX)).bench_text if ready else default_bench_text()
    return list(cast(AoT, tomlkit.parse(text)["channel"]))


# Tables and the comments between them ------------------------------------------------------------
#
# In tomlkit a comment above a table is the tail of the table before it.  So the tail is cut off
# before a table is changed, and put back after.


def _table(parent: Any, key: str) -> Any:
    """Return the table of that name; make it if there is none."""
    if key not in parent:
        if isinstance(parent, InlineTable):
            parent[key] = tomlkit.inline_table()
            return parent[key]
        tail = _cut_tail(parent)
        parent[key] = tomlkit.table()
        _add_tail(parent[key], "\n" + tail)
    return parent[key]


def _set(table: Any, key: str, value: Any) -> None:
    if key not in table:
        tail = _cut_tail(table)
        table[key] = value
        _add_tail(table, tail)
    elif table[key] != value:
        before = table[key].trivia
        table[key] = value
        trivia = table[key].trivia
        trivia.comment_ws, trivia.comment = before.comment_ws, before.comment


def _append(document: tomlkit.TOMLDocument, key: str, tables: Sequence[Table]) -> None:
    if document.body:
        document.add(tomlkit.nl())
    document.append(key, AoT(list(tables), key, parsed=True))


def _put_tables(document: tomlkit.TOMLDocument, key: str, rows: Sequence[_Row]) -> None:
    """Replace an array of tables.

    A row that is there already keeps its table; a changed one takes that of its place.
    """
    present = document.get(key)
    if not isinstance(present, AoT):
        if present is not None:
            document.remove(key)
        if rows:
            _append(document, key, [_new_table(row) for row in rows])
        return
    tables = list(present)
    tails = {id(table): _cut_tail(table) for table in tables}
    last = tails[id(tables[-1])]  # the heading of what follows
    stated = [
        {k: v for k, v in table.unwrap().items() if _OPTIONAL.get(k) != v} for table in tables
    ]
    free = list(range(len(tables)))
    chosen: list[int | None] = []
    for row in rows:
        same = next((i for i in free if stated[i] == row), None)
        chosen.append(same)
        if same is not None:
            free.remove(same)
    kept = []
    for place, (row, same) in enumerate(zip(rows, chosen, strict=True)):
        if same is None and place in free and len(rows) == len(tables):
            same = place
            _update(tables[place], row)
        kept.append(_new_table(row) if same is None else tables[same])
    for table in kept[:-1]:
        _add_tail(table, "\n" if table is tables[-1] else tails.get(id(table), "\n"))
    if kept:
        _add_tail(kept[-1], last)
    place = next(i for i, (k, _) in enumerate(document.body) if k is not None and k.key == key)
    document.body[place] = (
        (SingleKey(key), AoT(kept, key, parsed=True)) if kept else (None, Whitespace(last))
    )


def _new_table(row: _Row) -> Table:
    table = tomlkit.table()
    table.update(row)
    return table


def _update(table: Table, row: _Row) -> None:
    for key in [key for key in table if key not in row]:
        table.remove(key)
    for key, value in row.items():
        _set(table, key, value)


def _innermost(table: Any) -> Any:
    """Return the innermost last table of a table, which holds the tail."""
    body = table.value.body if isinstance(table, Table) else []
    stated = [item for key, item in body if key is not None]
    return _innermost(stated[-1]) if stated and isinstance(stated[-1], Table) else table


def _cut_tail(table: Any) -> str:
    """Remove and return what follows the last key of a table: empty lines and comments."""
    last = _innermost(table)
    if not isinstance(last, Table):
        return ""
    body, tail = last.value.body, ""
    while body and body[-1][0] is None:
        tail = body.pop()[1].as_string() + tail
    return tail


def _add_tail(table: Any, tail: str) -> None:
    last = _innermost(table)
    if tail and isinstance(last, Table):
        last.value.body.append((None, Whitespace(tail)))
