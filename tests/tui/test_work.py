"""The terminal's worker: a real child, children that end badly, and the list of sessions."""

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
from dataclasses import replace
from pathlib import Path
from threading import enumerate as enumerate_threads

import pytest

import daq
from daq import write_session
from tui.jobs.session_list import (
    EntryState,
    SessionEntry,
    report_of,
    sessions_in,
    size_text,
    with_open,
)
from tui.jobs.worker import (
    START,
    Done,
    IdentifyTask,
    Item,
    Line,
    ListTask,
    Progress,
    Task,
    Trouble,
    lines_of,
)

from ..daq.crash_frames import journal_of_runs
from ..daq.small_campaign import small_bench
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


def test_a_broken_file_is_one_kind_line(session: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(session.read_bytes()[:-2000])
    *_, last = lines_from_child(IdentifyTask(str(bad)))
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
    command = [sys.executable, "-c", START]
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


# The list of a folder's recordings and sessions ---------------------------------------------------


ENTRY = SessionEntry(
    "/b/granada/session_0001.h5", "/b/granada", "2026-11-21 10:42", "Granada",
    EntryState.READY, 11, 1, "wet road",
)  # fmt: skip


def test_sizes_are_for_people() -> None:
    assert [size_text(n) for n in (0, 1536, 2_500_000)] == ["0.0 kB", "1.5 kB", "2.5 MB"]


def test_what_the_recorder_is_at_is_open() -> None:
    mine = replace(ENTRY, recording="r1", state=EntryState.CUT_OFF)
    assert with_open(mine, "r1").state is EntryState.OPEN
    assert with_open(mine, "r2") == mine
    assert with_open(ENTRY, "") == ENTRY


def test_files_of_a_folder_and_of_those_below_are_listed_the_newest_first(tmp_path: Path) -> None:
    session = replace(
        refused_session(1),
        provenance={
            "created": "2026-11-21T10:42:31Z",
            "notes": '[{"by": "MK", "label": "", "text": "wet"}]',
        },
    )
    (tmp_path / "granada" / "deep").mkdir(parents=True)
    paths = [tmp_path / "b.h5", tmp_path / "granada" / "a.h5", tmp_path / "granada/deep/c.h5"]
    for age_s, path in enumerate(paths):
        write_session(path, session)
        os.utime(path, (1e9 - age_s, 1e9 - age_s))
    (tmp_path / "gone.h5").symlink_to("nowhere.h5")
    (tmp_path / "bad.h5").write_text("no session")
    os.utime(tmp_path / "bad.h5", (2e9, 2e9))
    report_of(paths[1]).write_text("report")
    bad, first, second = sessions_in(tmp_path)
    assert (bad.name, bad.state, bad.accepted, bad.rejected) == (
        "bad.h5", EntryState.DAMAGED, 0, 0,
    )  # fmt: skip
    assert bad.note
    assert bad.date[:4] == "2033"
    assert (first.name, first.state, first.date) == (
        "b.h5", EntryState.READY, "2026-11-21 10:42",
    )  # fmt: skip
    assert (first.accepted, first.rejected) == (1, 0)
    assert first.folder == str(tmp_path)
    assert (second.folder, second.state) == (str(tmp_path / "granada"), EntryState.REPORTED)


def test_a_session_without_a_date_has_that_of_its_file(tmp_path: Path) -> None:
    write_session(tmp_path / "a.h5", replace(refused_session(1), provenance={}))
    os.utime(tmp_path / "a.h5", (1_795_267_320, 1_795_267_320))  # 2026-11-21 13:22 UTC
    (only,) = sessions_in(tmp_path)
    assert only.date[:9] == "2026-11-2"
    assert only.date[-2:] in ("22", "52", "37", "07"), "of any time zone"
    assert list(sessions_in(tmp_path / "absent")) == []


def test_a_recording_without_a_session_file_is_listed_first(tmp_path: Path) -> None:
    journal_of_runs(tmp_path / "journal", 8_000)
    write_session(tmp_path / "other.h5", refused_session(1))
    cut, other = sessions_in(tmp_path)
    assert (cut.path, cut.folder, cut.state) == ("", str(tmp_path), EntryState.CUT_OFF)
    assert (cut.accepted, cut.rejected, cut.recording) == (0, 4, "ab" * 16)
    assert cut.date[:4] == "2027", "of its head, 1.8e9 s of UNIX time"
    assert (cut.vehicle, cut.note, cut.name) == (small_bench().vehicle.name, "", "journal")
    assert with_open(cut, "ab" * 16).state is EntryState.OPEN
    assert other.name == "other.h5"
    (tmp_path / "session_0001.h5").write_bytes((tmp_path / "other.h5").read_bytes())
    names = {entry.name for entry in sessions_in(tmp_path)}
    assert names == {"other.h5", "session_0001.h5"}, "its file is there"


def test_a_journal_without_a_whole_head_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "journal").mkdir()
    (tmp_path / "journal" / "journal_0001.bbj").write_bytes(b"no journal at all")
    assert list(sessions_in(tmp_path)) == []
