"""The test files of a mutant: those of its room, and those that import its module."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from .mutant import Mutant


@dataclass(frozen=True, slots=True)
class RoomTests:
    """Test files, relative to the root of the tree."""

    direct: tuple[str, ...]
    """Those that import the module, or its names from the face of its package."""
    others: tuple[str, ...]
    """The rest of the room."""

    @property
    def all(self) -> tuple[str, ...]:
        """Both, each once."""
        return self.direct + self.others


def room_tests(root: Path, mutant: Mutant) -> RoomTests:
    """Return the tests of a mutant: tests/<package>/<room>/, and direct ones of the package.

    A file at the root of a package, or a room without tests of its own, has the test files at
    the root of tests/<package>/.
    """
    package = root / "tests" / mutant.package
    room = root / "tests" / mutant.room
    inside = room.rglob("test_*.py") if room != package and room.is_dir() else ()
    files = sorted(inside) or sorted(package.glob("test_*.py"))
    module = mutant.path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    direct = [
        path for path in sorted(package.rglob("test_*.py")) if module in _imported(root, path)
    ]
    others = [path for path in files if path not in direct]
    return RoomTests(_names(root, direct), _names(root, others))


def _names(root: Path, paths: list[Path]) -> tuple[str, ...]:
    return tuple(path.relative_to(root).as_posix() for path in paths)


@cache
def _imported(root: Path, path: Path) -> frozenset[str]:
    """Return the modules of the tree that a file imports, faces of packages seen through."""
    if not path.is_file():
        return frozenset()
    package = path.relative_to(root).parts[:-1]
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*base, *([node.module] if node.module else [])))
            names.add(module)
            for alias in node.names:
                names.add(f"{module}.{alias.name}")
                names.add(_home(root, module, alias.name))
    return frozenset(names)


@cache
def _home(root: Path, module: str, name: str) -> str:
    """Return the module in which a name is defined that a package's `__init__` shows."""
    face = root / module.replace(".", "/") / "__init__.py"
    if not face.is_file():
        return module
    for node in ast.walk(ast.parse(face.read_bytes())):
        if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
            home = f"{module}.{node.module}" if node.level == 1 else str(node.module)
            return _home(root, home, name)
    return module
