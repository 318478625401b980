"""What is packed: names, pins, the wheel and the sdist, and the pages about them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
from email import message_from_string
from email.message import Message
from importlib.metadata import packages_distributions
from pathlib import Path
from zipfile import ZipFile

import pytest

from daq import write_session
from identify.result import VERSION

from ..daq.small_session import small_session
from .release import ROOT, build, package_files


def test_no_other_distribution_owns_our_names() -> None:
    # The package index has an `identify`; beside ours, each import finds half of both.
    owners = packages_distributions()
    for name in ("dbc", "daq", "identify", "tui"):
        assert set(owners.get(name, ["bumpbench"])) == {"bumpbench"}, (
            f"{owners[name]} share the import name {name}: uninstall the others"
        )


def test_a_package_of_another_distribution_is_named_in_a_line(tmp_path: Path) -> None:
    session = tmp_path / "car.h5"
    write_session(session, small_session())
    (tmp_path / "identify").mkdir()
    (tmp_path / "identify" / "__init__.py").write_text("")
    command = [sys.executable, "-m", "tui", "report", str(session)]
    # What `python -m` adds is the folder: it must not hide what the path says.
    environment = os.environ | {"PYTHONPATH": str(tmp_path), "PYTHONSAFEPATH": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert str(tmp_path / "identify" / "__init__.py") in line
    assert line.endswith("(install bumpbench again, in an environment of its own)")


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


# What a release holds; `python -m tests.house.release` installs one -------------------------------


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return build(tmp_path_factory.mktemp("release"))


def _metadata(wheel: Path) -> Message:
    with ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("METADATA"))
        return message_from_string(archive.read(name).decode())


def test_the_wheel_holds_every_file_of_the_packages(release: tuple[Path, Path]) -> None:
    with ZipFile(release[1]) as archive:
        names = set(archive.namelist())
    assert {name for name in names if ".dist-info/" not in name} == package_files()


def test_the_sdist_holds_them_too_and_the_pages_about_them(release: tuple[Path, Path]) -> None:
    with tarfile.open(release[0]) as archive:
        names = {name.split("/", 1)[-1] for name in archive.getnames()}
    assert package_files() | {"pyproject.toml", "README.md"} <= names
    assert not {name for name in names if name.startswith("tests/")}


def test_the_wheel_says_what_it_is(release: tuple[Path, Path]) -> None:
    about = _metadata(release[1])
    assert (about["Name"], about["Version"]) == ("bumpbench", PROJECT["version"])
    assert "Private :: Do Not Upload" in about.get_all("Classifier", [])
    assert set(about.get_all("Provides-Extra", [])) == set(PROJECT["optional-dependencies"])
    with ZipFile(release[1]) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("entry_points.txt"))
        assert "bumpbench = tui.__main__:main" in archive.read(name).decode()


def test_a_document_names_this_version() -> None:
    assert PROJECT["version"] == VERSION


def test_the_changelog_has_this_version() -> None:
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased" or PROJECT["version"] in headings[0]
