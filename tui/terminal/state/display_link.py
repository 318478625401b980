"""The display that was started with this terminal."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DisplayLink:
    """The link of the display, as text and code."""

    lines: tuple[str, ...]
    """Link, warning and number, in words."""
    code: tuple[str, ...]
    """The link as a QR code, dark where a character is drawn; empty for this machine's own."""
