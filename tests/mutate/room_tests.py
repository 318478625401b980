"""The test files of a source file: those of its room, and those that import it."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path


@cache
def room_tests(root: Path, source: str) -> tuple[str, ...]:
    """Return the files in tests/<package>/<room>/.

    A file at the root of a package, or a room without tests of its own, has the test files at
    the root of tests/<package>/.  Those of the package that import the file are added.
    """
    folders = source.split("/")[:-1]
    package = Path(root, "tests", folders[0])
    room = Path(root, "tests", *folders[:2])
    inside = room.rglob("test_*.py") if room != package and room.is_dir() else ()
    files = sorted(inside) or sorted(package.glob("test_*.py"))
    module = source.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    everywhere = set(package.rglob("test_*.py")) - set(files)
    files += sorted(path for path in everywhere if module in _imported(root, path))
    return tuple(path.relative_to(root).as_posix() for path in files)


def users_tests(root: Path) -> tuple[str, ...]:
    """Return the files of tests that drive the product as its users do."""
    folders = (Path(root, "tests", name) for name in ("flow", "tui"))
    files = sorted(path for folder in folders for path in folder.rglob("test_*.py"))
    return tuple(path.relative_to(root).as_posix() for path in files)


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
