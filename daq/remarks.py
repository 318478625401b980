"""What persons said of a session, out of its provenance: notes, and warnings they answered for."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any


def notes_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the notes that persons wrote, each with its run and its writer.

    Parameters
    ----------
    provenance : mapping of str to str
        Of a session, which may come from anybody: what is not as we write it is told as it is.
    """
    return _told(provenance.get("notes", ""), _note)


def overrides_of(provenance: Mapping[str, str]) -> tuple[str, ...]:
    """Return the warnings that were overridden: subject, reason and name."""
    return _told(provenance.get("overrides", ""), _override)


def _told(text: str, words: Callable[[Mapping[str, Any]], str]) -> tuple[str, ...]:
    try:
        return tuple(dict.fromkeys(said for item in json.loads(text) if (said := words(item))))
    except (ValueError, KeyError, TypeError, RecursionError):
        return (text,) if text else ()


def _note(note: Mapping[str, Any]) -> str:
    if not note["by"]:  # a mark of the terminal, and nobody's word
        return ""
    about = f"{note['label']}: " if note["label"] else ""
    return f"{about}{note['text']} ({note['by']})"


def _override(override: Mapping[str, Any]) -> str:
    return f"{override['subject']}: {override['reason']} ({override['by']})"
