"""`make mutate` on a package of a few lines: it names the mutants that no test finds."""

import gc
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.mutate.blocks import Blocks
from tests.mutate.choice import Chooser
from tests.mutate.draw import draw, mutants
from tests.mutate.mutant import Mutant
from tests.mutate.records import RecordedTest, Records
from tests.mutate.room_tests import room_tests, users_tests
from tests.mutate.served import put_in
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
SPOILT = """from dbc import is_heavy


def test_spoilt() -> None:
    assert is_heavy(0.0)
"""
FACE = '"""Wheels."""\n\nfrom .wheel import both_kg, is_heavy\n'


def _tree(root: Path, source: str = SOURCE) -> Path:
    for name, text in {
        "dbc/__init__.py": FACE,
        "dbc/wheel.py": source,
        "tests/dbc/test_wheel.py": TESTS,
        "tests/dbc/test_other.py": "def test_nothing() -> None:\n    assert True\n",
        "tests/dbc/conftest.py": "import pytest\n",
        "tests/dbc/test_spoilt.py": SPOILT,
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
    assert survivors.endswith(
        "survivors: 1\ndbc/wheel.py:8  > -> >=  [1 tests pass]\n    return mass_kg > 40.0\n"
    )
    assert "it fails without a mutant, or takes long: tests/dbc/test_spoilt.py::test_spoilt" in rate
    assert (tree / "dbc" / "wheel.py").read_text("utf-8") == SOURCE


BRANCHES = '''"""Limits."""

from numpy import sign

LIMIT = 3.0
TWICE = 2 * LIMIT


class Wheel:
    """A wheel."""

    turns: int = 0

    def turn(self, by):
        """Turn."""
        if by > TWICE:
            return 1
        elif by < 0:
            return sign(by)
        self.turns += by
'''


def test_blocks_are_what_runs_together() -> None:
    blocks = Blocks("dbc/wheel.py", BRANCHES.encode())
    lines = BRANCHES.splitlines()
    assert {lines[line - 1].strip(): key for line, key in blocks.of_line.items()} == {
        "if by > TWICE:": "dbc/wheel.py:Wheel.turn:0",
        "return 1": "dbc/wheel.py:Wheel.turn:1",
        "elif by < 0:": "dbc/wheel.py:Wheel.turn:2",
        "return sign(by)": "dbc/wheel.py:Wheel.turn:3",
        "self.turns += by": "dbc/wheel.py:Wheel.turn:4",
    }
    ran = list[str]()
    marked = blocks.marked.replace("from mutate_probe import mark as _mutate_mark", "")
    space: dict[str, Any] = {"_mutate_mark": ran.append}
    exec(marked, space)
    space["Wheel"]().turn(1)
    assert ran == [f"dbc/wheel.py:Wheel.turn:{n}" for n in (0, 2, 4)]


def test_a_constant_is_tested_where_its_name_and_what_follows_from_it_occur(tmp_path: Path) -> None:
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests/a.py").write_text("from dbc import Wheel", "utf-8")
    (tmp_path / "tests/b.py").write_text("turn_it()", "utf-8")
    named = RecordedTest("tests/a.py::test_named", 0.1, frozenset(), {})
    turns = frozenset({"dbc/wheel.py:Wheel.turn:0"})
    uses = RecordedTest("tests/b.py::test_uses", 3.0, turns, {})
    long = RecordedTest("tests/b.py::test_long", 60.0, turns, {})
    chooser = Chooser(tmp_path, [Blocks("dbc/wheel.py", BRANCHES.encode())])
    tests = [long, uses, named]

    def chosen(line: int) -> tuple[list[RecordedTest], int]:
        choice = chooser.choice(Mutant("dbc/wheel.py", line, 0, 0, ""), tests)
        return list(choice.tests), choice.left_out

    assert chosen(5) == ([uses], 1)  # LIMIT, by way of TWICE; 3 s and 60 s are beyond the cap
    assert chosen(12) == ([named, uses], 1)  # turns, by the name of its class
    assert chosen(17) == ([], 0)  # the first branch runs in no test


def test_what_a_statement_outside_of_functions_changes_depends_on_it() -> None:
    source = b"""DIGIT = [0] * 9
for place in (1, 2):
    DIGIT[place] = place
app.command("turn")(turn)
print("no name")
"""
    bound = Blocks("dbc/wheel.py", source).bound
    assert [set(bound[line]) for line in (1, 3, 4)] == [{"DIGIT"}, {"DIGIT"}, {"app"}]


def test_a_record_outlives_another_docstring_and_no_other_statement() -> None:
    first, reworded, changed = (
        Blocks("dbc/wheel.py", f"def turn(n):\n    {text}\n    return {value}\n".encode()).functions
        for text, value in (("'Turn.'", "n"), ("'Return the turns.'", "n"), ("'Turn.'", "-n"))
    )
    assert first == reworded != changed
    assert Blocks("dbc/wheel.py", b"def turn(n):\n    'Turn.'\n").functions.keys() == first.keys()


def test_what_is_compiled_bears_no_marks_and_is_found_by_name() -> None:
    formula = b"def force(u):\n    return 2.0 * u\n"
    for path, head, compiled in (
        ("identify/elements/spring.py", b"", True),
        ("identify/nonlinear/path.py", b"from numba import njit\n", True),
        ("identify/nonlinear/path.py", b"", False),
    ):
        blocks = Blocks(path, head + formula)
        assert bool(blocks.marked) is not compiled
        assert bool(blocks.of_line) is not compiled
        assert (blocks.bound.get(2 + bool(head)) == frozenset({"force"})) is compiled


def test_what_tests_share_counts_once(tmp_path: Path) -> None:
    """Of tests that need a session of 45 s all are within the cap of 60 s, of two sessions not."""
    turns = frozenset({"dbc/wheel.py:Wheel.turn:0"})
    chooser = Chooser(tmp_path, [Blocks("dbc/wheel.py", BRANCHES.encode())])

    def chosen(*sessions: str) -> tuple[int, float]:
        tests = [
            RecordedTest(f"tests/b.py::test_{n}", 0.5, turns, {session: 45.0})
            for n, session in enumerate(sessions)
        ]
        choice = chooser.choice(Mutant("dbc/wheel.py", 5, 0, 0, ""), tests)
        return choice.left_out, choice.seconds

    assert chosen("small", "small", "small") == (0, 46.5)
    assert chosen("small", "large") == (1, 45.5)


def test_a_record_holds_until_a_test_or_a_function_that_it_runs_changes(tmp_path: Path) -> None:
    (tmp_path / "test_a.py").write_text("1", "utf-8")
    functions = {"dbc/wheel.py:f": "1", "dbc/wheel.py:g": "1"}
    found = {
        "modules": ["test_a.py"],
        "imported": [],
        "tests": {"test_a.py::t": [0.5, ["dbc/wheel.py:f:0"], {}]},
    }
    Records(tmp_path, tmp_path, functions).keep("test_a.py", found)

    def knows(**changed: str) -> bool:
        now = functions | {f"dbc/wheel.py:{name}": text for name, text in changed.items()}
        return Records(tmp_path, tmp_path, now).knows("test_a.py")

    assert knows()
    assert knows(g="2")
    assert not knows(f="2")
    (tmp_path / "test_a.py").write_text("2", "utf-8")
    assert not knows()


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


def test_tests_of_a_file_are_those_of_its_room(tmp_path: Path) -> None:
    names = ("wheel", "other", "spoilt")
    assert set(room_tests(_tree(tmp_path), "dbc/wheel.py")) == {
        f"tests/dbc/test_{name}.py" for name in names
    }


def test_tests_elsewhere_that_import_a_file_are_among_its_own() -> None:
    own = room_tests(ROOT, "identify/modes/modal_model.py")
    assert {"tests/identify/modes/test_rules.py", "tests/identify/test_display.py"} < set(own)
    assert "tests/identify/test_change.py" not in own


def test_what_no_test_of_a_room_runs_meets_those_of_the_users() -> None:
    every = users_tests(ROOT)
    assert {"tests/flow/test_demo.py", "tests/tui/terminal/test_keys.py"} < set(every)
    assert not any(file.startswith(("tests/dbc/", "tests/identify/")) for file in every)


def test_every_file_of_the_packages_has_tests() -> None:
    for path in sources(ROOT, ["dbc", "daq", "identify", "tui"]):
        assert room_tests(ROOT, path), path


def test_a_fault_reaches_functions_that_are_frozen(tmp_path: Path) -> None:
    path = str(tmp_path / "wheel.py")
    source = b"def turn(n):\n    return n + 1\n"
    wheel: dict[str, Any] = {}
    exec(compile(source, path, "exec"), wheel)
    gc.collect()
    gc.freeze()  # as `tests/conftest.py` does with all that is loaded
    try:
        put_in(path, source.replace(b"+", b"-"), 2)
    finally:
        gc.freeze()
    assert wheel["turn"](3) == 2
