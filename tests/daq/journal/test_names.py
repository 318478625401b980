"""Segments that never change again differ in name from the open one, and any tool copies them."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.derive.build_session import derive
from daq.journal.folder import last_recording, scan, seal_left_open, segments_in
from daq.journal.format import JournalHead
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter

from ..crash_derive import journal_of_runs
from ..crash_disk import FailingDisk, QuickFile
from ..crash_frames import START_NS, block, numbers

ROOT = Path(__file__).parents[3]
LIMITS = RecorderConfig(segment_bytes=20_000.0, reserve_bytes=0.0)
HEAD = JournalHead("", "", "test", START_NS, 0, "a" * 32)


def names(folder: Path) -> list[str]:
    return [path.name for path in segments_in(folder)]


def test_the_open_segment_is_the_only_one_of_its_name(tmp_path: Path) -> None:
    with JournalWriter(tmp_path, HEAD, LIMITS, QuickFile) as writer:
        for k in range(12):
            writer.append(block(100 * k, 100), HopLosses())
            writer.maintain(0.1 * k)
        assert names(tmp_path) == ["journal_0001.mcap", "open_0002.mcap"]
        assert [path.name for path in writer.paths] == names(tmp_path)
        assert numbers(read_journal(segments_in(tmp_path)).frames).tolist() == list(range(1200))
        listed = segments_in(tmp_path)
    assert names(tmp_path) == ["journal_0001.mcap", "journal_0002.mcap"]
    assert writer.paths == segments_in(tmp_path)
    # A reader that had listed the files before finds the one that has another name now.
    assert numbers(read_journal(listed).frames).tolist() == list(range(1200))


def test_a_segment_with_a_failed_write_never_changes_again_either(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path, HEAD, LIMITS, FailingDisk("eio", 30).create)
    for k in range(20):
        writer.append(block(10 * k, 10), HopLosses())
    assert names(tmp_path) == ["journal_0001.mcap", "open_0002.mcap"]
    first = scan(tmp_path / "journal_0001.mcap")
    assert first is not None
    assert not first.sealed
    writer.close()


def test_what_a_killed_recorder_left_open_is_named_as_it_is(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path, HEAD, LIMITS, QuickFile)
    writer.append(block(0, 100), HopLosses())
    os.mkfifo(tmp_path / "open_0007.mcap")
    (tmp_path / "open_0009.mcap").write_bytes(b"mine")
    (tmp_path / "journal_0009.mcap").write_bytes(b"yours")
    seal_left_open(tmp_path)
    assert (tmp_path / "open_0007.mcap").is_fifo()
    assert (tmp_path / "journal_0009.mcap").read_bytes() == b"yours"
    assert (tmp_path / "open_0009.mcap").read_bytes() == b"mine"
    assert (tmp_path / "journal_0001.mcap").exists()
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.frames, [path.name for path in tail.segments]) == (100, ["journal_0001.mcap"])
    writer.close()


def test_an_open_journal_of_an_older_version_is_read(tmp_path: Path) -> None:
    writer = JournalWriter(tmp_path, HEAD, LIMITS, QuickFile)
    writer.append(block(0, 100), HopLosses())
    writer.paths[0].rename(tmp_path / "journal_0001.mcap")  # as it was called then
    tail = last_recording(tmp_path)
    assert tail is not None
    assert (tail.frames, tail.ended) == (100, False)
    writer.close()


def test_a_finished_session_has_a_second_name_that_is_written_once(tmp_path: Path) -> None:
    segments = journal_of_runs(tmp_path / "journal", 20_000)
    session, final = tmp_path / "session_0001.h5", tmp_path / "finished" / "session_0001.h5"
    derive(segments[:1], session)
    assert not final.exists()  # the end of the campaign is in the last segment
    derive(segments, session)
    assert final.samefile(session)
    before = final.read_bytes()
    derive(segments, session)
    assert not final.samefile(session)
    assert final.read_bytes() == before
    derive(segments, tmp_path / "again.h5")
    assert [path.name for path in final.parent.iterdir()] == ["session_0001.h5"]


def test_a_finished_session_is_copied_where_there_are_no_hard_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", refuse)
    segments = journal_of_runs(tmp_path / "journal", 20_000)
    session, final = tmp_path / "session_0001.h5", tmp_path / "finished" / "session_0001.h5"
    derive(segments, session)
    assert not final.samefile(session)
    assert final.read_bytes() == session.read_bytes()


def test_the_timer_of_the_manual_copies_what_never_changes_again(tmp_path: Path) -> None:
    unit = (ROOT / "docs/bumpbench-copy.service").read_text("utf-8")
    found = re.search(r"ExecStart=/bin/sh -c '(.*?)'\n", unit, re.DOTALL)
    assert found
    here, there = tmp_path / "here", tmp_path / "there"
    there.mkdir()
    rsync = "rsync --archive --files-from=- . bench@archive:bumpbench/"
    script = found[1].replace("\\\n", "").replace(rsync, f"xargs cp --parents -t {there}")
    assert "rsync" not in script
    (here / "finished").mkdir(parents=True)
    (here / "finished" / "session_0001.h5").write_bytes(b"session")
    writer = JournalWriter(here / "journal", HEAD, LIMITS, QuickFile)
    for k in range(12):
        writer.append(block(100 * k, 100), HopLosses())
        writer.maintain(0.1 * k)
    subprocess.run(["sh", "-c", script], cwd=here, check=True)
    copied = sorted(str(path.relative_to(there)) for path in there.rglob("*.*"))
    assert copied == ["finished/session_0001.h5", "journal/journal_0001.mcap"]
    writer.close()
