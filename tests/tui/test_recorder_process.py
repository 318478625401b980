"""How a terminal starts recorders, and what it says of one that does not come up."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from daq import write_session
from daq.bench.campaign import Origin
from daq.bench.config import default_bench_text
from daq.control.messages import Alarm, SessionState, SessionStatus, Setup
from daq.errors import InputError
from daq.runs import Losses, RunStatus
from tui.cli import run
from tui.commands.tui import _starter, _wanted
from tui.recorders.daemon import Lifetime, _Daemon, _Signals
from tui.recorders.log import Log
from tui.recorders.process import (
    failure,
    last_line,
    start_recorder,
)
from tui.recorders.recording import print_outcome, recorded_session

from ..daq.a_status import a_status
from ..daq.small_session import small_session


class Started:
    """A process that is only noted."""

    def __init__(self) -> None:
        self.commands: list[list[str]] = []
        self.options: dict[str, Any] = {}
        self.code: int | None = None

    def __call__(self, command: list[str], **options: Any) -> Started:
        self.commands.append(command)
        self.options = options
        return self

    def poll(self) -> int | None:
        """Return the exit code; None while it runs."""
        return self.code


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Started:
    made = Started()
    monkeypatch.setattr("tui.recorders.process.subprocess.Popen", made)
    return made


def test_a_recorder_is_started_idle_in_its_folder(tmp_path: Path, started: Started) -> None:
    folder, bench = tmp_path / "new" / "day", tmp_path / "b.toml"
    start_recorder(bench, folder, "socketcan", "can0")
    log = str(folder / "recorder.log")
    assert started.commands == [
        [sys.executable, "-m", "tui", "record", str(bench), "--out", str(folder), "--keep-on",
         "--idle", "--log", log, "--interface", "socketcan", "--channel", "can0"]
    ]  # fmt: skip
    assert started.options["start_new_session"] is True
    assert started.options["stdin"] == started.options["stdout"] == subprocess.DEVNULL
    assert Path(log).is_file()
    assert folder.is_dir()
    start_recorder(None, folder)
    assert started.commands[1][2:] == [
        "tui", "record", "--out", str(folder), "--keep-on", "--idle", "--log", log
    ]  # fmt: skip


def test_the_end_of_a_recorder_is_the_last_line_of_its_log(tmp_path: Path) -> None:
    assert last_line(tmp_path) == "no log"
    log = tmp_path / "recorder.log"
    log.write_text(" \n\n")
    assert last_line(tmp_path) == "its log is empty"
    log.write_text("x" * 3000 + "\nbumpbench: error: can0: no such bus\n\n")
    assert last_line(tmp_path) == "can0: no such bus"
    log.write_text("Traceback\nValueError: odd\n")
    assert last_line(tmp_path) == "ValueError: odd"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (None, ""),
        (0, ""),
        (2, "the recorder ended: can0: no such bus"),
        (-9, "the recorder was ended by SIGKILL"),
    ],
)
def test_a_recorder_has_failed_if_it_ended_and_was_not_shut_down(
    code: int | None, words: str, tmp_path: Path, started: Started
) -> None:
    (tmp_path / "recorder.log").write_text("bumpbench: error: can0: no such bus\n")
    started.code = code
    assert failure(cast(Any, started), tmp_path) == words


def test_the_terminal_starts_the_recorder_that_was_asked_for(
    tmp_path: Path, started: Started
) -> None:
    bench = tmp_path / "b.toml"
    bench.write_text(default_bench_text())
    udp = ("udp_multicast", "239.74.163.9")
    _starter(tmp_path, bench, udp, False, None, 1.0, None)()
    _starter(tmp_path, bench, (None, None), True, "weak", 3.0, None)()
    _starter(tmp_path, None, (None, None), False, None, 2.0, tmp_path / "car.h5")()
    assert [command[2:5] for command in started.commands] == [
        ["tui", "record", str(bench)], ["tui.recorders.played", "demo", str(tmp_path)],
        ["tui.recorders.played", "replay", str(tmp_path)],
    ]  # fmt: skip
    assert started.commands[0][-4:] == ["--interface", udp[0], "--channel", udp[1]]
    assert started.commands[1][5:9] == ["--speed", "3", "--fault", "weak"]
    assert started.commands[2][-2:] == ["--speed", "2"]
    bench.write_text("[bus]\nspeed = 1\n")
    with pytest.raises(InputError, match=r"b\.toml:2"):
        _starter(tmp_path, bench, udp, False, None, 1.0, None)()
    assert len(started.commands) == 3


def test_what_is_not_named_may_be_anything(tmp_path: Path) -> None:
    bench = tmp_path / "b.toml"
    bench.write_text('[vehicle]\nname = "T5"\n')
    assert _wanted(None, None, None, False, None) == Setup(Origin.REAL)
    assert _wanted(None, None, None, True, None) == Setup(Origin.SIMULATED)
    assert _wanted(None, None, None, False, tmp_path) == Setup(Origin.REPLAYED)
    demo = _wanted(bench, None, None, True, None)
    assert (demo.origin, demo.buses) == (Origin.SIMULATED, None)
    named = _wanted(bench, "udp_multicast", "239.74.163.9", False, None)
    assert named.origin is Origin.REAL
    assert named.buses is not None
    bus = _wanted(None, "udp_multicast", "239.74.163.9", False, None)
    assert bus == Setup(Origin.REAL, buses=named.buses)
    assert named != bus


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--demo", "--replay", "car.h5"], "cannot be combined with --replay"),
        (["--fault", "unplug"], "add --demo"),
        (["--replay", "absent.h5"], "absent.h5: is not a file"),
        (["--demo", "--fault", "wheels-off"], "is not a fault"),
    ],
)
def test_options_of_the_terminal_that_do_not_fit_are_named(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["tui", *words]) == 2
    assert said in capsys.readouterr().err


def test_what_was_recorded_is_printed_or_why_there_is_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for state, text, said in (
        (SessionState.NONE, "", "no session file was built"),
        (SessionState.FAILED, "the disk is full", "the disk is full"),
    ):
        none = replace(a_status(), session=SessionStatus(state, text=text))
        with pytest.raises(InputError, match=said) as refused:
            recorded_session(none)
        assert refused.value.where == "/var/lib/bumpbench"
    unbuilt = SessionStatus(SessionState.FAILED, "today/a.h5", "cannot be written: no room")
    with pytest.raises(InputError) as refused:
        recorded_session(replace(a_status(), session=unbuilt))
    assert str(refused.value).startswith("today/a.h5: cannot be written: no room (the journal has")
    assert str(refused.value).count("(") == 1
    full = Alarm("journal_failed", "", "the disk is full", "make room on the disk", 1)
    with pytest.raises(InputError, match=r"the disk is full .make room on the disk.$"):
        recorded_session(replace(a_status(), alarms=(full,)))
    disk = replace(a_status().disk, held_frames=45_826, failed="the disk is full")
    gone = replace(a_status(), disk=disk, alarms=(full,), session=SessionStatus(SessionState.NONE))
    lost = "45,826 frames at the end were not stored: the disk is full (make room, then "
    with pytest.raises(InputError) as refused:
        recorded_session(gone)
    assert str(refused.value).startswith(f"/var/lib/bumpbench: {lost}")
    path = tmp_path / "car.h5"
    write_session(path, replace(small_session(), runs=()))
    earlier = replace(gone, session=SessionStatus(SessionState.READY, str(path)))
    assert print_outcome(earlier, json=False) == 3
    assert f"bumpbench: /var/lib/bumpbench: {lost}" in capsys.readouterr().err
    empty = replace(earlier, disk=a_status().disk)
    assert print_outcome(empty, json=False) == 1
    assert capsys.readouterr().err == (
        f"bumpbench: {path}: it has no accepted run (record again, and bump the car as the steps "
        "say)\n"
    )
    run = replace(small_session().runs[0], losses=Losses(), status=RunStatus.ACCEPTED, reasons=())
    write_session(path, replace(small_session(), runs=(run,)))
    assert print_outcome(empty, json=False) == 0
    write_session(path, small_session())
    there = replace(a_status(), session=SessionStatus(SessionState.READY, str(path)))
    assert recorded_session(there)[0] == path
    assert print_outcome(there, json=False) == 3, "two frames were lost"
    assert "Wagen Ü: 3 runs" in capsys.readouterr().out
    assert print_outcome(there, json=True) == 3
    assert capsys.readouterr().out.startswith("{")


# The log and the daemon -------------------------------------------------------------------------


def daemon(engine: Any, log: Log, lifetime: Lifetime) -> _Daemon:
    return _Daemon(engine, engine, engine, lifetime, log)


def test_a_recorder_that_fails_ends_the_command_with_its_reason(tmp_path: Path) -> None:
    class Failing:
        def run(self, *_: object) -> None:
            raise InputError("can0", "is gone", "plug it in")

        def stopping(self) -> None:
            """Say nothing to systemd."""

    lifetime = Lifetime(False, True, None, lambda: cast(Any, None))
    one = daemon(Failing(), Log(tmp_path / "a.log"), lifetime)
    with pytest.raises(InputError, match="is gone"):
        one.run(_Signals(threading.Event()), lambda *_: None)


def test_figures_that_cannot_be_written_and_a_thread_that_hangs_are_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]
    monkeypatch.setattr("tui.recorders.daemon.time.monotonic", lambda: clock[0])
    notified: list[float] = []

    class Hanging:
        def heartbeats(self) -> None:
            """None beats."""

        def notify(self, _: object, __: object, now_s: float) -> str:
            notified.append(now_s)
            return "the writer hangs"

    figures = tmp_path / "bumpbench.prom"
    lifetime = Lifetime(False, True, figures, lambda: cast(Any, None))
    path = tmp_path / "a.log"
    with Log(path) as log:
        one = daemon(Hanging(), log, lifetime)
        one._report(a_status())
        assert "bumpbench" in figures.read_text()
        figures.unlink()
        for now_s, written in ((100.9, False), (101.0, False), (104.9, False), (105.0, True)):
            clock[0] = now_s
            one._report(a_status())
            assert figures.exists() is written
        figures.unlink()
        figures.mkdir()
        clock[0] = 110.0
        one._report(a_status())
    assert notified == [100.0, 101.0, 104.9, 110.0]
    text = path.read_text()
    assert text.count("the writer hangs") == 4
    assert text.count(f"{figures}: ") == 1
    assert text.count("recording Granada into") == 1
