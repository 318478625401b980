"""A recorder that runs for weeks: signals, a bench that is read anew, and what it says."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from daq.bench.config import Bench, default_bench_text, parse_bench
from daq.control.messages import Phase, Reply, Status, StorageStatus, setup_of
from daq.errors import InputError
from daq.recorder.recorder import Publish
from tui.recorders.daemon import Lifetime, _Daemon, _Signals
from tui.recorders.log import Log

from ..daq.a_status import a_status

BENCH = parse_bench(default_bench_text(), "bench.toml", Path(), "")


class All:
    """Recorder, server and systemd in one, which note what they receive."""

    def __init__(self, runs: Callable[[threading.Event, Publish, Any], None]) -> None:
        self._runs = runs
        self.setup: object = None
        self.published: list[tuple[Status, object]] = []
        self.said: list[str] = []
        self.clients = False
        self.answer: Future[Reply] = Future()
        self.reloaded: list[Bench] = []
        self.stored = StorageStatus()
        self.watched: list[bool] = []

    def run(self, stop: threading.Event, publish: Publish, is_watched: Any) -> None:
        """Record."""
        self._runs(stop, publish, is_watched)

    def publish(self, status: Status, live: object) -> None:
        """Note what clients get."""
        self.published.append((status, live))

    def has_clients(self) -> bool:
        """Return whether there is one."""
        return self.clients

    def alone_s(self) -> float:
        """Return for how long none was there, s."""
        return 0.0

    def storage(self) -> StorageStatus:
        """Return what the disk has."""
        return self.stored

    def heartbeats(self) -> None:
        """None beats."""

    def notify(self, *_: object) -> str:
        """Say nothing."""
        return ""

    def stopping(self) -> None:
        """Note it."""
        self.said.append("stopping")

    def reloading(self) -> None:
        """Note it."""
        self.said.append("reloading")

    def reload(self, bench: Bench) -> Future[Reply]:
        """Take another bench."""
        self.reloaded.append(bench)
        return self.answer

    def close(self) -> None:
        """Note it."""
        self.said.append("closed")


def made(all_: All, log: Log, **changes: Any) -> _Daemon:
    plain = Lifetime(False, False, None, lambda: BENCH)
    anyone = cast(Any, all_)
    return _Daemon(anyone, anyone, anyone, replace(plain, **changes), log)


def none(*_: object) -> None:
    """Record nothing."""


def silent(done: float, text: str = "") -> None:
    """Show nothing."""


@pytest.mark.parametrize(("after_s", "killed"), [(0.5, False), (0.51, True)])
def test_a_second_signal_ends_the_process_at_once_unless_it_is_the_same_one(
    after_s: float, killed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, exits = [100.0], list[int]()
    monkeypatch.setattr("tui.recorders.daemon.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("tui.recorders.daemon.os._exit", exits.append)
    signals = _Signals(threading.Event())
    clock[0] = 200.0
    signals.take(signal.SIGTERM, None)
    assert signals.end.is_set()
    assert exits == [], "the time since the start does not count"
    clock[0] += after_s
    signals.take(signal.SIGTERM, None)
    assert exits == [128 + 15] * killed
    assert not signals.reload.is_set()
    clock[0] += 9.0
    signals.take(signal.SIGHUP, None)
    assert signals.reload.is_set()
    assert exits == [143] * killed


def test_the_last_status_comes_back_and_everything_is_published(tmp_path: Path) -> None:
    first, last = a_status(1), a_status(2)
    followed: list[Status] = []
    live = object()

    def records(_: threading.Event, publish: Publish, is_watched: Any) -> None:
        all_.watched.append(is_watched())
        publish(first, None)
        publish(last, cast(Any, live))

    all_ = All(records)
    with Log(tmp_path / "a.log") as log:
        one = made(all_, log, follow=followed.append)
        assert one.run(_Signals(threading.Event()), silent) == last
    assert followed == [first, last]
    assert all_.published[:2] == [(first, None), (last, live)]
    assert all_.said == ["stopping"]
    assert all_.watched == [True], "who follows sees the samples"


def test_a_signal_before_the_first_status_ends_it(tmp_path: Path) -> None:
    stopped: list[bool] = []

    def records(stop: threading.Event, publish: Publish, _: object) -> None:
        stopped.append(stop.wait(20.0))
        publish(replace(a_status(), recording=""), None)

    all_, signals = All(records), _Signals(threading.Event())
    signals.end.set()
    with Log(tmp_path / "a.log") as log:
        made(all_, log).run(signals, silent)
    assert stopped == [True]


@pytest.mark.parametrize("keep_on", [False, True])
def test_a_signal_ends_at_once_only_what_goes_on_after_a_campaign(
    keep_on: bool, tmp_path: Path
) -> None:
    """Else the recording is ended first, and its session file built."""
    status = replace(a_status(), recording="")
    shown: list[tuple[float, str]] = []
    enough = threading.Event()
    stopped: list[bool] = []

    def records(stop: threading.Event, publish: Publish, _: object) -> None:
        publish(status, None)
        signals.end.set()
        enough.wait(20.0)
        stopped.append(stop.is_set())

    def stage(done: float, text: str = "") -> None:
        shown.append((done, text))
        if len(shown) == 2:
            enough.set()

    all_, signals = All(records), _Signals(threading.Event())
    with Log(tmp_path / "a.log") as log:
        made(all_, log, keep_on=keep_on).run(signals, stage)
    assert stopped == [keep_on]
    assert shown[0] == (1.0, "between two campaigns, recording goes on")
    text = (tmp_path / "a.log").read_text()
    assert "recording Granada into" in text
    assert ("ended between two campaigns" in text) is keep_on, "else the outcome is printed"


def test_a_writer_that_hangs_is_reported_to_clients_and_in_the_log(tmp_path: Path) -> None:
    """Frames that came 60 s ago are not stored; the report of it does not need the writer."""
    status = a_status()
    path = tmp_path / "a.log"
    seen = threading.Event()

    def records(_: threading.Event, publish: Publish, __: object) -> None:
        publish(status, None)
        seen.wait(20.0)

    all_ = All(records)
    late = StorageStatus(received_frames=100, stored_frames=10, late_s=60.0)
    all_.stored = late

    with Log(path) as log:
        made(all_, log).run(_Signals(threading.Event()), lambda done, text="": seen.set())
    told = [one for one, _ in all_.published if one is not status]
    assert told
    assert [alarm.code for alarm in told[0].alarms][-1:] == ["not_recording"]
    assert "alarm not_recording" in path.read_text()


# Reload ------------------------------------------------------------------------------------------


def test_a_bench_that_is_read_anew_is_taken_and_sent_to_new_clients(tmp_path: Path) -> None:
    other = replace(BENCH, vehicle=replace(BENCH.vehicle, name="T5"))
    all_ = All(none)
    path = tmp_path / "a.log"
    with Log(path) as log:
        made(all_, log, reread=lambda: other)._reload()
        assert all_.reloaded == [other]
        assert all_.setup is None, "not before the recorder has it"
        all_.answer.set_result(Reply())
        log.line("then")
    assert all_.said == ["reloading"]
    assert all_.setup == setup_of(other)
    assert "reload: bench.toml reloaded" in path.read_text()


@pytest.mark.parametrize("refused", [True, False])
def test_a_bench_that_cannot_be_taken_leaves_the_one_in_force(
    refused: bool, tmp_path: Path
) -> None:
    all_ = All(none)
    path = tmp_path / "a.log"
    error = InputError("bench.toml:2", "is no table", "correct it")

    def broken() -> Bench:
        raise error

    with Log(path) as log:
        made(all_, log, reread=(lambda: BENCH) if refused else broken)._reload()
        if refused:
            all_.answer.set_exception(error)
    assert len(all_.reloaded) == refused
    assert all_.setup is None
    assert "is no table (correct it); the bench.toml in force stays" in path.read_text()


def test_a_hangup_reloads_once(tmp_path: Path) -> None:
    signals = _Signals(threading.Event())
    turns: list[int] = []
    enough = threading.Event()

    def records(_: threading.Event, publish: Publish, __: object) -> None:
        publish(replace(a_status(), phase=Phase.IDLE), None)
        enough.wait(20.0)

    def stage(done: float, text: str = "") -> None:
        turns.append(len(all_.reloaded))
        if len(turns) == 3:
            enough.set()

    all_ = All(records)
    signals.reload.set()
    with Log(tmp_path / "a.log") as log:
        made(all_, log).run(signals, stage)
    assert turns[:3] == [1, 1, 1]
    assert not signals.reload.is_set()
