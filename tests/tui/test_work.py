"""The terminal's worker: a real child, and children that end badly."""

from __future__ import annotations

import asyncio
import gc
import os
import pickle
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from threading import enumerate as enumerate_threads
from typing import Any

import pytest

import daq
from dbc.words import InputError
from tui.jobs.worker import START, Outcome, Stage, answer_of, identify_session

from .batches import refused_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "session_0001.h5"
    daq.write_session(path, refused_session(1))
    return path


def answer(path: Path, stage: Stage = lambda share, text: None) -> Any:
    """Return the answer of a real child."""
    return asyncio.run(answer_of(partial(identify_session, str(path)), "the work", stage))


def test_a_broken_file_is_one_kind_line(session: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(session.read_bytes()[:-2000])
    with pytest.raises(InputError, match=r"bad\.h5: .*cut off") as raised:
        answer(bad)
    assert "\n" not in str(raised.value)


def test_a_child_says_what_it_does_and_sends_the_outcome(session: Path) -> None:
    stages: list[tuple[float, str]] = []
    outcome = answer(session, lambda share, text: stages.append((share, text)))
    assert stages[0] == (0.05, "reading")
    assert isinstance(outcome, Outcome)
    assert outcome.result.quality.verdict == "refused"
    assert outcome.session == str(session)


def test_a_killed_child_is_reported(session: Path) -> None:
    killed: list[int] = []

    def kill(*_: object) -> None:
        if not killed:
            children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text()
            for pid in map(int, children.split()):
                if b"tui.jobs.worker" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

    with pytest.raises(InputError, match="signal 9"):
        answer(session, kill)
    assert killed


@pytest.mark.parametrize("turns", [0, 2])
def test_a_screen_closed_twice_in_a_row_leaves_nothing_open(session: Path, turns: int) -> None:
    async def closed() -> None:
        task = partial(identify_session, str(session))
        work = asyncio.create_task(answer_of(task, "work", lambda share, text: None))
        for _ in range(turns):
            await asyncio.sleep(0)
        for _ in range(2):
            work.cancel()
            await asyncio.sleep(0)

    asyncio.run(closed())
    for thread in enumerate_threads():
        if thread.name == "worker":
            thread.join(10.0)
            assert not thread.is_alive()
    gc.collect()  # what is still open says so here, and that is an error


def test_the_child_ends_when_its_terminal_does(session: Path) -> None:
    command = [sys.executable, "-c", START]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        pickle.dump((partial(identify_session, str(session)), "work"), child.stdin)
        child.stdin.flush()
        assert pickle.load(child.stdout).text == "reading"
        child.stdin.close()
        assert child.wait(20.0) == 1
        assert b"Outcome" not in child.stdout.read()
