"""Defines the names of segments, which show which of them never change again."""

from __future__ import annotations

from pathlib import Path

SEALED, OPEN = "journal_*.mcap", "open_*.mcap"
"""Patterns of the names of segments that never change again, and of the one being written."""
RECEIPT_SUFFIX = ".copied"
"""Suffix, after the complete name, of the receipt that a copier leaves next to a copied file."""


def open_path(folder: Path, number: int) -> Path:
    """Return the path of a segment while it is written."""
    return folder / f"open_{number:04d}.mcap"


def sealed_path(path: Path) -> Path:
    """Return the path of a segment after it was written; the same path if it is sealed already."""
    number = path.name.removeprefix("open_")
    return path if number == path.name else path.with_name(f"journal_{number}")


def segment_number(path: Path) -> int:
    """Return the number in a segment's name, 0 if there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def receipt_path(segment: Path) -> Path:
    """Return the path of a copier's receipt for a segment."""
    return segment.with_name(segment.name + RECEIPT_SUFFIX)
