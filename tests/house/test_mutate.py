"""`make mutate` on a package of a few lines: it names the mutants that no test finds."""

import subprocess
import sys
from pathlib import Path

from tests.mutate.draw import draw, mutants
from tests.mutate.mutant import Mutant
from tests.mutate.room_tests import room_tests
from tests.mutate.sources import sources

ROOT = Path(__file__).parents[2]
SOURCE = '''"""Limits of a wheel."""

from __future__ import annotations


def is_heavy(mass_kg: float) -> bool:
    """Return whether a wheel is heavier than 40 kg."""
    return mass_kg > 40.0


def both_kg(mass_kg: float) -> float:
    """Return what two wheels weigh."""
    return 2.0 * mass_kg
'''
TESTS = """from dbc import both_kg, is_heavy


def test_far_from_the_limit() -> None:
    assert is_heavy(70.0)
    assert not is_heavy(19.5)


def test_both() -> None:
    assert both_kg(20.0) == 40.0
"""
FACE = '"""Wheels."""\n\nfrom .wheel import both_kg, is_heavy\n'


def _tree(root: Path, source: str = SOURCE) -> Path:
    for name, text in {
        "dbc/__init__.py": FACE,
        "dbc/wheel.py": source,
        "tests/dbc/test_wheel.py": TESTS,
        "tests/dbc/test_other.py": "def test_nothing() -> None:\n    assert True\n",
        "tests/dbc/conftest.py": "import pytest\n",
        "tests/dbc/test_spoilt.py": "def test_spoilt() -> None:\n    raise ValueError\n",
        "pyproject.toml": "[tool.pytest.ini_options]\nfilterwarnings = ['error']\n",
    }.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, "utf-8")
    return root


def _changes(root: Path, source: str) -> set[str]:
    tree = _tree(root, source)
    return {m.change(source.encode()) for m in mutants(tree, "dbc/wheel.py")}


def test_the_tool_names_what_no_test_finds(tmp_path: Path) -> None:
    tree = _tree(tmp_path / "tree")
    command = [sys.executable, "-m", "tests.mutate", "--jobs", "1", "--root", str(tree)]
    done = subprocess.run(
        [*command, "--seed", "9", "--count", "5"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    rate, _, survivors = done.stdout.partition("\nmedian time of a mutant: ")
    assert rate.endswith("dbc     1 of    2 killed   50%\nall     1 of    2 killed   50%")
    assert survivors.endswith("survivors: 1\ndbc/wheel.py:8  > -> >=\n    return mass_kg > 40.0\n")
    assert "left out, it fails without a mutant: tests/dbc/test_spoilt.py" in rate
    assert (tree / "dbc" / "wheel.py").read_text("utf-8") == SOURCE


def test_faults_of_numbers_signs_and_terms(tmp_path: Path) -> None:
    source = "def f(a, b, c=0.5, e=()):\n    return -a + b * 3 if a and not b else g(a, k=b)\n"
    assert _changes(tmp_path, source) == {
        *("0.5 -> 1.0", "0.5 -> 0.25", "() -> (None,)", "3 -> 4", "3 -> 2"),
        *("-a -> (a)", "+ -> -", "* -> /", "b * 3 -> (b)", "b * 3 -> (3)"),
        *("-a + b * 3 -> (-a)", "-a + b * 3 -> (b * 3)", "k=b -> nothing"),
        *("a and not b -> (not (a and not b))", "and -> or", "not b -> (b)"),
        *("a and not b -> ((a))", "a and not b -> ((not b))"),
    }


def test_texts_types_and_looks_are_left_alone(tmp_path: Path) -> None:
    source = (
        '"""Of 3."""\nfrom typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    x = 1\n\n'
        "def f(a: Literal[3]) -> Literal[4]:\n    plot(figsize=(3, 4))\n    log.warning('%s', 3)\n"
        "    raise ValueError(f'{a + 3}' + 'b')\n\n"
        "class A:\n    b: Annotated[int, Field(gt=5)]\n\n"
        "    def __repr__(self):\n        return 3\n"
    )
    assert _changes(tmp_path, source) == {
        *("5 -> 6", "5 -> 4", "gt=5 -> nothing"),
        *("plot(figsize=(3, 4)) -> pass", "raise ValueError(f'{a + 3}' + 'b') -> pass"),
    }


def test_letters_of_several_bytes_do_not_shift_a_place(tmp_path: Path) -> None:
    source = "def f(λ, ω):  # μ\n    return (λ)  # + ω\\\n    \n".replace("\\\n    \n", "\n")
    source = source.replace("return (λ)  # + ω", "return ((λ)  # - ω\n        + ω)")
    assert "+ -> -" in _changes(tmp_path, source)


def test_a_seed_is_one_draw(tmp_path: Path) -> None:
    tree = _tree(tmp_path, "def f(a):\n" + "".join(f"    a += {n}.5\n" for n in range(50)))
    first = draw(tree, ["dbc/wheel.py"], 10, 1)
    assert first == draw(tree, ["dbc/wheel.py"], 10, 1)
    assert first != draw(tree, ["dbc/wheel.py"], 10, 2)
    assert len({mutant.line for mutant in first}) == 10


def test_tests_of_a_module_come_before_those_of_its_room(tmp_path: Path) -> None:
    tests = room_tests(_tree(tmp_path), Mutant("dbc/wheel.py", 1, 0, 0, ""))
    assert tests.direct == ("tests/dbc/test_wheel.py",)
    assert tests.others == ("tests/dbc/test_other.py", "tests/dbc/test_spoilt.py")


def test_every_file_of_the_packages_has_tests() -> None:
    for path in sources(ROOT, ["dbc", "daq", "identify", "tui"]):
        assert room_tests(ROOT, Mutant(path, 1, 0, 0, "")).all, path
