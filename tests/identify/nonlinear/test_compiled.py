"""What is compiled by Numba is made anew when a source changes that it takes in."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import identify
from identify.nonlinear.compiled import forget_outdated


@pytest.fixture
def sources(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / name for name in ("a.py", "b.py")]
    for path in paths:
        path.write_text("1")
    return paths


def test_compiled_functions_stay_until_a_source_changes(
    tmp_path: Path, sources: list[Path]
) -> None:
    kept = tmp_path / "kept"
    forget_outdated(sources, kept)
    made = [kept / name for name in ("k.1.nbc", "k.nbi", "k.pyc")]
    for path in made:
        path.touch()
    forget_outdated(sources, kept)
    assert all(path.exists() for path in made)
    sources[1].write_text("2")
    forget_outdated(sources, kept)
    assert [path.exists() for path in made] == [False, False, True]


def test_what_was_compiled_without_a_note_is_forgotten(tmp_path: Path, sources: list[Path]) -> None:
    (tmp_path / "k.nbi").touch()
    forget_outdated(sources, tmp_path)
    assert not (tmp_path / "k.nbi").exists()


def test_a_folder_that_cannot_be_made_is_no_error(tmp_path: Path, sources: list[Path]) -> None:
    forget_outdated(sources, tmp_path / "a.py" / "kept")


_CURVE = """
import numpy as np
from identify.nonlinear.kernels import curve
print(curve(np.array([0.0, 0.0, 1.0]), np.array([0.0]), 0.0, 1.0))
"""


def test_another_formula_gives_another_result_although_its_kernel_is_the_same(
    tmp_path: Path,
) -> None:
    """The hinge of width 1 has the value 0.25 at its knee, in a copy twice as much."""
    package = tmp_path / "identify"
    own = Path(identify.__file__).parent
    shutil.copytree(own, package, ignore=shutil.ignore_patterns("__pycache__"))

    def result() -> float:
        done = subprocess.run(
            [sys.executable, "-c", _CURVE], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return float(done.stdout)

    once = result()
    kept = package / "nonlinear" / "__pycache__"
    assert [path.name.split("-")[0] for path in kept.glob("*.nbi")] == ["kernels.curve"]
    hinge = package / "elements" / "hinge.py"
    text = hinge.read_text("utf-8")
    head, tail = text.split("def hinge(", 1)
    hinge.write_text(f"{head}def hinge({tail.replace('return ', 'return 2.0 * ', 1)}", "utf-8")
    assert once > 0.0
    assert result() == pytest.approx(2.0 * once)
