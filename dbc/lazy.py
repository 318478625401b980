"""Loads the public names of a package at their first use.

A package states these names as imports for type checkers, each in the form ``from .file import X as
X``::

    if TYPE_CHECKING:
        from .config import Bench as Bench
    else:
        __all__, __dir__, __getattr__ = lazy(__name__)
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path


def lazy(package: str) -> tuple[list[str], Callable[[], list[str]], Callable[[str], object]]:
    """Return `__all__`, `__dir__` and `__getattr__` of the package that calls this.

    A name is looked up in its file at each access, so that a replacement there is seen here.
    """
    tree = ast.parse(Path(str(sys.modules[package].__file__)).read_text("utf-8"))
    homes = {
        alias.name: "." * node.level + str(node.module)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname == alias.name
    }

    def attribute(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name], package), name)

    return sorted(homes), lambda: sorted({*vars(sys.modules[package]), *homes}), attribute
