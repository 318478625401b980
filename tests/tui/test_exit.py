"""Ends of commands."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from daq import write_session
from tui.invocation import ended_by_signals, invoke

from ..daq.small_session import small_session

_INTERRUPTED = """
import signal, sys
class Keyboard:
    def find_spec(self, name, *_):
        if name == "tui.cli":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Keyboard())
sys.argv = ["bumpbench", "--help"]
from tui.__main__ import main
main()
"""


@pytest.mark.parametrize(
    ("before", "code"),
    [("", -signal.SIGINT), ("import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)", 0)],
)
def test_ctrl_c_while_the_command_line_is_loaded_is_quiet(before: str, code: int) -> None:
    """Python said where in its imports it was; a shell that has Ctrl-C ignored is obeyed."""
    command = [sys.executable, "-c", f"{before}\n{_INTERRUPTED}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, "")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize(("words", "code"), [(["inspect", "car.h5"], 0), (["inspect", "no"], 2)])
def test_a_stream_that_is_closed_is_as_the_null_device(
    closed: str, words: list[str], code: int, tmp_path: Path
) -> None:
    """Python prints a traceback, and gives the number of the stream to the next file."""
    write_session(tmp_path / "car.h5", small_session())
    script = f'exec "$0" -m tui "$@" {closed}'
    done = subprocess.run(
        ["sh", "-c", script, sys.executable, *words],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])},
    )
    assert done.returncode == code
    assert ("runs" in done.stdout) is (code == 0 and ">&-" not in closed.replace("2>&-", ""))
    assert len(done.stderr.splitlines()) == (code == 2 and "2>&-" not in closed)


@pytest.fixture
def ended() -> Iterator[list[int]]:
    """Count the signals of SIGTERM in place of ending."""
    came: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, _: came.append(number))
    yield came
    signal.signal(signal.SIGTERM, before)


def test_sigterm_is_an_exit_with_the_code_of_a_process_that_it_ends(ended: list[int]) -> None:
    with pytest.raises(SystemExit) as left, ended_by_signals():
        signal.raise_signal(signal.SIGTERM)
    assert left.value.code == 143
    assert ended == []
    signal.raise_signal(signal.SIGTERM)
    assert ended == [signal.SIGTERM], "afterwards it is as before"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_that_comes_while_an_object_is_deleted_ends_the_command_quietly(
    number: int, code: int, tmp_path: Path
) -> None:
    """Python prints and drops what is raised there; the command went on to the end of its wait."""
    done = subprocess.run(
        [sys.executable, "-c", _WRITING, str(number), str(tmp_path / "a.txt")],
        capture_output=True,
        text=True,
        check=False,
        timeout=15.0,  # less than the command waits
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", "")
    assert list(tmp_path.iterdir()) == []


_WRITING = """
import signal, sys
import typer
from daq.files import rewritten
from pathlib import Path
from tui.invocation import invoke
commands = typer.Typer()

class Deleted:
    def __del__(self):
        signal.raise_signal(int(sys.argv[1]))

@commands.command()
def write():
    with rewritten(Path(sys.argv[2])) as part:
        part.write_text("half")
        Deleted()
        signal.sigtimedwait([], 20)
    print("done")

sys.exit(invoke([], commands))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_export_that_is_ended_leaves_nothing_behind(number: int, tmp_path: Path) -> None:
    """A real process, ended as soon as it writes: the temporary file is large enough to be seen."""
    (tmp_path / "out").mkdir()
    code = _ENDED.format(number=int(number))
    words = [str(tmp_path / "car.h5"), "--out", str(tmp_path / "out" / "car.csv")]
    write_session(tmp_path / "car.h5", small_session())
    done = subprocess.run(
        [sys.executable, "-c", code, "export", *words], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", "")
    assert list((tmp_path / "out").iterdir()) == []


_ENDED = """
import os, sys
from daq.formats.export import export
from tui.__main__ import main
write = export.write_csv

def ended(group, units, path, style):
    write(group, units, path, style)
    os.kill(os.getpid(), {number})

export.write_csv = ended
sys.argv = ["bumpbench", *sys.argv[1:]]
main()
"""


@pytest.mark.parametrize("arguments", [["--help"], ["plan", "--json"]])
def test_a_stdout_without_room_is_named_in_one_line(arguments: list[str]) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "tui", *arguments],
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
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        invoke([], commands)
    assert "stdout" not in capsys.readouterr().err
