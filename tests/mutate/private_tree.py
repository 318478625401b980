"""A copy of the tree, with an environment whose packages are those of the copy."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

from . import probe
from .blocks import Blocks
from .mutant import Mutant

IGNORED = shutil.ignore_patterns(".git", ".venv", "build", ".*_cache", ".hypothesis", "*.egg-info")
SCRIPT = """#!{python}
from tui.cli import main
raise SystemExit(main())
"""


def snapshot(root: Path, target: Path) -> Path:
    """Copy the tree as it is now: it may change while mutants are tried."""
    shutil.copytree(root, target, ignore=IGNORED)
    return target


class PrivateTree:
    """One copy, in which one mutant at a time is tried, or the tests are recorded."""

    def __init__(self, source: Path, folder: Path) -> None:
        self.root = folder / "tree"
        snapshot(source, self.root)
        self.python = _environment(self.root, folder / "venv")
        self.found = folder / "found.json"
        self._stamp = 1_000_000_000
        self._original: tuple[Path, bytes] | None = None

    def mark(self, blocks: Iterable[Blocks]) -> None:
        """Put marks into all sources: from now on this tree is for recordings."""
        shutil.copy(str(probe.__file__), self.root / "mutate_probe.py")
        for file in blocks:
            if file.marked:
                self._write(self.root / file.path, file.marked.encode())

    def forget(self) -> None:
        """Remove what the last run has found."""
        self.found.unlink(missing_ok=True)

    def apply(self, mutant: Mutant) -> None:
        """Put a mutant into the copy, until `restore`."""
        path = self.root / mutant.path
        self._original = (path, path.read_bytes())
        self._write(path, mutant.applied(self._original[1]))

    def restore(self) -> None:
        """Take the mutant out again."""
        if self._original:
            self._write(*self._original)
            self._original = None

    def _write(self, path: Path, source: bytes) -> None:
        """Write a file with a time of its own: bytecode of what it was is not taken for it."""
        self._stamp += 1
        path.write_bytes(source)
        os.utime(path, (self._stamp, self._stamp))


def _environment(tree: Path, venv: Path) -> Path:
    """Make an environment that sees the copy first, then what is installed here.

    Processes that tests start run the interpreter of their parent, some of them without any
    variable of the shell: what they import has to follow from the interpreter.
    """
    here = Path(sys.executable)
    installed = Path(next(p for p in sys.path if p.endswith("site-packages")))
    packages = venv / installed.relative_to(Path(sys.prefix))
    packages.mkdir(parents=True)
    (packages / "tree.pth").write_text(f"{tree}\n{installed}\n", "utf-8")
    shutil.copy(Path(sys.prefix) / "pyvenv.cfg", venv / "pyvenv.cfg")
    (venv / "bin").mkdir()
    python = venv / "bin" / here.name
    python.symlink_to(here.resolve())
    script = venv / "bin" / "bumpbench"
    script.write_text(SCRIPT.format(python=python), "utf-8")
    script.chmod(0o755)
    return python
