"""Machine code that was stored is used as long as nothing that it contains has changed."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from identify.nonlinear import kernels as compiled

ROOT = Path(__file__).parents[3]

_FORCE = """
import numpy as np
from identify.nonlinear import kernels

line, knots = np.array([0.0, 1000.0, 500.0]), np.array([0.1])
force = kernels.curve(line, knots, 0.1, 0.02)
print(force, sum(kernels.curve.stats.cache_hits.values()), sep=chr(10))
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """Return a folder with the packages, whose sources can be changed."""
    shutil.copytree(ROOT / "identify", tmp_path / "identify", ignore=lambda *_: ["__pycache__"])
    for name in ("daq", "dbc"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def force_of(copy: Path, before: str = "") -> tuple[float, bool]:
    """Return the force of a damper in the middle of a knee, and whether its code was stored.

    `before`: runs in the same process before.
    """
    kept = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # Python's own looks at times alone
    command = [sys.executable, "-c", before + _FORCE]
    done = subprocess.run(command, cwd=copy, env=kept, check=True, capture_output=True)
    force, hits = done.stdout.split()
    return round(float(force), 9), hits == b"1"


def stored(copy: Path) -> set[str]:
    folder = copy / "identify" / "nonlinear" / "__pycache__"
    return {path.name for path in folder.glob("kernels.curve_*.nb[ic]")}


def test_a_changed_formula_in_another_file_changes_what_a_kernel_returns(copy: Path) -> None:
    """The kernel takes the rounded knee, (width / 4) in its middle, from the elements."""
    assert force_of(copy) == (100.0 + 500.0 * 0.02 / 4.0, False)
    before = stored(copy)
    assert force_of(copy) == (102.5, True)

    hinge = copy / "identify" / "nonlinear" / "laws.py"
    sharper = hinge.read_text("utf-8").replace("inside / (4.0 * width)", "inside / (8.0 * width)")
    hinge.write_text(sharper, "utf-8")
    assert force_of(copy) == (101.25, False)
    assert len(stored(copy)) == len(before) == 2
    assert not stored(copy) & before, "what the old formulas gave is removed"
    assert force_of(copy) == (101.25, True)


_NOWHERE = """
import numba.core.caching

def read_only(self): raise OSError("read-only file system")

numba.core.caching._CacheLocator.ensure_cache_path = read_only
"""


def test_where_no_folder_can_be_written_it_is_compiled_anew(copy: Path) -> None:
    assert force_of(copy, _NOWHERE) == (102.5, False)
    assert stored(copy) == set()


def _imported(source: Path) -> dict[Path, set[str]]:
    """Return the files of this project from which a file imports, and what."""
    found: dict[Path, set[str]] = {}
    for node in ast.walk(ast.parse(source.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.level or _is_ours(str(node.module))):
            base = source.parents[node.level - 1] if node.level else ROOT
            folder = base.joinpath(*(node.module or "").split("."))
            for alias in node.names:
                file = folder / f"{alias.name}.py"
                if file.exists():
                    found.setdefault(file, set())
                else:
                    found.setdefault(folder.with_suffix(".py"), set()).add(alias.name)
    return found


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] in ("daq", "dbc", "identify")


def _assigned(source: Path) -> set[str]:
    """Return the names that a file itself gives to numbers and the like."""
    tree = ast.parse(source.read_text("utf-8"))
    return {
        name.id
        for node in tree.body
        if isinstance(node, ast.Assign)
        for name in ast.walk(node.targets[0])
        if isinstance(name, ast.Name)
    }


def test_all_that_a_kernel_takes_in_counts() -> None:
    """Of the car, kernels take its own constants; what else they import is followed to its end."""
    room = ROOT / "identify" / "nonlinear"
    car = room / "car.py"
    for source in compiled.SOURCES:
        if source != car:
            for file, names in _imported(source).items():
                assert file in compiled.SOURCES, f"{source.name} takes {names} from {file}"
                assert file != car or names <= _assigned(car)
    texts = {path: path.read_text("utf-8") for path in room.glob("*.py")}
    made = {path for path, text in texts.items() if "@kernel" in text or "@njit" in text}
    assert len(made) == 2
    assert made < set(compiled.SOURCES)
