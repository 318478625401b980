"""Changes a bench.toml and keeps everything else that a person wrote in it.

Text in, text out.  Comments, order and spelling of unchanged parts are kept; a weight or a fact
that does not change keeps its lines.  Each result is read back by `daq.bench.config.parse_bench`
and must contain the requested change and no other; otherwise an `InputError` names the field.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, InlineTable, SingleKey, Table, Whitespace

from ..errors import InputError
from ..runs import Excitation
from ..vehicle import BodyWeight, Fact, HubWeight, Structure
from .campaign import Campaign
from .config import Bench, default_bench_text, parse_bench
from .procedure import Method, Procedure
from .ready_maps import PREFIX, ready_map
from .sensor_maps import ready_tables

WHERE = "bench.toml"
Weight = BodyWeight | HubWeight
_Row = Mapping[str, Any]


def with_vehicle(text: str, name: str, structure: Structure) -> str:
    """Return the text with another name of the vehicle and another structure of its model."""
    before = _parsed(text)
    document = _document(text)
    table = _table(document, "vehicle")
    _set(table, "name", name)
    flags = {flag: getattr(structure, flag) for flag in Structure.__dataclass_fields__}
    stated = table.get("structure", {})
    changed = {f: v for f, v in flags.items() if stated.get(f, getattr(Structure(), f)) != v}
    if changed:
        own = _table(table, "structure")
        for flag, value in changed.items():
            _set(own, flag, value)
    # A flag that is written decides about an element; the symmetry of the wheels is not an element.
    decided = {flag: value for flag, value in changed.items() if flag != "symmetric"}
    elements = {**before.vehicle.elements, **decided}
    vehicle = replace(before.vehicle, name=name, structure=structure, elements=elements)
    return _proven(document, text, "vehicle", lambda bench: bench.vehicle == vehicle)


def with_facts(text: str, facts: Sequence[Fact]) -> str:
    """Return the text with these facts and no others."""
    _parsed(text)
    document = _document(text)
    rows = [{"quantity": str(f.quantity), "value": f.value, "sigma": f.sigma} for f in facts]
    _put_tables(document, "fact", rows)
    wanted = tuple(facts)
    return _proven(document, text, "fact", lambda bench: bench.vehicle.facts == wanted)


def with_weights(text: str, weights: Sequence[Weight]) -> str:
    """Return the text with these added weights and no others."""
    _parsed(text)
    document = _document(text)
    _put_tables(document, "weight", [_weight_row(weight) for weight in weights])
    wanted = tuple(weights)
    return _proven(
        document, text, "weight", lambda bench: bench.mass_states[1].added.weights == wanted
    )


def with_channel(text: str, name: str, sign: float | None = None, tare: float | None = None) -> str:
    """Return the text with another sign or tare (SI) of a channel; None keeps the old one.

    If the text has no channels of its own, the channels in force are written out in full.

    Raises InputError if there is no such channel, or the sign is neither 1 nor -1.
    """
    before = _parsed(text)
    if name not in [channel.name for channel in before.channels]:
        known = ", ".join(channel.name for channel in before.channels)
        raise InputError(WHERE, f"there is no channel {name}", f"name one of {known}")
    if sign not in (None, 1, -1):
        raise InputError(WHERE, f"channel {name}: sign {sign} is not 1 or -1", "state 1 or -1")
    document = _document(text)
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
    wanted = tuple(
        replace(
            channel,
            sign=channel.sign if sign is None else sign,
            tare=channel.tare if tare is None else tare,
        )
        if channel.name == name
        else channel
        for channel in before.channels
    )
    return _proven(document, text, "channel", lambda bench: bench.channels == wanted)


def with_campaign(
    text: str,
    excitations: Iterable[Excitation],
    repeats: int,
    method: Method,
    bump_height_m: float,
    accept_after_s: float,
) -> str:
    """Return the text with another campaign; instructions and duration of the bump are kept."""
    before = _parsed(text)
    document = _document(text)
    kinds = tuple(excitations)
    procedure = Procedure(method, bump_height_m, accept_after_s, before.procedure.instructions)
    now = {
        "excitations": (before.campaign.excitations, kinds, [str(kind) for kind in kinds]),
        "repeats": (before.campaign.repeats, repeats, repeats),
        "method": (before.procedure.method, method, str(method)),
        "bump_height_mm": (
            before.procedure.bump_height_m,
            bump_height_m,
            float(f"{bump_height_m * 1e3:.12g}"),  # 0.07 m is 70 mm, not 70.00000000000001
        ),
        "accept_after_s": (before.procedure.accept_after_s, accept_after_s, accept_after_s),
    }
    table = _table(document, "campaign")
    for key, (old, new, value) in now.items():
        if old != new:
            _set(table, key, value)
    campaign = Campaign(kinds, repeats)

    def says_it(bench: Bench) -> bool:
        off_m = abs(bench.procedure.bump_height_m - bump_height_m)
        same = replace(bench.procedure, bump_height_m=bump_height_m) == procedure
        return bench.campaign == campaign and same and off_m <= 1e-9 * bump_height_m

    return _proven(document, text, "campaign", says_it)


def _parsed(text: str) -> Bench:
    return parse_bench(text, WHERE, Path(), dbc_text="")  # the DBC does not matter here


def _document(text: str) -> tomlkit.TOMLDocument:
    try:
        return tomlkit.parse(text if not text or text.endswith("\n") else text + "\n")
    except TOMLKitError as error:
        raise InputError(WHERE, f"is not TOML: {error}", "correct that line") from error


def _proven(
    document: tomlkit.TOMLDocument, before: str, key: str, says_it: Callable[[Bench], bool]
) -> str:
    """Return the text if it contains the requested change and everything else as before."""
    after = tomlkit.dumps(document)
    bench = _parsed(after)
    old, new = tomllib.loads(before), tomllib.loads(after)
    old.pop(key, None)
    new.pop(key, None)
    if old != new or not says_it(bench):
        what = f"{key}: it cannot be changed where it is in the file"
        raise InputError(WHERE, what, f"write {key} as a table of its own, in one piece")
    return after


def _weight_row(weight: Weight) -> dict[str, Any]:
    row: dict[str, Any] = {"mass_kg": weight.mass_kg, "sigma_kg": weight.sigma_kg}
    if isinstance(weight, HubWeight):
        return row | {"hub": str(weight.corner)}
    place = {"x_m": weight.x_m, "y_m": weight.y_m, "height_m": weight.height_m}
    return row | place | {"position_sigma_m": weight.position_sigma_m}


_LEFT_OUT = {"sigma_kg": 0.0, "height_m": 0.0, "position_sigma_m": 0.0}
"""Keys of a weight that need not be written, with their default values."""


def _channels_in_force(document: tomlkit.TOMLDocument) -> list[Table]:
    """Return the channels that apply although the bench.toml does not state them."""
    if "sensor" in document:
        tables = document["sensor"].unwrap()
        sensors = [
            (t["name"], f"{PREFIX}{t['layout']}" if t.get("layout") else t["dbc"]) for t in tables
        ]
        added = ready_tables(sensors, document.unwrap())
        return [_new_table(row) for row in added["channel"]]
    dbc = str(document.get("dbc", ""))
    ready = dbc.startswith(PREFIX)
    text = ready_map(dbc.removeprefix(PREFIX)).bench_text if ready else default_bench_text()
    return list(cast(AoT, _document(text)["channel"]))


# Tables and their trimmings ---------------------------------------------------------------------
#
# In tomlkit a comment above a table is the tail of the table before it.  So the tail is cut off
# before a table is changed, and put back after.


def _table(parent: Any, key: str) -> Any:
    """Return the table of that name; make it if there is none."""
    if key not in parent:
        tail = "" if isinstance(parent, tomlkit.TOMLDocument) else _cut_tail(parent)
        own, following = _split_tail(tail)
        _add_tail(parent, own if own.endswith("\n") else own + "\n" * bool(tail))
        parent[key] = tomlkit.inline_table() if isinstance(parent, InlineTable) else tomlkit.table()
        if not isinstance(parent, InlineTable):
            _add_tail(parent[key], "\n" + following)
    return parent[key]


def _set(table: Any, key: str, value: Any) -> None:
    if key in table and table[key] == value:
        return
    if key in table:
        before = table[key].trivia
        table[key] = value
        trivia = table[key].trivia
        trivia.comment_ws, trivia.comment = before.comment_ws, before.comment
        return
    tail = _cut_tail(table)
    table[key] = value
    _add_tail(table, tail)


def _append(document: tomlkit.TOMLDocument, key: str, tables: Sequence[Table]) -> None:
    if document.body:
        document.add(tomlkit.nl())
    document.append(key, AoT(list(tables), key, parsed=True))


def _put_tables(document: tomlkit.TOMLDocument, key: str, rows: Sequence[_Row]) -> None:
    """Replace an array of tables; tables that do not change are kept."""
    present = document.get(key)
    if not isinstance(present, AoT):
        if present is not None:
            document.remove(key)
        if rows:
            tables = [_new_table(row) for row in rows]
            for table in tables[:-1]:
                _add_tail(table, "\n")
            _append(document, key, tables)
        return
    old = list(present)
    tails = [_cut_tail(table) for table in old]
    heads = ["", *(_split_tail(tail)[1] for tail in tails[:-1])]
    ends = [_split_tail(tail)[0] for tail in tails]
    after = _split_tail(tails[-1])[1]
    kept: list[tuple[str, Table, str | None]] = []  # None: its end is not known yet
    orphans = ""  # comments above removed tables: one may be a heading
    plan = SequenceMatcher(None, [_same(t.unwrap()) for t in old], [_same(row) for row in rows])
    for what, a, b, c, d in plan.get_opcodes():
        pairs = min(b - a, d - c)
        for i in range(pairs):
            if what == "replace":
                _update(old[a + i], rows[c + i])
            kept.append((orphans + heads[a + i], old[a + i], ends[a + i]))
            orphans = ""
        kept += [("", _new_table(row), None) for row in rows[c + pairs : d]]
        orphans += "".join(heads[a + pairs : b])
    behind = (orphans + after, tomlkit.table(), "")
    for (_, one, end), (head, _, next_end) in pairwise([*kept, behind]):
        if end is None or (next_end is None and not end):
            end = ends[-1] if one is kept[-1][1] else "\n"
        _add_tail(one, end + head)
    place = next(i for i, (k, _) in enumerate(document.body) if k is not None and k.key == key)
    document.body[place] = (
        (SingleKey(key), AoT([table for _, table, _ in kept], key, parsed=True))
        if kept
        else (None, Whitespace(orphans + after))
    )


def _same(row: _Row) -> tuple[tuple[str, Any], ...]:
    """Return a form of a table that does not depend on its spelling."""
    stated = {k: v for k, v in row.items() if _LEFT_OUT.get(k) != v}
    return tuple(sorted(stated.items()))


def _new_table(row: _Row) -> Table:
    table = tomlkit.table()
    for key, value in row.items():
        if _LEFT_OUT.get(key) != value:
            table[key] = value
    return table


def _update(table: Table, row: _Row) -> None:
    for key in [key for key in table if key not in row]:
        table.remove(key)
    for key, value in row.items():
        if key in table or _LEFT_OUT.get(key) != value:
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


def _split_tail(tail: str) -> tuple[str, str]:
    """Divide a tail at its last empty line: the part after it belongs to the next table."""
    lines = tail.splitlines(keepends=True)
    empty = [i for i, line in enumerate(lines) if not line.strip()]
    cut = empty[-1] + 1 if empty else 0
    return "".join(lines[:cut]), "".join(lines[cut:])
