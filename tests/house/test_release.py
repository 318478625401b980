"""What a release holds; `python -m tests.house.release` installs one."""

from __future__ import annotations

import re
import tarfile
import tomllib
from email import message_from_string
from email.message import Message
from pathlib import Path
from zipfile import ZipFile

import pytest

from identify.result import VERSION

from .built import ROOT, build, package_files

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
