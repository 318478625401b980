"""Formats the places of findings: a few by name, the rest as a number."""

from __future__ import annotations

from collections.abc import Iterable

_NAMED = 3


def listed(places: Iterable[str]) -> str:
    """Return the first three different places, and the number of the others."""
    unique = tuple(dict.fromkeys(places))
    text = ", ".join(unique[:_NAMED])
    more = len(unique) - _NAMED
    return f"{text} and {more} more" if more > 0 else text
