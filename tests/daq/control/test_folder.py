"""The folder of a recorder: its lock, its files' rights, and the place of its sockets."""

from __future__ import annotations

import os
import re
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.control.address import (
    FolderLockedError,
    control_address,
    is_locked,
    lone_recorder,
    unreachable_words,
)
from daq.control.exchange import Server
from daq.control.messages import Order, Reply
from daq.control.monitoring import Heartbeats, Systemd, standstill, status_line
from daq.files import write_text
from daq.journal.writer import JournalWriter
from dbc.words import InputError

from ..a_status import a_status
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
    assert set(modes) >= {"journal_0001.bbj", "note.json", "session.h5"}
    assert os.umask(umask) == umask


def test_a_folder_is_locked_while_a_recorder_is_there(tmp_path: Path) -> None:
    assert not is_locked(tmp_path)
    with lone_recorder(tmp_path):
        assert is_locked(tmp_path)
    assert not is_locked(tmp_path)


def test_a_second_recorder_learns_that_the_folder_has_one(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "today"
    code = (
        "import sys; from pathlib import Path; from daq.control.address import lone_recorder\n"
        "with lone_recorder(Path(sys.argv[1])):\n"
        "    print('locked', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout
        other.stdout.readline()
        with (
            pytest.raises(FolderLockedError, match="another recorder writes there"),
            lone_recorder(folder),
        ):
            pass
        assert "a recorder writes there" in unreachable_words(folder)
        with lone_recorder(tmp_path / "elsewhere"):
            pass
        other.kill()
    with lone_recorder(folder):  # what a killed one leaves behind blocks no other
        pass


def test_a_folder_that_cannot_be_made_or_looked_into_is_said_to_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "ascii")
    with pytest.raises(InputError, match="Not a directory"), lone_recorder(tmp_path / "file" / "x"):
        pass
    assert not is_locked(tmp_path / "file" / "folder")
    folder = tmp_path / ("x" * 300)  # as one of another user; here its name is too long
    assert not is_locked(folder)
    assert unreachable_words(folder) == "its recorder cannot be reached: File name too long"
    assert unreachable_words(tmp_path) == ""


# The sockets -------------------------------------------------------------------------------------


def _unused(_: Order, by: str) -> Future[Reply]:
    raise AssertionError(by)


def test_the_directory_is_private_and_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = tmp_path / "run"
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(mine))
    address = control_address(tmp_path)
    assert address == control_address(tmp_path / "x" / "..")
    assert address != control_address(tmp_path / "x")
    assert stat.S_IMODE(mine.stat().st_mode) == 0o700
    mine.chmod(0o755)
    control_address(tmp_path)
    assert stat.S_IMODE(mine.stat().st_mode) == 0o700
    monkeypatch.undo()

    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / ("d" * 100)))
    with pytest.raises(InputError, match="path too long"):
        Server(_unused, control_address(tmp_path))
    occupied = tmp_path / "file"
    occupied.write_text("")
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(occupied))
    with pytest.raises(InputError, match="File exists"):
        control_address(tmp_path)
    elsewhere = tmp_path / "link"
    elsewhere.symlink_to(tmp_path)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(elsewhere))
    with pytest.raises(InputError, match="belongs to another user"):
        control_address(tmp_path)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    monkeypatch.setattr(os, "getuid", lambda: tmp_path.stat().st_uid + 1)
    with pytest.raises(InputError, match="belongs to another user"):
        control_address(tmp_path)


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the directory of a user without settings of systemd."""
    state = tmp_path / "s"
    monkeypatch.delenv("RUNTIME_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", str(state))
    monkeypatch.setattr("daq.control.address._SERVICE", tmp_path / "service")
    return state / "bumpbench" / "run"


def test_the_directory_is_that_of_the_user_and_never_a_shared_one(
    tmp_path: Path, state: Path
) -> None:
    assert control_address(tmp_path).parent == state
    assert stat.S_IMODE(state.stat().st_mode) == 0o700
    state.rmdir()
    state.symlink_to(tmp_path)  # somebody else was faster
    with pytest.raises(InputError, match="belongs to another user"):
        control_address(tmp_path)


@pytest.mark.parametrize(("mode", "ours"), [(0o755, True), (0o720, False), (0o702, False)])
def test_a_directory_that_others_may_have_written_to_is_not_used(
    tmp_path: Path, state: Path, mode: int, ours: bool
) -> None:
    state.mkdir(parents=True)
    state.chmod(mode)
    if ours:
        assert control_address(tmp_path).parent == state
    else:
        with pytest.raises(InputError, match="written by others"):
            control_address(tmp_path)


def test_the_recorder_of_the_service_is_seen_first(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = Path(tempfile.mkdtemp(prefix="bb"))
    try:
        monkeypatch.setenv("RUNTIME_DIRECTORY", str(short))
        there = control_address(tmp_path)
        server = Server(_unused, there)
        monkeypatch.delenv("RUNTIME_DIRECTORY")
        assert control_address(tmp_path) != there
        monkeypatch.setattr("daq.control.address._SERVICE", short)  # as root sees the unit's
        assert control_address(tmp_path) == there
        # The unit's folder is a link, to one of the user who also owns the directory.
        link = tmp_path / "link"
        link.symlink_to(tmp_path)
        with monkeypatch.context() as another:
            another.setattr(os, "getuid", lambda: 4242)
            assert control_address(link) == there
        short.chmod(0o777)  # it may be anybody's
        assert control_address(tmp_path) != there
        server.close()
    finally:
        shutil.rmtree(short)


def test_no_sockets_no_recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "getuid")
    with pytest.raises(InputError, match="Linux or macOS"):
        control_address(tmp_path)


def test_a_folder_that_cannot_be_named_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not UTF-8"):
        control_address(tmp_path / os.fsdecode(b"caf\xe9"))


# What systemd hears of a recorder -----------------------------------------------------------------

WELL = Heartbeats((("can0", 100.0), ("can1", 100.1)), 100.0, 100.0)


@pytest.mark.parametrize(
    ("heartbeats", "now_s", "hanging"),
    [
        (WELL, 102.0, ""),
        (WELL, 102.1, "the reader of can0 has had no cycle for 2.1 s"),
        (Heartbeats((), 100.0, 0.0), 102.0, ""),
        (Heartbeats((), 100.0, 0.0), 102.1, "the writer has had no cycle for 2.1 s"),
        (Heartbeats((), 159.0, 100.0), 160.0, ""),
        (Heartbeats((), 159.0, 100.0), 160.6, "nothing has reached the disk for 61 s"),
        (Heartbeats((), 200.0, 0.0), 200.0, ""),  # nothing was stored yet
    ],
)
def test_a_thread_hangs_after_two_seconds_and_a_disk_after_sixty(
    heartbeats: Heartbeats, now_s: float, hanging: str
) -> None:
    assert standstill(heartbeats, now_s) == hanging


@contextmanager
def notify_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Listen as systemd does."""
    monkeypatch.chdir(tmp_path)  # a Unix socket's path is short
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("notify")
        listener.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", "notify")
        yield listener


