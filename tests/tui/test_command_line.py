"""One way to name things, near misses, and how a command ends."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import typer
from filelock import FileLock
from typer.core import TyperGroup
from typer.main import get_command

from daq import write_session
from daq.bus.source import BusError
from daq.control.address import FolderLockedError
from dbc.words import InputError
from tui.cli import app, run

from ..daq.small_session import small_session
from .batches import refused_session, write_all


def test_version_and_short_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.split()[0] == "bumpbench"
    assert run(["-h"]) == 0
    whole = capsys.readouterr().out
    assert "At the bench" in whole
    assert run(["status", "-h"]) == 0
    assert "The recorder's folder" in capsys.readouterr().out


def test_a_reader_of_stdout_that_has_gone_is_no_refusal() -> None:
    """`bumpbench ... | head -1` under pipefail."""
    script = "from tui.cli import run; raise SystemExit(run(['simulate', '--help']))"
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 0


def test_status_says_why_there_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["status", str(tmp_path / "absent")]) == 1
    assert "absent: there is no such folder" in capsys.readouterr().err
    assert run(["status", str(tmp_path)]) == 1
    assert list(tmp_path.iterdir()) == [], "who asks leaves nothing"
    with FileLock(tmp_path / "recorder.lock"):
        assert run(["status", str(tmp_path)]) == 1
    said = "a recorder writes there, but does not answer here"
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["study"]])
def test_saying_nothing_asks_for_help(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(arguments) == 0
    assert "Usage: bumpbench" in capsys.readouterr().out


def test_help_of_every_command_is_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    top = get_command(app)
    assert isinstance(top, TyperGroup)
    names = [[name] for name in top.commands if name != "study"]
    for words in ([], *names, ["study", "noise"]):
        assert run([*words, "--help"]) == 0
        out, err = capsys.readouterr()
        assert out.startswith("Usage: bumpbench")
        assert err == ""


def test_an_identification_that_is_refused_says_so_first(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (file,) = write_all(tmp_path, refused_session, 1)
    assert run(["identify", str(file)]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines()[0] == "verdict: refused", "without a fit there is no chi2"
    assert err == ""


# Exit codes and lines of errors -------------------------------------------------------------------


def ends(error: BaseException | None, code: int | None = None) -> int:
    """Return the exit code of a command that raises an error, or returns a code."""
    commands = typer.Typer()

    @commands.command()
    def one() -> int | None:
        """Do it."""
        if error is not None:
            raise error
        return code

    @commands.command()
    def other() -> None:
        """Do nothing."""

    return run(["one"], commands)


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (None, 0, ""),
        (InputError("a.h5", "is damaged", "build it"), 2, "a.h5: is damaged (build it)"),
        (BusError("can0", "is not there", "plug it in"), 4, "can0: is not there"),
        (FolderLockedError("x", "is locked", "end it"), 75, "x: is locked"),
        (KeyboardInterrupt(), 130, ""),
        (typer.Abort(), 130, ""),
        (typer.BadParameter("name two sessions"), 2, "name two sessions (bumpbench one --help"),
        (PermissionError(13, "Permission denied", "/root/x"), 2, "/root/x: Permission denied"),
        (OSError(36, "File name too long", b"x/y"), 2, "x/y: File name too long (name another"),
    ],
)
def test_each_kind_of_error_has_its_exit_code(
    error: BaseException | None, code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ends(error) == code
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert len(err.splitlines()) == bool(said)


# Signals and closed streams -----------------------------------------------------------------------


def test_an_export_that_is_ended_leaves_nothing_behind(tmp_path: Path) -> None:
    """A real process, ended as soon as it writes: the temporary file is large enough to be seen."""
    (tmp_path / "out").mkdir()
    words = [str(tmp_path / "car.h5"), "--out", str(tmp_path / "out" / "car.csv")]
    write_session(tmp_path / "car.h5", small_session())
    done = subprocess.run(
        [sys.executable, "-c", _ENDED, "export", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (143, "", "")
    assert list((tmp_path / "out").iterdir()) == []


_ENDED = """
import os, sys
from daq.formats import export
from tui.__main__ import main
write = export.write_csv

def ended(group, units, path, style):
    write(group, units, path, style)
    os.kill(os.getpid(), 15)

export.write_csv = ended
sys.argv = ["bumpbench", *sys.argv[1:]]
main()
"""


def test_a_stdout_without_room_is_named_in_one_line() -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "tui", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (
        2,
        "bumpbench: error: stdout: No space left on device (make room, or write to another "
        "place)\n",
    )


def test_an_error_of_another_file_is_not_taken_for_one_of_stdout(
    capsys: pytest.CaptureFixture[str],
) -> None:
    commands = typer.Typer()

    @commands.command()
    def fails() -> None:
        raise OSError(5, "Input/output error")

    with pytest.raises(OSError, match="Input"):
        run([], commands)
    assert "stdout" not in capsys.readouterr().err
