"""The worker: its lines, a real child on a small session, and children that end badly."""

from __future__ import annotations

import asyncio
import gc
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import aclosing
from pathlib import Path
from threading import enumerate as enumerate_threads

import pytest

import daq
from daq.runs import RunStatus
from tui.jobs.lines import (
    Done,
    ExportTask,
    IdentifyTask,
    Item,
    Line,
    ListTask,
    Progress,
    Task,
    Trouble,
)
from tui.jobs.worker import lines_of, without

from .batches import refused_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "session_0001.h5"
    daq.write_session(path, refused_session(1))
    return path


def lines_from_child(task: Task, see: Callable[[Line], None] = lambda _: None) -> list[Line]:
    """Return the lines of a real child."""

    async def listen() -> list[Line]:
        lines: list[Line] = []
        async with aclosing(lines_of(task, "the work")) as source:
            async for line in source:
                lines.append(line)
                see(line)
        return lines

    return asyncio.run(listen())


def test_a_trial_without_a_run(session: Path) -> None:
    whole = daq.read_session(session)
    trial = without(whole, ("baseline_bounce_1", "no_such_run_1"))
    rejected = [run.label for run in trial.runs if run.status is RunStatus.REJECTED]
    assert rejected == ["baseline_bounce_1"]
    assert [run.frames for run in trial.runs] == [run.frames for run in whole.runs]


def test_a_broken_file_is_one_kind_line(session: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(session.read_bytes()[:-2000])
    *_, last = lines_from_child(ExportTask(str(bad), "csv"))
    assert isinstance(last, Trouble)
    assert "bad.h5" in last.text
    assert "cut off" in last.what
    assert "\n" not in last.text
    assert "Traceback" not in last.text


def test_a_child_says_what_it_does_and_sends_the_outcome(session: Path) -> None:
    first, *between, last = lines_from_child(IdentifyTask(str(session)))
    assert first == Progress(0.05, "reading")
    assert all(isinstance(line, Progress) for line in between)
    assert isinstance(last, Done)
    assert last.body.result.quality.verdict == "refused"
    assert last.body.session == str(session)


def test_a_killed_child_is_reported(session: Path) -> None:
    killed: list[int] = []

    def kill(line: Line) -> None:
        if not killed:
            children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text()
            for pid in map(int, children.split()):
                if b"tui.jobs.worker" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

    last = lines_from_child(IdentifyTask(str(session)), kill)[-1]
    assert killed
    assert isinstance(last, Trouble)
    assert "signal 9" in last.what


@pytest.mark.parametrize("turns", [0, 1, 2, 5])
def test_a_screen_closed_twice_in_a_row_leaves_nothing_open(tmp_path: Path, turns: int) -> None:
    async def closed() -> None:
        async def listen() -> None:
            async with aclosing(lines_of(ListTask(str(tmp_path)), "list")) as source:
                async for _ in source:
                    pass

        work = asyncio.create_task(listen())
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
    command = [sys.executable, "-m", "tui.jobs.worker"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        pickle.dump((IdentifyTask(str(session)), "work"), child.stdin)
        child.stdin.flush()
        assert pickle.load(child.stdout) == Progress(0.05, "reading")
        child.stdin.close()
        assert child.wait(20.0) == 1
        assert b"Done" not in child.stdout.read()


def test_the_list_shows_sessions_reports_and_bad_files(session: Path, tmp_path: Path) -> None:
    good = tmp_path / "session_0001.h5"
    good.write_bytes(session.read_bytes())
    (tmp_path / "old").mkdir()
    reported = tmp_path / "old" / "session_0002.h5"
    reported.write_bytes(session.read_bytes())
    reported.with_suffix(".html").write_text("report")
    (tmp_path / "bad.h5").write_text("no HDF5 \x1b[31m")
    lines = lines_from_child(ListTask(str(tmp_path)))
    entries = {line.body.path: line.body for line in lines if isinstance(line, Item)}
    states = {Path(path).name: entry.state for path, entry in entries.items()}
    assert states == {
        "session_0001.h5": "ready",
        "session_0002.h5": "reported",
        "bad.h5": "damaged",
    }
    assert entries[str(good)].accepted == 1
    assert entries[str(good)].vehicle == daq.read_session(session).vehicle.name
