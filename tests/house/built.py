"""Builds the package from a copy of the tree, so that nothing is left in it."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("dbc", "daq", "identify", "tui")
UV = [sys.executable, "-m", "uv"]


def package_files() -> set[str]:
    """Return every file of the packages, as the wheel should name it."""
    return {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def build(folder: Path) -> tuple[Path, Path]:
    """Return an sdist, and the wheel that is built from it."""
    tree, out = folder / "tree", folder / "dist"
    for name in package_files() | {"pyproject.toml", "README.md", "CHANGELOG.md"}:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tree / name)
    command = [*UV, "build", "--quiet", "--out-dir", str(out), str(tree)]
    # What it builds with is in the cache since the installation; else it must be fetched.
    offline = subprocess.run([*command, "--offline"], capture_output=True, check=False)
    if offline.returncode:
        subprocess.run(command, check=True)
    (sdist,), (wheel,) = out.glob("*.tar.gz"), out.glob("*.whl")
    return sdist, wheel
