"""Changes what a bench.toml says: text in, text out, each result checked as a file is checked.

The file of the person who wrote it is never changed: an edited text goes to the recorder, which
stores it in the journal.  Comments are not carried over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import tomlkit

from dbc.words import InputError

from ..runs import Excitation
from ..vehicle import Fact, HubWeight, Structure, Weight
from .campaign import Method
from .config import parse_bench
from .sensors import completed
from .toml_file import toml_tables

WHERE = "bench.toml"
_Tables = dict[str, Any]


def with_vehicle(text: str, name: str, structure: Structure) -> str:
    """Return the text of a bench.toml with this name and this structure of its vehicle."""

    def change(tables: _Tables) -> None:
        vehicle = tables.setdefault("vehicle", {})
        vehicle["name"] = name
        present = asdict(Structure()) | vehicle.get("structure", {})
        for flag, on in asdict(structure).items():
            if present[flag] != on:  # else not stated: a stated flag forces or forbids its element
                vehicle.setdefault("structure", {})[flag] = on

    return _edited(text, change)


def with_facts(text: str, facts: Sequence[Fact]) -> str:
    """Return the text with these facts and no others."""
    rows = [{"quantity": str(f.quantity), "value": f.value, "sigma": f.sigma} for f in facts]
    return _edited(text, lambda tables: tables.update(fact=rows))


def with_weights(text: str, weights: Sequence[Weight]) -> str:
    """Return the text with these added weights and no others."""
    rows = []
    for weight in weights:
        row = asdict(weight)
        if isinstance(weight, HubWeight):
            row["hub"] = str(row.pop("corner"))
        needed = ("mass_kg", "x_m", "y_m")  # the others are 0 if they are not stated
        rows.append({key: value for key, value in row.items() if value != 0.0 or key in needed})
    return _edited(text, lambda tables: tables.update(weight=rows))


def with_channel(text: str, name: str, sign: float | None = None, tare: float | None = None) -> str:
    """Return the text with another sign or tare (SI) of a channel; None keeps the old one.

    If the text does not state that channel, all channels in force are written out in full.  Raises
    InputError if there is no such channel.
    """

    def change(tables: _Tables) -> None:
        channels = tables.get("channel", [])
        if name not in [channel["name"] for channel in channels]:
            channels = completed(tables)["channel"]
        names = [channel["name"] for channel in channels]
        if name not in names:
            advice = f"name one of {', '.join(names)}"
            raise InputError(WHERE, f"there is no channel {name}", advice)
        changed: _Tables = {} if sign is None else {"sign": int(sign)}
        changed |= {} if tare is None else {"tare": tare}
        tables["channel"] = [c | changed if c["name"] == name else c for c in channels]

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
    return _edited(text, lambda tables: tables.setdefault("campaign", {}).update(stated))


def _edited(text: str, change: Callable[[_Tables], None]) -> str:
    """Return the text after a change of its tables; the same text if it says that already.

    Raises InputError if the text or its result is no valid bench.toml: a mistake that is there
    already is named, not replaced.  The databases do not matter here.
    """
    parse_bench(text, WHERE, Path(), "")
    tables = toml_tables(text, WHERE)
    change(tables)
    if tables == toml_tables(text, WHERE):
        return text
    edited = tomlkit.dumps(tables)
    parse_bench(edited, WHERE, Path(), "")
    return edited
