"""`bumpbench record --keep-on` as systemd runs it, in a process of its own, over a real bus.

R14 and R15: ready after the first durable block, watchdog, reload, second instance, and an end
within seconds, while stderr is a full pipe and a client never reads.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

import can
import pytest

from daq.control.address import control_address
from daq.control.exchange import Client
from daq.control.messages import PROTOCOL, Arm, AskStatus, Order, Phase, Status
from tui.cli import run
from tui.output import ExitCode

from ..daq.adapters import own_group
from ..daq.crash_frames import read_journal
from ..tui.conftest import answered

PATIENCE_S = 30.0
END_S = 5.0
GROUP = own_group(78)
FRAMES = 1000


class Daemon:
    """A recorder under a systemd that only listens."""

    def __init__(self, folder: Path, listener: socket.socket, stderr: int) -> None:
        self.folder, self.listener = folder, listener
        self.bench = folder / "bench.toml"
        default = (Path(__file__).parents[2] / "daq" / "bench.toml").read_text()
        self.bench.write_text(default)
        self.heard: list[str] = []
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tui", "record", *self.arguments],
            stderr=stderr,
            env={**os.environ, "NOTIFY_SOCKET": listener.getsockname()},
        )

    @property
    def arguments(self) -> list[str]:
        bus = ["--interface", "udp_multicast", "--channel", GROUP]
        rest = ["--keep-on", "--idle"]
        return [str(self.bench), "--out", str(self.folder), *bus, *rest]

    def hears(self, line: str) -> None:
        """Wait until systemd hears a line; it and what came before are forgotten."""
        self.until(lambda: line in self._listen())
        del self.heard[: self.heard.index(line) + 1]

    def until(self, condition: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.process.poll() is None
            assert time.monotonic() < deadline_s, self.heard
            time.sleep(0.01)

    def _listen(self) -> list[str]:
        while True:
            try:
                self.heard += self.listener.recv(4096).decode().splitlines()
            except BlockingIOError:
                return self.heard


@pytest.fixture
def daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Daemon]:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    while True:  # no process reads stderr, and it is full already
        try:
            os.write(writer, b"x" * 4096)
        except BlockingIOError:
            break
    os.set_blocking(writer, True)
    monkeypatch.chdir(tmp_path)  # a Unix socket's path is short
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("notify")
        listener.setblocking(False)
        started = Daemon(tmp_path, listener, writer)
        try:
            yield started
        finally:
            if started.process.poll() is None:
                started.process.kill()
            started.process.wait()
            os.close(reader)
            os.close(writer)


def test_a_daemon_from_start_to_end(daemon: Daemon, capsys: pytest.CaptureFixture[str]) -> None:
    daemon.hears("READY=1")
    assert [path.stat().st_size > 0 for path in daemon.folder.glob("journal/*.bbj")] == [True]
    address = control_address(daemon.folder)
    with (
        socket.socket(socket.AF_UNIX) as deaf,
        can.Bus(interface="udp_multicast", channel=GROUP, fd=False) as bus,
    ):
        deaf.connect(str(address))
        deaf.sendall(b'%d 1 Hello {"name": "deaf"}\n' % PROTOCOL)
        client = Client(address, "Anna", control=True)
        assert client.ask(Arm()).status

        def status() -> Status:
            found = client.ask(AskStatus(), timeout_s=PATIENCE_S).status
            assert found
            return found

        daemon.until(lambda: status().phase is Phase.WAITING)
        for i in range(FRAMES):
            bus.send(can.Message(arbitration_id=0x7A0, data=i.to_bytes(2), is_extended_id=False))
            time.sleep(0.0005)
        daemon.until(lambda: status().disk.recorded_frames == FRAMES)
        daemon.hears("WATCHDOG=1")

        daemon.process.send_signal(signal.SIGHUP)  # a lost line ends nothing
        reported, _ = answered(capsys, "status", str(daemon.folder))
        assert reported["disk"]["recorded_frames"] == FRAMES
        assert reported["controller"] == "Anna"
        assert run(["status", str(daemon.folder)]) == 0
        assert "in control: Anna" in capsys.readouterr().out

        second = subprocess.run(
            [sys.executable, "-m", "tui", "record", *daemon.arguments],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert second.returncode == ExitCode.LOCKED
        assert "another recorder writes there" in second.stderr
        assert second.stderr.count("\n") == 1

        daemon.hears("WATCHDOG=1")  # and with that its queue has room again
        daemon.process.terminate()
        assert daemon.process.wait(END_S) == 0
        client.close()
    daemon_said = daemon.listener.recv(65536)
    while b"STOPPING=1" not in daemon_said:
        daemon_said = daemon.listener.recv(65536)
    journal = read_journal(sorted(daemon.folder.glob("journal/*.bbj")))
    assert not journal.lost.any
    numbers = [int.from_bytes(bytes(data[:2])) for data in journal.frames.data]
    assert numbers == list(range(FRAMES))
    assert not address.exists()
    assert run(["status", str(daemon.folder)]) == ExitCode.ANSWER_IS_NO
    assert "no recorder is running there" in capsys.readouterr().err


# The systemd unit ---------------------------------------------------------------------------------

UNIT = Path(__file__).parents[2] / "docs" / "bumpbench.service"
MANUAL = UNIT.with_name("recorder.md")
BUSY_START_S = 34
"""The slowest start that was seen, two processors shared with 24 other processes."""
ANALYZE = shutil.which("systemd-analyze")


def settings() -> dict[str, str]:
    lines = [line for line in UNIT.read_text().splitlines() if "=" in line and line[0] != "#"]
    return dict(line.split("=", 1) for line in reversed(lines))


def test_the_unit_fits_the_recorder(capsys: pytest.CaptureFixture[str]) -> None:
    unit = settings()
    assert unit["Type"] == "notify"
    assert unit["WatchdogSec"] == "10"
    assert int(unit["TimeoutStartSec"]) >= 4 * BUSY_START_S
    words = shlex.split(unit["ExecStart"])
    assert words[0] == "/usr/bin/bumpbench"
    assert run([words[1], "--help"]) == 0
    said = capsys.readouterr().out
    assert all(word in said for word in words if word.startswith("--"))
    assert "--keep-on" in words
    for code in map(int, unit["RestartPreventExitStatus"].split()):
        assert code in {ExitCode.BAD_INPUT, ExitCode.LOCKED}
    # A recorder needs its sockets, its buses and nothing else of the system.
    assert unit["RestrictAddressFamilies"] == "AF_UNIX AF_CAN AF_NETLINK"
    assert unit["CapabilityBoundingSet"] == ""
    for key in ("NoNewPrivileges", "ProtectHome", "PrivateTmp", "DynamicUser"):
        assert unit[key] == "yes"


@pytest.mark.parametrize("tool", [ANALYZE] if ANALYZE else [])
def test_systemd_finds_nothing_to_complain_of(tool: str, tmp_path: Path) -> None:
    """R14: exposure at most 2.0, and not a word from `verify`."""
    unit = tmp_path / UNIT.name
    # The program need not be installed where this is tested.
    unit.write_text(UNIT.read_text().replace("/usr/bin/bumpbench", "/bin/true"))
    verified = subprocess.run([tool, "verify", unit], capture_output=True, text=True, check=False)
    assert verified.stdout + verified.stderr == ""
    assert verified.returncode == 0
    rated = subprocess.run(
        [tool, "security", "--offline=true", "--no-pager", unit],
        capture_output=True,
        text=True,
        check=False,
    )
    exposure = re.search(r"exposure level for \S+: ([\d.]+)", rated.stdout)
    assert exposure
    assert float(exposure[1]) <= 2.0


def test_the_manual_names_every_exit_code_and_order() -> None:
    text = MANUAL.read_text()
    for exit_code in ExitCode:
        assert re.search(rf"^\| {exit_code.value} \|", text, re.MULTILINE), exit_code
    for order in get_args(Order):
        assert f"`{order.__name__}`" in text, order
    for number in range(1, 17):
        assert f"| R{number} |" in text
