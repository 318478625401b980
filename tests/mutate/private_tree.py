"""A copy of the tree, with an environment whose packages are those of the copy."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

IGNORED = shutil.ignore_patterns(".git", ".venv", "build", ".*_cache", ".hypothesis", "*.egg-info")
SCRIPT = """#!{python}
from tui.cli import main
raise SystemExit(main())
"""


class PrivateTree:
    """One copy, in which one mutant at a time is tried."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.source = str(root)
        self.root = folder / "tree"
        shutil.copytree(root, self.root, ignore=IGNORED)
        self.python = _environment(self.root, folder / "venv")
        self._stamp = 1_000_000_000

    def write(self, path: str, source: bytes) -> None:
        """Write one file, with a time of its own: bytecode of what it was is not taken for it."""
        self._stamp += 1
        (self.root / path).write_bytes(source)
        os.utime(self.root / path, (self._stamp, self._stamp))


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
