"""Words for users: numbers of things."""

from __future__ import annotations


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number with the words for what it counts, as `plural`: `1 frame`, `1,200 frames`."""
    return f"{number:,} {plural(number, one, many)}"


def plural(number: int, one: str, many: str = "") -> str:
    """Return the words for a number of things: `one` for 1, else `many`, by default one with s."""
    return one if number == 1 else many or f"{one}s"
