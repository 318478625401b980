"""What is asked in a terminal about the marked lines of a proposal, and what an answer becomes."""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from daq import InputError
from daq.check.propose import Proposal
from daq.check.questions import Answers
from tui.proposal_questions import completed, is_asked, write_proposal

TEXT = """# a comment  # FILL IN
[vehicle]
name = "car"  # FILL IN
[[channel]]
name = "acc_z"
x_m = 0.0  # FILL IN: from the front axle, forward
y_m = 1.0
"""


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        """Say so."""
        return True


def proposal(_: Answers) -> Proposal:
    return Proposal(TEXT, ())


Answered = Callable[..., list[str]]


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> Answered:
    """Return what types lines at a terminal of so many columns, and returns those of the text."""

    def type_(*lines: str, columns: int = 200) -> list[str]:
        # Only now: pytest puts its own streams there when a test begins.
        monkeypatch.setattr(sys, "stdin", Terminal("".join(f"{line}\n" for line in lines)))
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
        monkeypatch.setenv("COLUMNS", str(columns))
        text = completed(proposal).text
        assert text.endswith("\n")
        return text.splitlines()

    return type_


def test_marked_lines_are_filled_in_and_keep_their_remarks(
    answered: Answered, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = answered("T5", "-1.05")
    assert lines == [
        "# a comment  # FILL IN", "[vehicle]", 'name = "T5"', "[[channel]]", 'name = "acc_z"',
        "x_m = -1.05  # from the front axle, forward", "y_m = 1.0",
    ]  # fmt: skip
    assert capsys.readouterr().err == (
        "bumpbench: an empty answer leaves the question in the file\n"
        '? vehicle name (now "car"): '
        "? acc_z x_m (from the front axle, forward; now 0.0): "
    )


def test_what_is_no_number_is_asked_again_and_nothing_leaves_the_mark(
    answered: Answered, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = answered("", "far", '"1"', "2")
    assert lines[2] == 'name = "car"  # FILL IN'
    assert lines[5] == "x_m = 2  # from the front axle, forward"
    err = capsys.readouterr().err
    assert "bumpbench: 'far' is not a number\n" in err
    assert "is not a number\n? acc_z x_m" in err
    assert err.count("is not a number") == 2
    assert answered('a"b', "T5")[2] == 'name = "T5"'
    assert "'a\"b' is not a text" in capsys.readouterr().err


@pytest.mark.parametrize(("columns", "widest"), [(60, 48), (44, 32), (10, 12)])
def test_a_question_leaves_room_for_its_answer(
    columns: int, widest: int, answered: Answered, capsys: pytest.CaptureFixture[str]
) -> None:
    answered(columns=columns)
    asked = capsys.readouterr().err.partition("\n")[2]
    longest = max(len(line.rstrip()) for line in asked.replace(": ? ", ":\n? ").splitlines())
    assert widest - 12 < longest <= widest


def test_without_a_terminal_nothing_is_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stdin, stderr in ((io.StringIO("T5\n"), True), (Terminal("T5\n"), False)):
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(sys.stderr, "isatty", lambda stderr=stderr: stderr, raising=False)
        assert not is_asked()
        assert completed(proposal).text == TEXT
    assert capsys.readouterr() == ("", "")


def test_a_proposal_that_the_disk_refuses_leaves_no_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """An empty file would be in the way of the next attempt, because --force would be needed."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    target = tmp_path / "bench.toml"
    with monkeypatch.context() as patch:
        patch.setattr("daq.files.os.fsync", full)
        with pytest.raises(InputError, match="No space left"):
            write_proposal(Proposal("dbc = 'a'\n", ()), target)
    assert list(tmp_path.iterdir()) == []
    write_proposal(Proposal("dbc = 'a'\n", ()), target)
    assert target.read_text() == "dbc = 'a'\n"
