"""The documentation's commands: every option exists, and what can be run here runs."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from daq.session import write_session
from tui.cli import run

from ..identify.stress import stress_session

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_COMMAND = re.compile(r"^(?: {4})?(bumpbench (?!:).*)$", re.MULTILINE)


def _commands(page: Path, text: str) -> list[tuple[str, str]]:
    return [(page.name, line.split("#")[0].strip()) for line in _COMMAND.findall(text)]


WRITTEN = [command for page in PAGES for command in _commands(page, page.read_text("utf-8"))]
RUNNABLE = [
    command
    for page in PAGES
    for command in _commands(page, page.read_text("utf-8").partition("\n## Commands\n")[2])
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("docs")
    write_session(made / "session.h5", stress_session("linear", 1))
    return made


def test_the_pages_hold_commands() -> None:
    assert len(WRITTEN) > 20
    assert len(RUNNABLE) > 8


@pytest.mark.parametrize(("page", "line"), WRITTEN)
def test_every_option_exists(page: str, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = shlex.split(line)[1:]
    named = [word for word in words[:2] if not word.startswith("-")]
    command = named if named[0] == "study" and len(named) > 1 else named[:1]
    assert run([*command, "--help"]) == 0
    said = capsys.readouterr().out
    for word in words:
        if word.startswith("--"):
            assert word in said, f"{page}: {line}: no option {word}"


@pytest.mark.parametrize(("page", "line"), RUNNABLE)
def test_what_can_be_run_runs(
    page: str, line: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert run(shlex.split(line)[1:]) == 0, f"{page}: {line}"
