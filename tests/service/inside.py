"""Tries the service on a machine that systemd has booted; run by `guest.py` as a unit."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from itertools import cycle
from pathlib import Path

import numpy as np

from daq.control.address import control_address
from daq.control.exchange import Client, RecorderGoneError
from daq.control.messages import AskStatus, Order, SessionState, Start, Status, Stop
from daq.session import read_session

from ..daq.small_campaign import small_codec

STATE = Path("/var/lib/bumpbench")
PATIENCE_S = 400.0
"""Longest wait for anything, s: an emulated processor takes a minute to start the recorder."""
HUB, PERIOD_S, PERIODS = "HUB_Front", 0.005, 240
"""A frame of a hub every 5 ms; what it says comes again after 1.2 s."""
NOBODY = 65534


class Sender(threading.Thread):
    """Sends frames of a hub that jumps every 1.2 s."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        for words in ("add vcan0 type vcan", "set vcan0 up"):
            subprocess.run(["ip", "link", *words.split()], check=True)
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, 1)
        self._socket.bind(("vcan0",))
        codec = small_codec()
        layout = codec.message(HUB)
        acc_g = np.where(np.arange(PERIODS) < PERIODS - 40, 0.0, 20 / 9.80665)
        names = [signal.name for signal in layout.signals if signal.name.startswith("acc")]
        payloads = codec.encode(HUB, dict.fromkeys(names, acc_g))
        head = layout.can_id.to_bytes(4, "little") + bytes([layout.length, 0, 0, 0])
        self._frames = [head + payload[:8].tobytes() for payload in payloads]

    def run(self) -> None:
        for frame in cycle(self._frames):
            time.sleep(PERIOD_S)
            with suppress(OSError):
                self._socket.send(frame)


def main() -> None:
    """Try everything in order, and print the result of each as TAP."""
    trials: list[Callable[[], str]] = [
        boot,
        nice_and_memory,
        exposure,
        campaign_by_order,
        frames_after_the_campaign,
        another_user,
        full_disk,
        whole_process_killed,
        watchdog,
        clean_stop,
        recover_as_root,
    ]
    say("\nTAP version 13")
    Sender().start()
    for number, trial in enumerate(trials, 1):
        began_s = time.monotonic()
        try:
            text = trial()
            say(f"ok {number} - {trial.__name__}: {text} [{time.monotonic() - began_s:.0f} s]")
        except Exception:
            say(f"not ok {number} - {trial.__name__}")
            say("# " + traceback.format_exc().replace("\n", "\n# "))
            say("# " + shown("ActiveState", "SubState", "Result", "NRestarts", "StatusText"))
    say(f"1..{len(trials)}")


def say(line: str) -> None:
    """Print to the console."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def run(*command: str, user: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, as root or another user."""
    drop = f"setpriv --reuid={user} --regid={user} --clear-groups".split() if user else []
    return subprocess.run([*drop, *command], capture_output=True, text=True, check=False)


def shown(*names: str) -> str:
    """Return properties of the unit, separated by spaces."""
    words = [f"--property={name}" for name in names]
    said = run("systemctl", "show", "bumpbench", *words).stdout
    return " ".join(said.split("\n")).strip()


def value(name: str) -> str:
    """Return a property of the unit."""
    return shown(name).partition("=")[2]


def until(what: Callable[[], bool]) -> None:
    """Wait until something is so.

    Raises
    ------
    AssertionError
        If it takes too long.
    """
    deadline_s = time.monotonic() + PATIENCE_S
    while not what():
        assert time.monotonic() < deadline_s, "waited too long"
        time.sleep(0.5)


def ask(order: Order) -> Status:
    """Give the recorder an order and return its status."""
    client = Client(control_address(STATE), "trial", control=True, take_over=True)
    try:
        status = client.ask(order, PATIENCE_S).status
        assert status is not None
        return status
    finally:
        client.close()


def stored() -> int:
    """Return the frames that this process of the recorder has stored; -1 if none answers."""
    try:
        return ask(AskStatus()).storage.stored_frames
    except RecorderGoneError:
        return -1


def boot() -> str:
    """Check that the boot has started the unit, and frames are stored."""
    until(lambda: value("ActiveState") == "active")
    until(lambda: stored() > 20)
    return f"{shown('StatusText')}; {Path('/proc/uptime').read_text().split()[0]} s after the boot"


def nice_and_memory() -> str:
    """Check niceness, memory, and which process is ended first if that runs out."""
    pid = value("MainPID")
    stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    assert stat[16] == "-5", stat
    assert Path(f"/proc/{pid}/oom_score_adj").read_text().strip() == "-500"
    assert value("OOMPolicy") == "continue"
    assert Path(f"/proc/{pid}/status").read_text().count("Seccomp:\t2") == 1
    return f"nice -5, {_memory_mb()} MB of 1 GB"


