"""The walls of the house: who may import what, and what importing costs."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LAYERS = ("dbc", "daq", "identify", "tui")  # imports point left only
SOURCES = [path for layer in LAYERS for path in sorted((ROOT / layer).rglob("*.py"))]

# Library -> the only places that may import it.
RESERVED = {
    "can": ("daq/bus/interfaces", "daq/formats/export.py", "daq/replay.py"),
    "serial": ("daq/bus/slcan",),
    "cantools": ("dbc/",),
    "h5py": ("daq/session", "daq/formats/"),
    "tomlkit": ("daq/bench/edit.py",),
    "filelock": ("daq/control/address.py",),
    "sdnotify": ("daq/control/monitoring.py",),
    "textual": tuple(
        f"tui/terminal/{room}"
        for room in (
            "app",
            "chart",
            "device",
            "form",
            "screens/",
            "widgets",
        )
    ),
    "textual_serve": ("tui/browser/",),
    "aiohttp": ("tui/browser/", "tui/display/"),
    "segno": ("tui/display/link.py",),
    "asammdf": ("daq/formats/",),
    "pandas": ("daq/formats/",),
    "pypdf": ("identify/report/pdf",),
    "matplotlib": ("identify/report/", "identify/study/result.py", "identify/plots.py"),
    "distributed": ("tui/jobs/executors.py",),
    "threading": ("daq/", "tui/"),
    "typer": ("tui/",),
    "rich": ("tui/",),
}
SILENCED = re.compile(
    r"#\s*(?:noqa|type:\s*ignore|mypy:|pragma:)"
    r"|\bpytest\.(?:skip|xfail|importorskip)\b|\bmark\.(?:skip|skipif|xfail)\b"
)
FORBIDDEN_IN_IDENTIFY = {"can", "cantools", "h5py", "textual", "threading", "asyncio", "socket"}


@cache
def _imports(path: Path) -> frozenset[str]:
    """Return the absolute dotted name of every import in a file, function bodies included."""
    return frozenset(_imported(path))


def _imported(path: Path) -> Iterator[str]:
    package = path.relative_to(ROOT).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level] if node.level else ()
            module = ".".join((*base, *([node.module] if node.module else [])))
            yield module
            yield from (f"{module}.{alias.name}" for alias in node.names)


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_each_library_has_its_room() -> None:
    strays = [
        f"{_name(path)} imports {library}"
        for path in SOURCES
        for library in sorted({module.split(".")[0] for module in _imports(path)})
        if not _may_import(_name(path), library)
    ]
    assert not strays


def _may_import(name: str, library: str) -> bool:
    if name.startswith("identify/") and library in FORBIDDEN_IN_IDENTIFY:
        return False
    return name.startswith(RESERVED.get(library, ""))


def test_only_the_simulator_knows_the_simulator_and_it_knows_no_method() -> None:
    for path in SOURCES:
        name, modules = _name(path), list(_imports(path))
        if name.startswith("daq/sim/"):
            assert not [m for m in modules if m.split(".")[0] == "identify"], name
        elif name.startswith(("daq/", "identify/")):
            assert not [m for m in modules if m.startswith("daq.sim")], name


def test_nothing_listens_through_a_notifier() -> None:
    # python-can's Notifier dies without a word when a listener raises.
    for path in SOURCES:
        assert not [m for m in _imports(path) if m.startswith("can") and "Notifier" in m]
        assert "can.Notifier(" not in path.read_text("utf-8")


def test_the_house_does_not_grow() -> None:
    """At most 45,000 lines of source and 50,000 of tests, in fewer files than 300 and 250."""
    tests = sorted(ROOT.glob("tests/**/*.py"))
    for paths, most_lines, most_files in ((SOURCES, 45_000, 205), (tests, 50_000, 223)):
        lines = sum(len(path.read_text("utf-8").splitlines()) for path in paths)
        assert (lines <= most_lines, len(paths) <= most_files) == (True, True), lines


def test_files_stay_small() -> None:
    tests = sorted(ROOT.glob("tests/**/*.py"))
    for paths in (SOURCES, tests):
        assert not [_name(p) for p in paths if len(p.read_text("utf-8").splitlines()) > 600]
        assert not [_name(p) for p in paths if p.name == "utils.py"]


@pytest.mark.parametrize(
    "mark",
    ["# noqa: E501", "#noqa", "# type: ignore[misc]", "pytest.skip()", "pytest.mark.xfail"],
)
def test_a_mark_that_silences_a_check_is_seen(mark: str) -> None:
    assert SILENCED.search(f"word {mark}")


def test_no_check_is_silenced_and_no_test_is_skipped() -> None:
    here = Path(__file__)  # shows the marks, as text
    paths = {*SOURCES, *ROOT.glob("tests/**/*.py"), *ROOT.glob("docs/**/*.py")} - {here}
    assert len(paths) > 300
    assert not [_name(p) for p in sorted(paths) if SILENCED.search(p.read_text("utf-8"))]


def _modules_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print('\\n'.join(m.split('.')[0] for m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_libraries_import_lightly() -> None:
    loaded = _modules_after("import dbc, daq, daq.recorder.recorder, identify.pipeline")
    heavy = {"textual", "matplotlib", "can", "cantools", "typer", "rich", "xarray", "scipy", "h5py"}
    assert not loaded & heavy


def test_the_command_line_starts_lightly() -> None:
    loaded = _modules_after("import tui.cli")
    heavy = {"numpy", "scipy", "matplotlib", "asammdf", "textual", "can", "cantools", "h5py"}
    assert not loaded & heavy


def test_a_command_on_a_file_that_prints_json_needs_no_rich() -> None:
    loaded = _modules_after("from tui.cli import run; run(['identify', 'absent.h5', '--json'])")
    assert "numpy" in loaded, "it has begun to read"
    assert "rich" not in loaded
