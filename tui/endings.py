"""Checks the names of files to write, before the work of minutes that fills them."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from dbc import InputError

PAGES = (".html", ".htm")
"""Endings of pages."""
SHEETS = (".pdf",)
"""Endings of printed reports."""

PROMETHEUS = (".prom",)
"""Ending of the files that its node exporter reads."""


def require_ending(path: Path, noun: str, endings: Collection[str]) -> None:
    """Raise InputError if a file to write has an ending of something else.

    A session or a bench.toml that is named by mistake is then not overwritten.
    """
    if path.suffix.lower() not in endings:
        advice = f"end its name in {', '.join(endings)}"
        raise InputError(str(path), f"is not a known form of {noun}", advice)
