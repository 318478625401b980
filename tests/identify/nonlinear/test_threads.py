"""Runs side by side in threads."""

import subprocess
import sys
from pathlib import Path
from threading import Barrier

import pytest

from identify.nonlinear import integrator as threads


def test_runs_are_evaluated_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call waits for the other."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    threads._threads.cache_clear()
    meet = Barrier(2, timeout=60.0)

    def call(number: int, factor: float) -> float:
        meet.wait()
        return number * factor

    assert threads.for_each_run(call, (1, 2), (10.0, 100.0)) == (10.0, 200.0)


def test_an_error_of_a_run_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        threads.for_each_run(lambda a: 1 / a, (1, 0, 1))


FORKS = """
import os, threading, time
os.cpu_count = lambda: 2
from identify.nonlinear.integrator import for_each_run
meet = threading.Barrier(2)
for_each_run(lambda _: meet.wait(), (1, 2))  # both threads exist
time.sleep(0.2)  # and have nothing to do
child = os.fork()
if child == 0:
    os._exit(for_each_run(abs, (-3, -4))[1])
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


def test_a_forked_process_has_its_own() -> None:
    """Threads do not survive a fork: it would wait for ever."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORKS],
        cwd=Path(__file__).parents[3],
        timeout=60.0,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "4\n"
