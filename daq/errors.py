"""Defines the errors of the acquisition; see `dbc.words` for their form."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from dbc.words import BumpbenchError, InputError, printable

__all__ = ["BumpbenchError", "BusError", "FolderLockedError", "InputError", "optional", "printable"]


class BusError(BumpbenchError, OSError):
    """A CAN bus that cannot be opened or was lost."""


class FolderLockedError(BumpbenchError):
    """Another recorder writes to this folder."""


def optional(module: str, extra: str) -> ModuleType:
    """Return a library of one of the extras of pyproject.toml, which only some formats need.

    Raises InputError if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        what = f"needs {module.split('.')[0]}, which is not installed"
        raise InputError("this format", what, f"pip install 'bumpbench[{extra}]'") from error
