"""Tries every promised Python, and the oldest dependencies: `python -m tests.house.pythons`.

An interpreter is tried with the pinned dependencies; the oldest one also with the lowest versions
that pyproject.toml states.  Each runs the tests of `TESTS` and the demo.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from .release import ROOT, UV

MINORS = (11, 12, 13, 14)
"""Minor versions of Python 3 that are promised."""
TESTS = (
    "tests/dbc",
    "tests/tui/test_mistakes.py",
    "tests/identify/report",
    "tests/identify/test_change.py",
    "tests/tui/test_desk.py",
    "tests/tui/test_batch.py",
)
"""Of each dependency at least one that uses it: the reader, the figures, the fit, the files."""
PINNED = ("--constraint", "constraints.txt")
LOWEST = ("--resolution", "lowest-direct")
_ASK = "import platform; print(platform.python_version())"


def interpreters(folder: Path) -> dict[str, str]:
    """Return the paths of one interpreter of each version that is here or can be had.

    Parameters
    ----------
    folder : Path
        Where a missing one is put, if the package manager can get it.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    folders = [*pyenv.glob("versions/*/bin"), *map(Path, os.get_exec_path())]
    found: dict[str, str] = {}
    for minor in MINORS:
        paths = [place / f"python3.{minor}" for place in folders]
        if not any(map(_version, paths)):
            command = [*UV, "python", "install", "--install-dir", str(folder), f"3.{minor}"]
            subprocess.run(command, capture_output=True, check=False)
            paths = [*folder.glob(f"*/bin/python3.{minor}")]
        for path in paths:
            version = _version(path)
            if version:
                found.setdefault(version, str(path))
    return found


def _version(path: Path) -> str:
    """Return the version of an interpreter; nothing if it is none."""
    if not path.is_file():
        return ""
    done = subprocess.run([path, "-c", _ASK], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else ""


def attempt(folder: Path, python: str, how: tuple[str, ...]) -> tuple[bool, str]:
    """Install into an empty environment; return whether all passed, and how many tests did.

    Parameters
    ----------
    folder : Path
        An empty one, for the environment and what the demo writes.
    python : str
        Path of the interpreter.
    how : tuple of str
        Which versions of the dependencies to take.
    """
    scripts = folder / "venv" / "bin"
    _quiet([*UV, "venv", "--quiet", "--python", python, str(folder / "venv")])
    install = [*UV, "pip", "install", "--quiet", "--python", str(scripts / "python"), *how]
    _quiet([*install, "--editable", f"{ROOT}[test]"])
    pytest = [str(scripts / "python"), "-m", "pytest", "--quiet", "-p", "no:cacheprovider"]
    # An old library may warn of a newer one that it brings along: that is no fault of ours.
    warnings = ["-W", "default"] if how == LOWEST else []
    tests = _quiet([*pytest, "--tb=line", *warnings, *TESTS])
    demo = _quiet([str(scripts / "bumpbench"), "demo", "--out", str(folder / "demo")])
    verdict = re.search(r"^verdict: *(\w+)", demo.stdout, re.MULTILINE)
    said = verdict[1] if verdict else "none"
    count = (tests.stdout.strip().split("\n") or [""])[-1]
    ok = tests.returncode == 0 and demo.returncode == 0 and said == "ok"
    if not ok:
        sys.stdout.write(tests.stdout[-3000:] + demo.stderr[-3000:])
    return ok, f"{count}; demo's verdict: {said}"


def _quiet(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def main() -> int:
    """Print a line for each interpreter; return 1 if anything failed."""
    failed = False
    with tempfile.TemporaryDirectory() as name:
        found = interpreters(Path(name, "pythons"))
        oldest = min(found, key=lambda version: [*map(int, re.findall(r"[0-9]+", version))])
        rows = [(version, "pinned", PINNED) for version in found] + [(oldest, "lowest", LOWEST)]
        for number, (version, label, how) in enumerate(rows):
            folder = Path(name, str(number))
            folder.mkdir()
            ok, said = attempt(folder, found[version], how)
            failed |= not ok
            _row(version, label, "passed" if ok else "FAILED", said)
    for minor in MINORS:
        if not any(version.startswith(f"3.{minor}.") for version in found):
            _row(f"3.{minor}", "", "not tried", "not on this machine, and cannot be had")
    return int(failed)


def _row(*cells: str) -> None:
    sys.stdout.write("{:8} {:7} {:9} {}\n".format(*cells))
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
