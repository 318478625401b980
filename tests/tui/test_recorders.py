"""How a terminal starts recorders, what they record, and what they report at their end."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from daq import write_session
from daq.bench.campaign import Origin
from daq.bench.config import Bench, RecorderConfig, default_bench_text, parse_bench
from daq.bus.source import BusError, HopLosses
from daq.control.messages import Phase, SessionState, SessionStatus, Status
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.runs import Losses, RunStatus
from dbc import shipped_dbc
from dbc.words import Finding, InputError, Severity
from identify import Judgement
from tui.cli import run
from tui.commands.demo import next_commands
from tui.recorders import daemon
from tui.recorders.daemon import Lifetime, record_campaign
from tui.recorders.lines import print_outcome, recorded_session
from tui.recorders.process import failure, start_recorder
from tui.recorders.traffic import Traffic

from ..daq.a_status import a_status
from ..daq.crash_frames import QuickFile, journal_of_runs
from ..daq.small_campaign import bumps, small_bench, small_codec
from ..daq.small_session import small_session
from ..identify.results import result
from .batches import refused_session
from .conftest import Stages, answered

# A process of its own -----------------------------------------------------------------------------


def test_a_recorder_is_started_in_its_folder_and_outlives_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[list[str], dict[str, Any]]] = []
    monkeypatch.setattr(
        "tui.recorders.process.subprocess.Popen",
        lambda command, **options: started.append((command, options)),
    )
    folder = tmp_path / "new" / "day"
    start_recorder(folder, "b.toml", "--idle")
    ((command, options),) = started
    log = folder / "recorder.log"
    assert command == [
        sys.executable, "-m", "tui", "record", "--keep-on", "b.toml", "--idle",
        "--out", str(folder), "--log", str(log),
    ]  # fmt: skip
    assert options["start_new_session"] is True
    assert options["stdin"] == options["stdout"] == subprocess.DEVNULL
    assert log.is_file()


@pytest.mark.parametrize(
    ("code", "log", "words"),
    [
        (None, "", ""),
        (0, "", ""),
        (-9, "", "the recorder was ended by SIGKILL"),
        (2, None, "the recorder ended: its log is empty"),
        (2, " \n\n", "the recorder ended: its log is empty"),
        (2, "x" * 3000 + "\nbumpbench: error: can0: no such bus\n\n",
         "the recorder ended: can0: no such bus"),
        (1, "Traceback\nValueError: odd\n", "the recorder ended: ValueError: odd"),
    ],
)  # fmt: skip
def test_a_recorder_that_was_not_shut_down_says_why_in_the_last_line_of_its_log(
    code: int | None, log: str | None, words: str, tmp_path: Path
) -> None:
    if log is not None:
        (tmp_path / "recorder.log").write_text(log)

    class Ended:
        def poll(self) -> int | None:
            return code

    assert failure(cast(Any, Ended()), tmp_path) == words


# What is recorded ---------------------------------------------------------------------------------


class Recorded:
    """A recorder that records nothing: it notes what it is given, and reports a session."""

    def __init__(self, session: Path) -> None:
        self.traffic: Traffic
        self.folder: Path
        self.lifetime: Lifetime
        self.calls = 0
        status = SessionStatus(SessionState.READY, str(session))
        self.last = replace(a_status(), session=status)

    def __call__(
        self, traffic: Traffic, folder: Path, lifetime: Lifetime, log: Any, stage: Any
    ) -> Status:
        self.traffic, self.folder, self.lifetime = traffic, folder, lifetime
        self.calls += 1
        if traffic.follow is not None:
            traffic.follow(replace(self.last, phase=Phase.ARMED))
        stage(0.5, "recording")
        log.line("recorded")
        return self.last

    @property
    def lives(self) -> tuple[bool, bool, bool, bool]:
        """Return whether it arms, keeps on, stays at a campaign, and ends with its terminal."""
        its = self.lifetime
        return its.arm, its.keep_on, its.stay, its.attended


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Recorded:
    path = tmp_path / "session_0001.h5"
    write_session(path, small_session())
    made = Recorded(path)
    monkeypatch.setattr("tui.recorders.daemon.record_campaign", made)
    return made


@pytest.mark.parametrize(
    ("words", "held", "arm", "keep_on", "code"),
    [
        ([], 0, True, False, 3),
        (["--idle"], 0, False, False, 3),
        (["--keep-on"], 0, True, True, 0),
        (["--keep-on"], 7, True, True, 3),
    ],
)
def test_a_recorder_arms_unless_it_is_idle_and_ends_with_a_summary_unless_it_goes_on(
    words: list[str],
    held: int,
    arm: bool,
    keep_on: bool,
    code: int,
    tmp_path: Path,
    recorded: Recorded,
    capsys: pytest.CaptureFixture[str],
) -> None:
    recorded.last = replace(recorded.last, disk=replace(recorded.last.disk, held_frames=held))
    words = [*words, "--interface", "udp_multicast", "--channel", "239.74.163.99"]
    words += ["--log", str(tmp_path / "a.log")]
    assert run(["record", "--out", str(tmp_path / "day"), *words]) == code
    assert recorded.lives == (arm, keep_on, False, False)
    assert recorded.folder == tmp_path / "day"
    out = capsys.readouterr().out
    assert out.startswith("Wagen Ü: 3 runs") is not keep_on
    assert (out == "") is keep_on


def test_a_terminal_s_demonstration_waits_for_orders_and_ends_with_it(
    tmp_path: Path, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["record", "--out", str(tmp_path / "day"), "--log", str(tmp_path / "a.log")]
    words += ["--keep-on", "--idle", "--demo"]
    for mistake in (["--fault", "wheels-off"], ["--speed", "0.09"], ["--speed", "20.1"]):
        assert run([*words, *mistake]) == 2
        assert mistake[0] in capsys.readouterr().err
    assert recorded.calls == 0
    assert run([*words, "--fault", "unplug"]) == 0
    assert recorded.lives == (False, True, False, True)
    assert recorded.traffic.bench.origin is Origin.SIMULATED


def test_a_replay_is_armed_goes_on_and_stays_for_its_terminal(
    tmp_path: Path, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 8_000)
    assert run(["recover", str(tmp_path), "--out", str(tmp_path / "again.h5")]) == 0
    words = ["record", "--out", str(tmp_path / "replay"), "--log", str(tmp_path / "a.log")]
    words += ["--keep-on", "--replay"]
    assert run([*words, str(tmp_path / "again.h5")]) == 0
    assert recorded.lives == (True, True, True, True)
    traffic = recorded.traffic
    assert traffic.bench.origin is Origin.REPLAYED
    (bus,) = traffic.bench.buses
    assert (bus.interface, bus.channel) == ("virtual", "session0")
    traffic.open_source(bus, 0).close()
    foreign = tmp_path / "s.h5"
    write_session(foreign, refused_session(1))
    capsys.readouterr()
    assert run([*words, str(foreign)]) == 2
    assert f"{foreign}: does not hold its bench.toml and DBC" in capsys.readouterr().err


# A campaign ---------------------------------------------------------------------------------------

BENCH = parse_bench(default_bench_text(), "bench.toml", Path(), shipped_dbc())


class Source:
    """A bus without frames."""


class Daemon:
    """A daemon that ends at once."""

    made: Daemon

    def __init__(self, recorder: Any, _: Any, __: Any, traffic: Traffic, *___: Any) -> None:
        self.recorder, self.traffic = recorder, traffic
        Daemon.made = self

    def run(self, *_: Any) -> Status:
        """Record nothing."""
        return a_status()


@pytest.fixture
def ends_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(daemon, "Recorder", lambda *given, **_: Given(*given))
    monkeypatch.setattr(daemon, "Server", lambda *_: Given())
    monkeypatch.setattr(daemon, "_Daemon", Daemon)


class Given:
    """A recorder or its server: notes what it was made of."""

    def __init__(self, *given: Any) -> None:
        self.given = given
        self.submit = None

    def close(self) -> None:
        """Nothing is open."""


def recorded_at_once(traffic: Traffic, folder: Path, lifetime: Lifetime) -> Status:
    return record_campaign(traffic, folder, lifetime, cast(Any, None), lambda *_: None)


@pytest.mark.usefixtures("ends_at_once")
@pytest.mark.parametrize(("arm", "pause_s"), [(True, 0.0), (False, 3.0)])
def test_runs_are_accepted_at_once_where_no_one_looks_at_them(
    arm: bool, pause_s: float, tmp_path: Path
) -> None:
    traffic = Traffic(BENCH, cast(Any, None))
    assert recorded_at_once(traffic, tmp_path, Lifetime(arm, keep_on=True)) == a_status()
    bench, folder, _ = Daemon.made.recorder.given
    assert BENCH.campaign.accept_after_s == 3.0
    assert bench.campaign.accept_after_s == pause_s
    assert folder == tmp_path


@pytest.mark.usefixtures("ends_at_once")
@pytest.mark.parametrize("keep_on", [True, False])
def test_a_campaign_opens_its_buses_first_and_a_daemon_waits_for_them(
    keep_on: bool, tmp_path: Path
) -> None:
    opened: list[int] = []

    def open_source(_: object, number: int) -> Any:
        opened.append(number)
        return Source()

    traffic = Traffic(BENCH, open_source)
    lifetime = Lifetime(arm=True, keep_on=keep_on)
    recorded_at_once(traffic, tmp_path, lifetime)
    assert opened == ([] if keep_on else [0])
    reopen = Daemon.made.recorder.given[2]
    first = reopen(BENCH.buses[0], 0)
    assert opened == [0], "the bus that is open already"
    assert reopen(BENCH.buses[0], 0) is not first

    def no_bus(*_: object) -> Any:
        raise BusError("can0", "no such device", "plug it in")

    def second_fails(bus: object, number: int) -> Any:
        return no_bus() if number else Source()

    two = replace(BENCH, buses=BENCH.buses * 2)
    recorded_at_once(Traffic(two, second_fails), tmp_path, lifetime)
    traffic = replace(traffic, open_source=no_bus)
    if keep_on:
        recorded_at_once(traffic, tmp_path, lifetime)
    else:
        with pytest.raises(BusError, match="no such device"):
            recorded_at_once(traffic, tmp_path, lifetime)


def test_a_channel_without_a_signal_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    wrong = default_bench_text().replace("IMU_Accel.acc_z", "IMU_Accel.acc_zz")
    bench = parse_bench(wrong, "bench.toml", Path(), shipped_dbc())
    traffic = Traffic(bench, cast(Any, None))
    with pytest.raises(InputError, match="acc_zz"):
        recorded_at_once(traffic, tmp_path / "day", Lifetime(arm=False, keep_on=False))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("ends_at_once")
def test_messages_of_the_dbc_that_cannot_be_used_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = '\nBO_ 1999 Broken: 8 X\n SG_ wide : 0|65@1+ (1,0) [0|0] "" X\n'
    bench: Bench = parse_bench(default_bench_text(), "bench.toml", Path(), shipped_dbc() + broken)
    traffic = Traffic(bench, cast(Any, None))
    recorded_at_once(traffic, tmp_path, Lifetime(arm=False, keep_on=True))
    assert "left out: " in capsys.readouterr().err


# The end ------------------------------------------------------------------------------------------


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
    disk = replace(a_status().disk, held_frames=45_826, failed="the disk is full")
    gone = replace(a_status(), disk=disk, session=SessionStatus(SessionState.NONE))
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


# The demonstration --------------------------------------------------------------------------------


def test_a_demonstration_prints_what_was_recorded_and_identified(
    tmp_path: Path,
    recorded: Recorded,
    capsys: pytest.CaptureFixture[str],
    stages: Stages,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("identify.identify", lambda *_: result())
    out, session = tmp_path / "demo", tmp_path / "session_0001.h5"
    assert run(["demo", "--out", str(out)]) == 0
    paragraphs = capsys.readouterr().out.split("\n\n")
    assert paragraphs[0].startswith("Wagen Ü: 3 runs")
    assert paragraphs[1].endswith(f"session: {session}")
    assert paragraphs[2].splitlines()[0].strip() == "Parameters"
    row = next(line for line in paragraphs[2].splitlines() if line.startswith("m_s"))
    assert row.split()[1] == "1,380.0"
    assert row.endswith("1,380.0, +0.00 %"), "the truth, and the error of the estimate"
    next_lines = [f"  {command}" for command in next_commands(session)]
    assert paragraphs[-1].splitlines() == ["Next, to paste:", *next_lines]
    assert stages == {"record": [(0.5, "recording")], "identify": []}
    assert recorded.folder == out
    assert recorded.traffic.bench.origin is Origin.SIMULATED
    assert recorded.lives == (True, False, False, False)
    assert "recorded" in (out / "recorder.log").read_text()
    document, _ = answered(capsys, "demo", "--out", str(out))
    assert document["session"] == str(session)
    assert document["source"]["file_sha256"] == hashlib.sha256(session.read_bytes()).hexdigest()
    assert document["truth"]["m_s"] == document["parameters"]["m_s"]["value"] == 1380.0


@pytest.mark.usefixtures("recorded")
def test_a_demonstration_that_is_refused_is_exit_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grave = Judgement((Finding("x", Severity.ERROR, "no roll"),), 1.0)
    monkeypatch.setattr("identify.identify", lambda *_: replace(result(), quality=grave))
    assert run(["demo", "--out", str(tmp_path / "demo")]) == 1


def test_a_demonstration_does_not_go_on_with_one_that_was_interrupted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = small_bench()
    head = JournalHead(bench.text, bench.dbc_text, "test", 1, 0, "ab" * 16)
    writer = JournalWriter(tmp_path / "journal", head, RecorderConfig(), QuickFile)
    writer.append(bumps(small_codec(), 1), HopLosses())
    writer.close(ended=False)
    assert run(["demo", "--out", str(tmp_path)]) == 2
    assert "was interrupted (name another --out)" in capsys.readouterr().err
