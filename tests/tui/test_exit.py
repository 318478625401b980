"""How a command ends."""

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tui.jobs.start import sigterm_deferred

_COUNTED = """
import atexit, gc, sys
from tui.cli import main
sys.argv = ["bumpbench", *sys.argv[1:]]
atexit.register(lambda: print(gc.get_freeze_count()))
main()
"""


def test_what_is_loaded_is_not_searched_for_garbage_at_the_end() -> None:
    command = [sys.executable, "-c", _COUNTED, "inspect", "no such file"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert int(done.stdout) > 10_000


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


@pytest.fixture
def ended() -> Iterator[list[int]]:
    """Count the signals of SIGTERM in place of ending."""
    came: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, _: came.append(number))
    yield came
    signal.signal(signal.SIGTERM, before)


def test_sigterm_waits_until_a_process_is_started(ended: list[int]) -> None:
    with sigterm_deferred():
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        assert ended == []
    assert ended == [signal.SIGTERM]
    signal.raise_signal(signal.SIGTERM)
    assert len(ended) == 2


def test_what_is_loaded_is_hardly_searched_for_garbage() -> None:
    """Python's own 700 new objects would be 150 searches in an identification."""
    code = (
        "import gc, sys; sys.argv = ['bumpbench', '--version']\n"
        "from tui.__main__ import main\n"
        "try:\n    main()\nfinally:\n    assert 5_000 < gc.get_threshold()[0] < 50_000"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
