"""The names of segments, by which anybody can see which of them never change again."""

from __future__ import annotations

from pathlib import Path

SEALED, OPEN = "journal_*.mcap", "open_*.mcap"
"""Patterns of the segments that never change again, and of the one that is being written."""
RECEIPT_SUFFIX = ".copied"
"""Ending, after the whole name, of the file that a copier leaves next to what it has copied."""


def open_path(folder: Path, number: int) -> Path:
    """Return where the segment of a number is while it is written."""
    return folder / f"open_{number:04d}.mcap"


def sealed_path(path: Path) -> Path:
    """Return where a segment is once it is not written any more; where it is, if that is so."""
    number = path.name.removeprefix("open_")
    return path if number == path.name else path.with_name(f"journal_{number}")


def segment_number(path: Path) -> int:
    """Return the number in a segment's name, 0 if there is none."""
    digits = path.stem.rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0


def receipt_path(segment: Path) -> Path:
    """Return where a copier says that it has copied a segment."""
    return segment.with_name(segment.name + RECEIPT_SUFFIX)
