"""Install a release as a user would, and try it: `python -m tests.house.release`.

Wheel and sdist are built, the wheel is installed into empty environments with the pinned
dependencies: alone, and with each extra.  Type checkers see the examples from a user's folder.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

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


Result = TypeVar("Result")

EXTRAS = {
    "data": "import pandas, pyarrow",
    "mf4": "import asammdf",
    "cluster": "import dask, distributed",
    "web": "import textual_serve.server",
}
"""Extra to what it is for."""
CHECKERS = ("mypy", "pyright[nodejs]==1.1.414")
"""Type checkers of users; pyright comes with the Node.js that it needs."""
LIBRARY = "import dbc, daq, identify; print(daq.__file__)"


def main() -> None:
    """Print how long each step took; the first that fails ends it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sdist, wheel = _timed("build", partial(build, folder))
        _try(
            folder, str(wheel), [["--help"], ["study", "table2"], ["notebook", "--out", "n.ipynb"]]
        )
        _check_types(folder)
        _try(folder, str(sdist), [["--help"]])
        for extra, statement in EXTRAS.items():
            _try(folder, f"{wheel}[{extra}]", [["--help"]], statement)


def _try(folder: Path, what: str, commands: list[list[str]], statement: str = "") -> None:
    """Install into an empty environment; run commands, and an import, away from the tree."""
    venv = folder / "venv"
    python = venv / "bin" / "python"
    label = Path(what).name

    def install() -> None:
        _run(folder, [*UV, "venv", "--quiet", "--clear", "--python", sys.executable, str(venv)])
        constraints = ["--constraint", str(ROOT / "constraints.txt")]
        where = ["--quiet", "--python", str(python)]
        _run(folder, [*UV, "pip", "install", *where, *constraints, what])

    _timed(f"install {label}", install)
    for command in commands:
        line = [str(venv / "bin" / "bumpbench"), *command]
        _timed(f"  bumpbench {' '.join(command)}", partial(_run, folder, line))
    used = _run(folder, [str(python), "-c", f"{LIBRARY}; {statement}"])
    if not used.startswith(str(venv)):
        raise SystemExit(f"imported {used}, not what was installed")


def _check_types(folder: Path) -> None:
    """Check the examples against what is installed: a user's code, in a user's folder."""
    python, user = folder / "venv" / "bin" / "python", folder / "user"
    shutil.copytree(ROOT / "docs" / "examples", user)
    checkers = folder / "checkers"
    _run(folder, [*UV, "venv", "--quiet", "--python", sys.executable, str(checkers)])
    constraints = ["--constraint", str(ROOT / "constraints.txt")]
    where = ["--quiet", "--python", str(checkers / "bin" / "python")]
    _timed("install checkers", partial(
        _run, folder, [*UV, "pip", "install", *where, *constraints, *CHECKERS]
    ))  # fmt: skip
    mypy = [str(checkers / "bin" / "mypy"), "--strict", "--python-executable", str(python), "."]
    pyright = [str(checkers / "bin" / "pyright"), "--pythonpath", str(python), "."]
    for line in (mypy, pyright):
        _timed(f"  {Path(line[0]).name} of the examples", partial(_run, user, line))


def _run(folder: Path, command: list[str]) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        said = f"{done.stdout}{done.stderr}"
        raise SystemExit(f"{' '.join(command)} ended with {done.returncode}:\n{said}")
    return done.stdout


def _timed(label: str, step: Callable[[], Result]) -> Result:
    began_s = time.perf_counter()
    result = step()
    sys.stdout.write(f"{label}: {time.perf_counter() - began_s:.1f} s\n")
    return result


if __name__ == "__main__":
    main()
