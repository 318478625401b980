"""What is installed is what the tree says."""

import re
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_no_other_distribution_owns_our_names() -> None:
    # The package index has an `identify`; beside ours, each import finds half of both.
    owners = packages_distributions()
    for name in ("dbc", "daq", "identify", "tui"):
        assert set(owners.get(name, ["bumpbench"])) == {"bumpbench"}, (
            f"{owners[name]} share the import name {name}: uninstall the others"
        )


def _names(requirements: list[str]) -> set[str]:
    return {re.split(r"[^A-Za-z0-9-]", r)[0].lower() for r in requirements}


def test_every_dependency_is_pinned() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = _names(project["dependencies"])
    for extra in project["optional-dependencies"].values():
        wanted |= _names(extra)
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = {line.split("==")[0] for line in lines}
    assert wanted - {"bumpbench"} <= pinned
    assert all("==" in line for line in lines if line)


def test_no_registry_host_is_named() -> None:
    host = re.compile(r"(pypi|pythonhosted|npmjs|debian)\.(org|com)", re.IGNORECASE)
    for name in ("pyproject.toml", "constraints.txt", "Makefile", ".ci/run", "README.md"):
        assert not host.search((ROOT / name).read_text()), name


def test_top_level_is_the_house() -> None:
    allowed = {
        "README.md", "CHANGELOG.md", "pyproject.toml", "constraints.txt", "Makefile", ".ci",
        ".gitignore", "docs", "dbc", "daq", "identify", "tui", "tests", ".git",
    }  # fmt: skip
    made = {".venv", "build", "bumpbench.egg-info", "bumpbench-demo"}
    caches = {".mypy_cache", ".pytest_cache", ".ruff_cache", ".hypothesis", ".import_linter_cache"}
    assert {path.name for path in ROOT.iterdir()} <= allowed | made | caches
