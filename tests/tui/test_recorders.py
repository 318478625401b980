"""How a terminal starts recorders, what they record, and what is told of the end."""

from __future__ import annotations

import subprocess
import sys
import threading
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import pytest

from daq import write_session
from daq.bench.campaign import Origin
from daq.bench.config import RecorderConfig, default_bench_text, parse_bench
from daq.bus.source import HopLosses
from daq.control.messages import Alarm, SessionState, SessionStatus, Setup
from daq.errors import InputError
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from daq.runs import Losses, RunStatus
from dbc import shipped_dbc
from tui.cli import run
from tui.commands.demo import begun_anew
from tui.commands.tui import _starter, _wanted
from tui.invocation import invoke
from tui.recorders import recording
from tui.recorders.daemon import Lifetime
from tui.recorders.log import Log
from tui.recorders.played import commands
from tui.recorders.process import failure, last_line, start_recorder
from tui.recorders.recording import print_outcome, record_campaign, recorded_session

from ..daq.a_status import a_status
from ..daq.crash_frames import QuickFile, journal_of_runs
from ..daq.small_campaign import bumps, small_bench, small_codec
from ..daq.small_session import small_session
from .batches import refused_session


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


# Demonstrations and replays ------------------------------------------------------------


Recorded = list[tuple[Any, Any, Path, Lifetime]]


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """Return bench, opener of buses, folder and lifetime of what would be recorded."""
    seen: Recorded = []

    def record_campaign(
        bench: Any, open_source: Any, out: Path, lifetime: Lifetime, *_: object
    ) -> None:
        seen.append((bench, open_source, out, lifetime))

    monkeypatch.setattr("tui.recorders.recording.record_campaign", record_campaign)
    return seen


def lives(lifetime: Lifetime) -> tuple[bool, bool, bool, bool]:
    return lifetime.arm, lifetime.keep_on, lifetime.stay, lifetime.attended


def test_a_replay_is_armed_goes_on_and_stays_for_its_terminal(
    tmp_path: Path, recorded: Recorded
) -> None:
    journal_of_runs(tmp_path / "journal", 8_000)
    assert run(["recover", str(tmp_path)]) == 0
    paths = (tmp_path / "replay", tmp_path / "session_0001.h5", "--log", tmp_path / "a.log")
    assert invoke(["replay", *map(str, paths)], commands) == 0
    ((bench, open_source, folder, lifetime),) = recorded
    assert folder == tmp_path / "replay"
    assert bench.origin is Origin.REPLAYED
    assert lifetime.reread() is bench
    assert [(bus.interface, bus.channel) for bus in bench.buses] == [("virtual", "session0")]
    assert lives(lifetime) == (True, True, True, True)
    source = open_source(bench.buses[0], 0)
    assert source.read(0.0) is not None
    source.close()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fault", "wheels-off"], "--fault wheels-off: is unknown"),
        (["--speed", "0.09"], "--speed"),
        (["--speed", "20.1"], "--speed"),
    ],
)
def test_a_demonstration_refuses_what_it_does_not_know(
    options: list[str],
    said: str,
    tmp_path: Path,
    recorded: Recorded,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke(["demo", str(tmp_path), *options], commands) == 2
    assert said in capsys.readouterr().err
    assert recorded == []


def test_a_session_that_no_recorder_made_is_not_replayed(
    tmp_path: Path, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "s.h5"
    write_session(session, refused_session(1))
    assert invoke(["replay", str(tmp_path), str(session)], commands) == 2
    said = capsys.readouterr().err
    assert f"{session}: does not hold its bench.toml and DBC" in said
    for speed in ("0.09", "20.1"):
        words = ["replay", str(tmp_path), str(session), "--speed", speed]
        assert invoke(words, commands) == 2
        assert "--speed" in capsys.readouterr().err
    assert recorded == []


@pytest.mark.parametrize("ended", [True, False])
def test_a_demonstration_does_not_go_on_with_one_that_was_interrupted(
    ended: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = small_bench()
    head = JournalHead(bench.text, bench.dbc_text, "test", 1, 0, "ab" * 16)
    folder = tmp_path / "demo"
    writer = JournalWriter(folder / "journal", head, RecorderConfig(), QuickFile)
    writer.append(bumps(small_codec(), 1), HopLosses())
    writer.close(ended=ended)
    again = tmp_path / "demo-2"
    assert begun_anew(folder) == (folder if ended else again)
    assert (str(again) in capsys.readouterr().err) is not ended


# A recording ----------------------------------------------------------------------

BENCH = parse_bench(default_bench_text(), "bench.toml", Path(), shipped_dbc())


@pytest.mark.parametrize(("arm", "pause_s"), [(True, 0.0), (False, 3.0)])
def test_runs_are_accepted_at_once_where_nobody_looks_at_them(
    arm: bool, pause_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []
    ran: list[Any] = []

    def recorder(*given: Any, **options: Any) -> str:
        made.extend((*given, options))
        return "recorder"

    def run_recorder(*given: Any) -> Any:
        ran.extend(given)
        return a_status()

    monkeypatch.setattr("daq.recorder.recorder.Recorder", recorder)
    monkeypatch.setattr(recording, "run_recorder", run_recorder)
    lifetime = Lifetime(arm, False, tmp_path / "a.prom", lambda: BENCH, stay=True)
    log = cast(Log, "log")

    def stage(done: float, text: str = "") -> None:
        """Show nothing."""

    def open_source(*_: object) -> Any:
        """Open nothing."""

    assert record_campaign(BENCH, open_source, tmp_path, lifetime, log, stage) == a_status()
    bench, folder, opener, options = made
    assert BENCH.campaign.accept_after_s == 3.0
    assert bench.campaign.accept_after_s == pause_s
    assert (folder, opener) == (tmp_path, open_source)
    assert options == {"software": f"bumpbench {version('bumpbench')}"}
    assert ran[0] == "recorder"
    assert ran[1] is bench
    assert (ran[2], ran[4], ran[5]) == (tmp_path, "log", stage)
    assert ran[3].reread().campaign.accept_after_s == pause_s
    assert (ran[3].arm, ran[3].figures, ran[3].stay) == (arm, tmp_path / "a.prom", True)
    assert isinstance(ran[3].end, threading.Event)


def test_a_channel_without_a_signal_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    wrong = default_bench_text().replace("IMU_Accel.acc_z", "IMU_Accel.acc_zz")
    bench = parse_bench(wrong, "bench.toml", Path(), shipped_dbc())
    lifetime = Lifetime(False, False, None, lambda: bench)
    with pytest.raises(InputError, match="acc_zz"):
        record_campaign(
            bench, cast(Any, None), tmp_path / "day", lifetime, cast(Any, None), cast(Any, None)
        )
    assert list(tmp_path.iterdir()) == []


def test_messages_of_the_dbc_that_cannot_be_used_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = '\nBO_ 1999 Broken: 8 X\n SG_ wide : 0|65@1+ (1,0) [0|0] "" X\n'
    bench = parse_bench(default_bench_text(), "bench.toml", Path(), shipped_dbc() + broken)
    monkeypatch.setattr("daq.recorder.recorder.Recorder", lambda *_, **__: None)
    monkeypatch.setattr(recording, "run_recorder", lambda *_: a_status())
    lifetime = Lifetime(False, False, None, lambda: bench)
    record_campaign(bench, cast(Any, None), tmp_path, lifetime, cast(Any, None), cast(Any, None))
    assert "left out: " in capsys.readouterr().err
