"""Imports libraries that only some formats need."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from .errors import InputError


def optional(module: str, extra: str) -> ModuleType:
    """Import a library of one of the extras of pyproject.toml.

    Raises InputError if it is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        what = f"needs {module.split('.')[0]}, which is not installed"
        raise InputError("this format", what, f"pip install 'bumpbench[{extra}]'") from error
