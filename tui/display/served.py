"""Address, token and number by which a person opens a display."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Served:
    """A display that is being served."""

    link: str
    """Address of the page, with its token."""
    host: str
    """Address on which the display listens."""
    secret: str
    """Number that gives control; empty for a display without control."""
