"""Defines the errors of the acquisition; see `dbc.errors` for their form."""

from __future__ import annotations

from dbc.errors import BumpbenchError, InputError, printable

__all__ = ["BumpbenchError", "BusError", "FolderLockedError", "InputError", "printable"]


class BusError(BumpbenchError, OSError):
    """A CAN bus that cannot be opened or was lost."""


class FolderLockedError(BumpbenchError):
    """Another recorder writes to this folder."""
