"""The source files in which mutants are drawn."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

PACKAGES = ("dbc", "daq", "identify", "tui")
OF_THE_TREE = frozenset({*PACKAGES, "tests"})


def sources(root: Path, given: Sequence[str]) -> list[str]:
    """Return the given files and folders as files; else what differs from main; else all."""
    if given:
        return _files(root, given)
    return _files(root, _changed(root)) or _files(root, PACKAGES)


def _files(root: Path, names: Sequence[str]) -> list[str]:
    found: set[Path] = set()
    for name in names:
        path = root / name
        found.update(path.rglob("*.py") if path.is_dir() else [path])
    names = sorted(path.relative_to(root).as_posix() for path in found if path.is_file())
    return [name for name in names if name.endswith(".py") and name.split("/")[0] in PACKAGES]


def _changed(root: Path) -> list[str]:
    """Return the files that differ from the branch main, committed or not."""
    command = ["git", "-C", str(root), "diff", "--name-only", "--relative", "main"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return []
    return done.stdout.splitlines() if done.returncode == 0 else []
