"""Reads the remarks of persons on a session from its provenance: notes and overridden warnings."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any


def notes_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the notes that persons wrote, each with its run and its writer.

    `provenance`: provenance of a session from any source; text that is not our JSON is returned
    unchanged.
    """
    return _parsed(provenance.get("notes", ""), _note)


def overrides_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the warnings that were overridden: subject, reason and name."""
    return _parsed(provenance.get("overrides", ""), _override)


def _parsed(text: str, words: Callable[[Mapping[str, Any]], str]) -> tuple[str, ...]:
    try:
        return tuple(dict.fromkeys(line for item in json.loads(text) if (line := words(item))))
    except (ValueError, KeyError, TypeError, RecursionError):
        return (text,) if text else ()


def _note(note: Mapping[str, Any]) -> str:
    if not note["by"]:  # a mark set by the terminal, not written by a person
        return ""
    about = f"{note['label']}: " if note["label"] else ""
    return f"{about}{note['text']} ({note['by']})"


def _override(override: Mapping[str, Any]) -> str:
    return f"{override['subject']}: {override['reason']} ({override['by']})"
