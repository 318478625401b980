"""What systemd hears of a recorder."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from daq.control.monitoring import Heartbeats, Systemd, standstill, status_line

from ..a_status import a_status

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


def test_the_line_of_status_is_short() -> None:
    assert re.fullmatch(r"2/3 buses, .* lost", status_line(a_status()))
    assert len(status_line(a_status())) < 100
