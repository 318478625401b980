"""Files of a recorder are for its user and group, whatever the umask."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.control.lock import is_locked, lone_recorder
from daq.files import write_text
from daq.journal.writer import JournalWriter

from ..crash_frames import HEAD, block


@pytest.fixture(params=[0o000, 0o022, 0o077])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def test_files_are_0640_and_folders_0750(tmp_path: Path, umask: int) -> None:
    folder = tmp_path / "today"
    with lone_recorder(folder):
        with JournalWriter(folder / "journal", HEAD, RecorderConfig(reserve_bytes=0.0)) as writer:
            writer.append(block(0, 10), HopLosses())
        write_text(folder / "note.json", "{}")
        script = f"open({str(folder / 'session.h5')!r}, 'w').close()"
        assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
        made = [folder, *folder.rglob("*")]
        modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in made}
    folders = {"today", "journal"}
    assert modes == {name: 0o750 if name in folders else 0o640 for name in modes}
    assert set(modes) >= {"journal_0001.bbj", "note.json", "session.h5", "recorder.pid"}
    assert os.umask(umask) == umask


def test_a_folder_is_locked_while_a_recorder_is_there(tmp_path: Path) -> None:
    assert not is_locked(tmp_path)
    with lone_recorder(tmp_path):
        assert is_locked(tmp_path)
    assert not is_locked(tmp_path)


def test_of_a_folder_in_which_nothing_was_made_nothing_is_left(tmp_path: Path) -> None:
    with lone_recorder(tmp_path / "today" / "car"):
        assert is_locked(tmp_path / "today" / "car")
    assert list(tmp_path.iterdir()) == []
    with lone_recorder(tmp_path / "today" / "car"):
        (tmp_path / "today" / "note").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["today", "note"]


def test_a_lock_stays_where_it_was_or_where_something_was_made(tmp_path: Path) -> None:
    (tmp_path / "note").touch()
    with lone_recorder(tmp_path):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["note"]
    (tmp_path / "recorder.lock").touch()
    with lone_recorder(tmp_path):
        pass
    assert (tmp_path / "recorder.lock").exists()
    with lone_recorder(tmp_path / "today"):
        (tmp_path / "today" / "journal").mkdir()
    assert {path.name for path in (tmp_path / "today").iterdir()} == {"recorder.lock", "journal"}
