"""The documentation's commands: every option exists, and what can be run here runs."""

from __future__ import annotations

import asyncio
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from typer.core import TyperGroup
from typer.exceptions import TyperException
from typer.main import get_command

from daq.alarms.texts import EXPLAINED
from daq.bench.campaign import Method
from daq.session import write_session
from daq.verdict.words import WORDS
from tui.cli import GROUPS, app, run

from ..identify.stress import stress_session
from .pictures import DOCS, SIZES_PX, draw

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
_COMMAND = re.compile(r"^(?: {4})?(bumpbench (?!:).*)$", re.MULTILINE)
_INLINE = re.compile(r"`(bumpbench [^`]+)`")


def _commands(page: Path, text: str) -> list[tuple[str, str]]:
    return [(page.name, line.split("#")[0].strip()) for line in _COMMAND.findall(text)]


WRITTEN = [
    command
    for page in PAGES
    for text in [page.read_text("utf-8")]
    for command in [*_commands(page, text), *((page.name, c) for c in _INLINE.findall(text))]
]
FENCED = [command for page in PAGES for command in _commands(page, page.read_text("utf-8"))]
RUNNABLE = [
    command
    for page in PAGES
    for command in _commands(page, page.read_text("utf-8").partition("\n## Commands\n")[2])
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("docs")
    write_session(made / "session.h5", stress_session("linear", 1, 100.0, repeats=1))
    return made


def test_every_option_exists(capsys: pytest.CaptureFixture[str]) -> None:
    helps: dict[tuple[str, ...], str] = {}
    for page, line in WRITTEN:
        words = shlex.split(line)[1:]
        named = [word for word in words[:2] if not word.startswith("-")]
        command = tuple(named if named[:1] == ["study"] else named[:1])
        if command not in helps:
            assert run([*command, "--help"]) == 0
            helps[command] = capsys.readouterr().out
        for word in words:
            if word.startswith("--"):
                assert word in helps[command], f"{page}: {line}: no option {word}"
        first = words[len(command) :][:1]
        if command and "Arguments:" not in helps[command]:
            assert not first or first[0].startswith("-"), f"{page}: {line}: takes no argument"


@pytest.fixture(scope="module")
def parser() -> Any:
    """Return the command line without what its commands do."""
    made = get_command(app)
    assert isinstance(made, TyperGroup)
    for command in made.commands.values():
        for leaf in getattr(command, "commands", {"": command}).values():
            leaf.callback = lambda **_: None
    return made


def test_every_command_is_taken_by_the_parser(parser: Any) -> None:
    for page, line in FENCED:
        assert parser(shlex.split(line)[1:], standalone_mode=False) is None, f"{page}: {line}"


@pytest.mark.parametrize("words", ["record --chanel can0", "identify", "tui --speed 0", "reprot"])
def test_a_command_that_is_wrong_is_not(words: str, parser: Any) -> None:
    with pytest.raises(TyperException):
        parser(words.split(), standalone_mode=False)


@pytest.mark.parametrize(
    ("page", "line"),
    [
        # A report takes seconds, and `tests/tui/test_desk.py` writes one.
        pytest.param(*command, marks=[pytest.mark.long] if " report " in command[1] else [])
        for command in RUNNABLE
    ],
)
def test_what_can_be_run_runs(
    page: str, line: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert run(shlex.split(line)[1:]) == 0, f"{page}: {line}"


def test_no_page_sends_to_a_bus_that_ends_with_its_process() -> None:
    """`replay --interface virtual` was in the manual, and reaches no other process."""
    assert len(WRITTEN) > 30
    assert len(RUNNABLE) > 8
    assert not [entry for entry in WRITTEN if "--interface virtual" in str(entry)]


def test_help_lists_every_command_in_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    said = capsys.readouterr().out
    for title, commands in GROUPS.items():
        group = said.partition(f"{title}:\n")[2].partition("\n\n")[0]
        listed = [line.split()[0] for line in group.splitlines() if line[2] != " "]
        assert listed == [command.__name__.rstrip("_") for command in commands]
    assert "...\n" not in said.partition("\n")[2]


def test_the_shell_completes_commands_and_choices() -> None:
    def completed(words: str, number: int) -> list[str]:
        asked = {"_BUMPBENCH_COMPLETE": "complete_bash", "COMP_WORDS": words}
        done = subprocess.run(
            [sys.executable, "-c", "from tui.cli import main; main()"],
            env={**os.environ, **asked, "COMP_CWORD": str(number)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout.split()

    assert set(completed("bumpbench rec", 1)) == {"record", "recover"}
    assert set(completed("bumpbench tui --glyphs b", 3)) == {"braille", "blocks"}


def _rows(page: str) -> dict[str, list[str]]:
    """Return the rows of a page's tables by their first cell."""
    text = (ROOT / "docs" / page).read_text("utf-8")
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return {row[0].strip("`"): row[1:] for row in rows}


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def test_the_operator_reads_of_every_reject_what_the_recorder_says() -> None:
    rows = _rows("operator.md")
    for code, words in WORDS.items():
        if words.advice:
            reported = [f"{words.title}: {words.meaning}", _sentence(words.advice)]
            assert rows[code] == reported, code


def test_the_operator_reads_of_every_way_to_bump() -> None:
    text = (ROOT / "docs" / "operator.md").read_text("utf-8")
    for method in Method:
        assert f"(`{method}`)" in text


def test_the_manual_says_of_every_alarm_what_the_recorder_says() -> None:
    rows = _rows("recorder.md")
    for code, alarm in EXPLAINED.items():
        assert rows[code][1] == _sentence(alarm.advice), code


def test_the_bars_name_tests_that_exist() -> None:
    text = (ROOT / "docs" / "recorder.md").read_text("utf-8")
    named = re.findall(r"tests/[a-z_/]+\.py", text)
    assert len(named) >= 15
    assert [path for path in named if not (ROOT / path).is_file()] == []


# The pictures -------------------------------------------------------------------------------------

ALIKE = 0.06
"""Mean difference of a colour, of 0 to 1, that another curve or another number may make."""


@pytest.mark.long
def test_the_pictures_of_the_readme_show_the_program_as_it_is(tmp_path: Path) -> None:
    asyncio.run(draw(tmp_path))
    for name in SIZES_PX:
        drawn, kept = (matplotlib.image.imread(folder / name) for folder in (tmp_path, DOCS))
        assert drawn.shape == kept.shape, name
        assert np.mean(np.abs(drawn - kept)) < ALIKE, name
        # A screen from elsewhere differs by more.
        assert np.mean(np.abs(drawn[::-1] - kept)) > ALIKE, name
