"""`bumpbench batch`: one result row for each of any number of sessions."""

from __future__ import annotations

from .command import batch

__all__ = ["batch"]
