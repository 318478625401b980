"""Returns the contents of the blocks of a page, as plain texts."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from identify.report.blocks import Picture, Section, Table


def tables(section: Section) -> dict[str, Table]:
    """Return the tables of a section by their title."""
    return {block.title: block for block in section.blocks if isinstance(block, Table)}


def texts(table: Table) -> list[list[str]]:
    return [[cell.text for cell in row] for row in table.rows]


def sources(table: Table) -> list[list[str]]:
    return [[cell.source for cell in row] for row in table.rows]


def picture(section: Section, key: str) -> Picture:
    (found,) = (one for one in section.pictures if one.key == key)
    return found


def drawn(picture: Picture) -> tuple[Any, ...]:
    """Return the data that a picture draws."""
    draw = picture.drawing.draw
    assert isinstance(draw, partial)
    return draw.args


def at(document: Mapping[str, Any], source: str) -> Any:
    """Return what stands at the place that a cell names."""
    found: Any = document
    for key in source.split("/"):
        found = found[int(key) if isinstance(found, (list, tuple)) else key]
    return found


def entry(value: float, half: float, unit: str, reason: str = "") -> dict[str, Any]:
    """Return a number with half of its 95 % interval."""
    return {
        "value": value, "std": half / 1.96, "low": value - half, "high": value + half,
        "unit": unit, "reason": reason,
    }  # fmt: skip