def heard(listener: socket.socket) -> list[str]:
    lines: list[str] = []
    while True:
        try:
            lines += listener.recv(4096).decode().splitlines()
        except BlockingIOError:
            return lines


def test_systemd_hears_only_what_was_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with notify_socket(tmp_path, monkeypatch) as listener:
        systemd = Systemd()
        status = a_status()
        # Not ready: a bus has not been tried; then: nothing is on the disk.
        systemd.notify(replace(WELL, readers=(("can0", 100.0), ("can1", 0.0))), status, 100.0)
        systemd.notify(replace(WELL, durable_s=0.0), status, 100.0)
        lines = heard(listener)
        assert "READY=1" not in lines
        assert "STATUS=2/3 buses, 12,031 frames/s, lag 40 ms, 212 GB free, 4 frames lost" in lines
        systemd.notify(WELL, status, 100.0)
        assert heard(listener) == ["WATCHDOG=1", "READY=1"]
        systemd.notify(WELL, status, 101.0)
        assert heard(listener) == ["WATCHDOG=1"]

        # A frozen reader, a frozen writer, a dead disk: the watchdog starves.
        for frozen in (
            replace(WELL, readers=(("can0", 97.0), ("can1", 100.0))),
            replace(WELL, writer_s=97.0),
            replace(WELL, durable_s=39.0),
        ):
            assert systemd.notify(frozen, status, 100.0)
            assert not [line for line in heard(listener) if line.startswith("WATCHDOG")]
        assert systemd.notify(WELL, status, 100.0) == ""
        assert "WATCHDOG=1" in heard(listener)

        systemd.stopping()
        assert heard(listener) == ["STOPPING=1"]

        # A socket that is not emptied blocks nothing.
        for i in range(2000):
            systemd.notify(WELL, replace(status, sensors_alive=i), 100.0)
        systemd.close()


def test_without_systemd_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    systemd = Systemd()
    assert systemd.notify(WELL, a_status(), 100.0) == ""
    systemd.close()


def test_the_line_of_status_is_short() -> None:
    assert re.fullmatch(r"2/3 buses, .* lost", status_line(a_status()))
    assert len(status_line(a_status())) < 100
