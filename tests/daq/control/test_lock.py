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
from daq.control.lock import is_locked, lone_recorder, unreachable_words
from daq.errors import FolderLockedError, InputError
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


def test_of_a_new_folder_in_which_nothing_was_made_nothing_is_left(tmp_path: Path) -> None:
    with lone_recorder(tmp_path / "today"):
        assert is_locked(tmp_path / "today")
    assert list(tmp_path.iterdir()) == []
    with lone_recorder(tmp_path / "today"):
        (tmp_path / "today" / "journal").mkdir()
    assert {path.name for path in (tmp_path / "today").iterdir()} == {"recorder.lock", "journal"}


def test_a_second_recorder_learns_who_has_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "today"
    code = (
        "import sys; from pathlib import Path; from daq.control.lock import lone_recorder\n"
        "with lone_recorder(Path(sys.argv[1])):\n"
        "    print('locked', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout
        other.stdout.readline()
        with (
            pytest.raises(FolderLockedError, match=rf"another recorder \(pid {other.pid}\)"),
            lone_recorder(folder),
        ):
            pass
        assert f"pid {other.pid}" in unreachable_words(folder)
        with lone_recorder(tmp_path / "elsewhere"):
            pass
        other.kill()
    with lone_recorder(folder):  # what a killed one leaves behind blocks no other
        assert (folder / "recorder.pid").read_text() == f"{os.getpid()}\n"


def test_a_folder_that_cannot_be_made_or_looked_into_is_said_to_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "ascii")
    with pytest.raises(InputError, match="Not a directory"), lone_recorder(tmp_path / "file" / "x"):
        pass
    assert not is_locked(tmp_path / "file" / "folder")
    folder = tmp_path / ("x" * 300)  # as one of another user; here its name is too long
    assert not is_locked(folder)
    assert unreachable_words(folder) == "its recorder cannot be reached: File name too long"
    assert unreachable_words(tmp_path) == ""
