"""What makes a recorder a daemon, part by part: lock, watchdog, words for systemd, figures."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from daq.control.lock import lone_recorder
from daq.control.messages import Alarm
from daq.control.monitoring import Heartbeats, Systemd, standstill, status_line, write_figures
from daq.errors import FolderLockedError, InputError

from ..a_status import a_status

WELL = Heartbeats((("can0", 100.0), ("can1", 100.1)), 100.0, 100.0)


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


def test_a_second_recorder_learns_who_has_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "today"
    code = (
        "import sys; from pathlib import Path; from daq.control.lock import lone_recorder\n"
        "with lone_recorder(Path(sys.argv[1])):\n"
        "    print('held', flush=True); sys.stdin.read()"
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
        with lone_recorder(tmp_path / "elsewhere"):
            pass
        other.kill()
    with lone_recorder(folder):  # what a killed one leaves behind blocks no other
        assert (folder / "recorder.pid").read_text() == f"{os.getpid()}\n"
    with pytest.raises(InputError, match="Not a directory"), lone_recorder(tmp_path / "f" / "x"):
        pass


@pytest.fixture(autouse=True)
def _a_file(tmp_path: Path) -> None:
    (tmp_path / "f").write_text("")


@pytest.mark.parametrize(
    ("beats", "now_s", "said"),
    [
        (WELL, 100.0, ""),
        (WELL, 102.0, ""),
        (WELL, 102.05, "the reader of can0"),
        (replace(WELL, readers=(("can0", 103.0), ("can1", 0.0))), 103.0, "the writer"),
        (replace(WELL, readers=(), writer_s=159.9), 160.0, ""),
        (replace(WELL, readers=(), writer_s=160.1), 160.1, "nothing has reached the disk"),
        (Heartbeats((("can0", 0.0),), 100.0, 0.0), 100.0, ""),  # not begun yet: not hanging
    ],
)
def test_what_hangs_is_named(beats: Heartbeats, now_s: float, said: str) -> None:
    assert standstill(beats, now_s).startswith(said)
    assert bool(standstill(beats, now_s)) == bool(said)


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

        systemd.reloading()
        systemd.notify(WELL, status, 100.0)
        systemd.stopping()
        assert heard(listener) == ["RELOADING=1", "WATCHDOG=1", "READY=1", "STOPPING=1"]

        # A socket that is not emptied blocks nothing.
        for i in range(2000):
            systemd.notify(WELL, replace(status, sensors_alive=i), 100.0)
        systemd.close()


def test_without_systemd_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    systemd = Systemd()
    assert systemd.notify(WELL, a_status(), 100.0) == ""
    systemd.close()


def test_the_figures_are_what_the_status_says(tmp_path: Path) -> None:
    path = tmp_path / "bumpbench.prom"
    alarm = Alarm("stale", "IMU", "silent for 3 s", "check its plug", 1)
    write_figures(path, a_status())
    write_figures(path, a_status(alarms=(alarm, replace(alarm, subject='o"dd\n'))))
    found = {
        (sample.name, *sample.labels.values()): sample.value
        for family in text_string_to_metric_families(path.read_text())
        for sample in family.samples
    }
    assert found["bumpbench_recorded_frames",] == 18_345
    assert found["bumpbench_lost_frames", "counter_gaps"] == 4
    assert found["bumpbench_bus_up", "can0"] == 1
    assert found["bumpbench_bus_up", "can2"] == 0
    assert found["bumpbench_bus_load", "can1"] == 0.25
    assert found["bumpbench_alarms", "stale"] == 2
    assert found["bumpbench_status_seconds",] == 1.8e9
    with pytest.raises(OSError, match="No such file"):
        write_figures(tmp_path / "nowhere" / "x.prom", a_status())


def test_the_line_of_status_is_short() -> None:
    assert re.fullmatch(r"2/3 buses, .* lost", status_line(a_status()))
    assert len(status_line(a_status())) < 100