def exposure() -> str:
    """Check what systemd thinks of the sandbox."""
    said = run("systemd-analyze", "security", "--no-pager", "bumpbench.service").stdout
    found = re.search(r"exposure level for \S+: ([\d.]+)", said)
    assert found, said
    assert float(found[1]) <= 1.5
    return found[1]


def campaign_by_order() -> str:
    """Begin a campaign by an order, wait for a run, and end it with its session file."""
    before = ask(AskStatus()).recording
    begun = ask(Start())
    assert begun.recording not in ("", before)
    until(lambda: len(ask(AskStatus()).runs) > 0)
    ask(Stop())
    niceness: set[str] = set()
    until(lambda: _built(niceness))
    path = Path(ask(AskStatus()).session.path)
    assert path.exists()
    assert niceness <= {"-5"}, niceness  # that of the recorder
    return f"{path.name}, its builder at nice {min(niceness, default='unseen')}; {_memory_mb()} MB"


def _built(niceness: set[str]) -> bool:
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            if b"daq.session.build" in (folder / "cmdline").read_bytes():
                adjusted = (folder / "oom_score_adj").read_text().strip()
                if adjusted == "500":  # it has come as far as that
                    niceness.add((folder / "stat").read_text().rpartition(")")[2].split()[16])
    return ask(AskStatus()).session.state is SessionState.READY


def _memory_mb() -> int:
    """Return the most memory that the unit ever had, MB."""
    group = Path("/sys/fs/cgroup" + value("ControlGroup"))
    return int((group / "memory.peak").read_text()) // 1_000_000


def frames_after_the_campaign() -> str:
    """Check that what is on the bus after the campaign is stored as well."""
    status = ask(AskStatus())
    assert status.recording == ""
    before = status.storage.stored_frames
    until(lambda: stored() > before + 100)
    assert not ask(AskStatus()).alarms or "not_recording" not in {
        alarm.code for alarm in ask(AskStatus()).alarms
    }
    return f"{stored() - before} frames"


def another_user() -> str:
    """Check that a user who may not enter /var/lib/private gets one line, and root the session."""
    session = next(STATE.glob("session_*.h5"))
    for command in ("inspect", "identify", "recover"):
        target = STATE if command == "recover" else session
        said = run("bumpbench", command, str(target), user=NOBODY)
        assert said.returncode == 2, (command, said)
        assert len(said.stderr.splitlines()) == 1, (command, said.stderr)
        assert "Traceback" not in said.stderr
    assert "denied" in said.stderr.lower(), said.stderr
    assert read_session(session).runs
    return said.stderr.strip()


def full_disk() -> str:
    """Fill the disk, and give it room again: no frame is lost."""
    ballast = STATE / "ballast"
    room = os.statvfs(STATE)
    with ballast.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, room.f_bavail * room.f_bsize - 300_000)
    until(lambda: bool(ask(AskStatus()).disk.failed))
    failed = ask(AskStatus()).disk.failed
    ballast.unlink()
    until(lambda: not (ask(AskStatus()).disk.failed or ask(AskStatus()).disk.held_frames))
    assert ask(AskStatus()).disk.dropped_frames == 0
    assert value("NRestarts") == "0"
    return f"{failed}; 0 dropped"


def whole_process_killed() -> str:
    """Kill all processes of the unit: systemd starts it anew."""
    return _restarted(lambda: run("systemctl", "kill", "--signal=KILL", "bumpbench"), "signal")


def watchdog() -> str:
    """Halt the recorder: the watchdog starts it anew."""
    return _restarted(lambda: run("kill", "-STOP", value("MainPID")), "watchdog")


def _restarted(harm: Callable[[], object], result: str) -> str:
    restarts = int(value("NRestarts"))
    results: set[str] = set()

    def again() -> bool:
        results.add(value("Result"))
        return int(value("NRestarts")) > restarts and value("ActiveState") == "active"

    harm()
    until(again)
    until(lambda: stored() > 20)
    assert result in results, results
    return f"active again, {shown('StatusText')}"


def clean_stop() -> str:
    """Stop the unit: it ends by itself, and its last segment is sealed."""
    began_s = time.monotonic()
    run("systemctl", "stop", "bumpbench")
    took_s = time.monotonic() - began_s
    state = set(shown("ActiveState", "Result", "ExecMainStatus").split())
    assert state == {"ActiveState=inactive", "Result=success", "ExecMainStatus=0"}, state
    names = [path.name for path in (STATE / "journal").glob("*.bbj")]
    assert not any(name.startswith("open_") for name in names), names
    return f"{took_s:.1f} s of an emulated processor, {len(names)} segments"


def recover_as_root() -> str:
    """Build the sessions once more: nothing is missing."""
    said = run("bumpbench", "recover", str(STATE), "--out", "/run")
    assert said.returncode in (0, 3), said
    assert "missing" not in said.stderr
    assert "corrupt" not in said.stderr
    return said.stderr.strip() or "nothing lost"


if __name__ == "__main__":
    main()
