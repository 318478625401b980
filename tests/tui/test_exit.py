"""How a command ends."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from tui.jobs.start import ended_by_sigterm, ignoring_interrupts, sigterm_deferred

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


def test_sigterm_is_an_exit_with_the_code_of_a_process_that_it_ends(ended: list[int]) -> None:
    with pytest.raises(SystemExit) as left, ended_by_sigterm():
        signal.raise_signal(signal.SIGTERM)
    assert left.value.code == 143
    assert ended == []
    signal.raise_signal(signal.SIGTERM)
    assert ended == [signal.SIGTERM], "afterwards it is as before"


def test_ctrl_c_does_not_reach_what_is_started_meanwhile() -> None:
    """A process inherits the signals that its parent has blocked."""

    def blocked() -> bool:
        return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

    with ignoring_interrupts():
        assert blocked()
    assert not blocked()


def test_only_the_main_thread_defers_signals(ended: list[int]) -> None:
    seen: list[bool] = []

    def work() -> None:
        before = signal.getsignal(signal.SIGTERM)
        with sigterm_deferred():
            seen.append(signal.getsignal(signal.SIGTERM) is before)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [True]
    assert ended == []


def test_what_is_loaded_is_hardly_searched_for_garbage() -> None:
    """Python's own 700 new objects would be 150 searches in an identification."""
    code = (
        "import gc, sys; sys.argv = ['bumpbench', '--version']\n"
        "from tui.__main__ import main\n"
        "try:\n    main()\nfinally:\n    assert 5_000 < gc.get_threshold()[0] < 50_000"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
