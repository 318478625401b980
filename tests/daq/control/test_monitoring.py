"""Words and figures for systemd and a monitoring system."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from daq.control.messages import (
    Alarm,
    BusState,
    BusStatus,
    DiskStatus,
    QueueStatus,
    Status,
    StorageStatus,
)
from daq.control.monitoring import Heartbeats, Systemd, standstill, status_line, write_figures
from daq.runs import Losses

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


# The file of figures ------------------------------------------------------------------------------

STATUS = replace(
    a_status(),
    disk=DiskStatus(101, 102, 103, 0.5, held_frames=104),
    queue=QueueStatus(105, 106, 107),
    storage=StorageStatus(108, 109, 0.25),
    sensors_alive=110,
    sensors_expected=111,
    viewers=112,
    losses=Losses(bus_dropped=113, queue_dropped=114, counter_gaps=115),
    buses=(
        BusStatus("a", BusState.OK, 0.125, 1.0, 116, 117, 118),
        BusStatus("b", BusState.ERROR_PASSIVE, 0.0, 0.0, 0, 0, 0),
        BusStatus("c", BusState.BUS_OFF, 0.0, 0.0, 0, 0, 0),
    ),
)
FIGURES = {
    "recording": 1,
    "campaign": 1,
    "unstored_seconds": 0.25,
    "received_frames_total": 108,
    "stored_frames_total": 109,
    "status_seconds": 1.8e9,
    "recorded_frames": 103,
    "lag_seconds": 0.5,
    "disk_free_bytes": 101,
    "journal_bytes": 102,
    "held_frames": 104,
    "queue_blocks": 105,
    "queue_high_blocks": 106,
    "sensors_alive": 110,
    "sensors_expected": 111,
    "viewers": 112,
    "lost_frames bus_dropped": 113,
    "lost_frames queue_dropped": 114,
    "lost_frames counter_gaps": 115,
    "bus_up a": 1,
    "bus_up b": 1,
    "bus_up c": 0,
    "bus_load a": 0.125,
    "bus_frames a": 116,
    "bus_error_frames a": 117,
    "bus_reopened a": 118,
}


def written(folder: Path, status: Status) -> dict[str, float]:
    path = folder / "bumpbench.prom"
    write_figures(path, status)
    return {
        " ".join([sample.name.removeprefix("bumpbench_"), *sample.labels.values()]): sample.value
        for family in text_string_to_metric_families(path.read_text("utf-8"))
        for sample in family.samples
    }


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    return written(tmp_path_factory.mktemp("figures"), STATUS)


@pytest.mark.parametrize(("name", "value"), FIGURES.items())
def test_each_figure_has_its_name(figures: dict[str, float], name: str, value: float) -> None:
    assert figures[name] == value


def test_between_campaigns_and_where_nothing_is_stored_the_figures_are_zero(tmp_path: Path) -> None:
    alarm = Alarm("not_recording", "disk", "no frame is stored", "make room", 1)
    found = written(tmp_path, replace(STATUS, recording="", alarms=(alarm,)))
    assert (found["campaign"], found["recording"], found["alarms not_recording"]) == (0, 0, 1)
