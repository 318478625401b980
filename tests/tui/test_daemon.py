"""A recorder that runs for weeks: its own orders, signals, a new bench, and what it reports."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from daq.bench.config import default_bench_text, parse_bench
from daq.control.messages import (
    Arm,
    Order,
    Phase,
    Reply,
    SessionState,
    SessionStatus,
    Status,
    Stop,
    StorageStatus,
    Until,
)
from daq.recorder.recorder import Publish
from dbc.words import InputError
from tui.recorders.daemon import Lifetime, _Daemon, _ended_by_signals
from tui.recorders.log import Log
from tui.recorders.traffic import Traffic

from ..daq.a_status import a_status

BENCH = parse_bench(default_bench_text(), "bench.toml", Path(), "")
TRAFFIC = Traffic(BENCH, cast(Any, None))


class Engine:
    """Remembers its orders."""

    def __init__(self) -> None:
        self.orders: list[Order] = []
        self.refuses = False

    def submit(self, order: Order, by: str) -> Future[Reply]:
        self.orders.append(order)
        future: Future[Reply] = Future()
        if self.refuses:
            future.set_exception(ValueError("the disk refuses"))
        else:
            future.set_result(Reply())
        return future


def daemon(engine: Engine, arm: bool = True, keep_on: bool = True, stay: bool = False) -> _Daemon:
    lifetime = Lifetime(arm, keep_on, stay=stay)
    none = cast(Any, None)
    return _Daemon(cast(Any, engine), none, none, TRAFFIC, lifetime, Log(None))


def at(recording: str, phase: Phase, session: SessionState = SessionState.NONE) -> Status:
    state = SessionStatus(session)
    return replace(a_status(), recording=recording, phase=phase, session=state)


BUILDING, READY = (
    at("", Phase.IDLE, state) for state in (SessionState.BUILDING, SessionState.READY)
)
OLDER_FILE = at("a", Phase.COMPLETE, SessionState.READY)
ARM, STOP = Arm(Until.COMPLETE), Stop()
DAEMON = [at("a", phase) for phase in (Phase.IDLE, Phase.IDLE, Phase.WAITING)]
DAEMON += [at("a", Phase.COMPLETE), at("a", Phase.COMPLETE), BUILDING, READY]
DAEMON += [at("b", phase) for phase in (Phase.IDLE, Phase.ARMED, Phase.PAUSED, Phase.IDLE)]
LOOKED_AT = [at("a", phase) for phase in (Phase.IDLE, Phase.ARMED, Phase.COMPLETE, Phase.COMPLETE)]


@pytest.mark.parametrize(
    ("options", "statuses", "end", "orders", "stopped"),
    [
        # A daemon arms each recording once, also one that a terminal has begun, and goes on.
        ({}, DAEMON, False, [ARM, STOP, ARM], False),
        # A complete recording is left to the terminal that looks at it.
        ({"stay": True}, LOOKED_AT, False, [ARM], False),
        ({"stay": True, "arm": False}, LOOKED_AT, False, [], False),
        # A campaign ends with its session file, whether it is complete or a signal has come.
        ({"keep_on": False}, [at("a", Phase.COMPLETE), BUILDING], False, [STOP], False),
        ({"keep_on": False}, [at("a", Phase.COMPLETE), BUILDING, READY], False, [STOP], True),
        ({"keep_on": False}, [at("a", Phase.ARMED), BUILDING, READY], True, [STOP], True),
        # One that a terminal has ended needs no order of ours: a signal ends the recorder.
        ({"keep_on": False}, [BUILDING], True, [], False),
        ({"keep_on": False}, [BUILDING, READY], True, [], True),
        # A status from before the order shows the file of the runs until then.
        ({"keep_on": False}, [OLDER_FILE, OLDER_FILE, BUILDING], False, [STOP], False),
    ],
)
def test_recordings_are_armed_and_ended_once(
    options: dict[str, bool], statuses: list[Status], end: bool, orders: list[Order], stopped: bool
) -> None:
    engine = Engine()
    one = daemon(engine, **options)
    for status in statuses:
        one._give_orders(status, end)
    assert (engine.orders, one._stop.is_set()) == (orders, stopped)


def test_an_end_that_a_full_disk_refuses_is_tried_again_until_it_has_room() -> None:
    """The frames that waited in memory were lost when the recorder went; a signal ends it."""
    engine = Engine()
    engine.refuses = True
    one = daemon(engine, keep_on=False)
    for _ in range(4):
        one._give_orders(at("a", Phase.COMPLETE), end=False)
    assert (engine.orders, one._stop.is_set()) == ([STOP, STOP], False)
    engine.refuses = False
    for status in (at("a", Phase.COMPLETE), BUILDING, READY):
        assert not one._stop.is_set()
        one._give_orders(status, end=False)
    assert (engine.orders, one._stop.is_set()) == ([STOP] * 3, True)
    engine.refuses = True
    ended = daemon(engine, keep_on=False)
    for end in (False, True):
        ended._give_orders(at("a", Phase.COMPLETE), end)
    assert ended._stop.is_set()


@pytest.mark.parametrize(
    ("attended", "alone_s", "left"),
    [
        (True, (0.0, 9.9, 9.9), None),
        (True, (0.0, 9.9, 10.1, 0.0), [0.0]),  # it ends with the third look
        (False, (10.1,), None),
    ],
)
def test_a_demonstration_ends_ten_seconds_after_its_last_terminal(
    attended: bool, alone_s: tuple[float, ...], left: list[float] | None
) -> None:
    stopped: list[bool] = []

    def records(stop: threading.Event, publish: Publish, _: object) -> None:
        publish(a_status(), None)
        stopped.append(stop.wait(0.8))

    both = All(records)
    both.looks = list(alone_s)
    lifetime = Lifetime(arm=False, keep_on=True, attended=attended)
    one = _Daemon(cast(Any, both), cast(Any, both), cast(Any, both), TRAFFIC, lifetime, Log(None))
    one.run(silent)
    assert stopped == [left is not None]
    if left is not None:
        assert both.looks == left


# Signals --------------------------------------------------------------------------------


class All:
    """Recorder, server and systemd in one, which note what they receive."""

    def __init__(self, runs: Callable[[threading.Event, Publish, Any], None]) -> None:
        self._runs = runs
        self.published: list[tuple[Status, object]] = []
        self.said: list[str] = []
        self.clients = False
        self.stored = StorageStatus()
        self.watched: list[bool] = []
        self.looks: list[float] = []  # for how long no client was there, s, look by look

    def run(self, stop: threading.Event, publish: Publish, is_watched: Any) -> None:
        self._runs(stop, publish, is_watched)

    def publish(self, status: Status, live: object) -> None:
        self.published.append((status, live))

    def has_clients(self) -> bool:
        return self.clients

    def alone_s(self) -> float:
        return self.looks.pop(0) if self.looks else 0.0

    def storage(self) -> StorageStatus:
        return self.stored

    def heartbeats(self) -> None:
        """None beats."""

    def notify(self, *_: object) -> str:
        return ""

    def stopping(self) -> None:
        self.said.append("stopping")

    def close(self) -> None:
        self.said.append("closed")


def made(all_: Any, log: Log, keep_on: bool = False, **changes: Any) -> _Daemon:
    traffic = replace(TRAFFIC, **changes)
    return _Daemon(all_, all_, all_, traffic, Lifetime(arm=False, keep_on=keep_on), log)


def silent(done: float, text: str = "") -> None:
    """Show nothing."""


def test_sigterm_ends_and_a_lost_line_does_not() -> None:
    end = threading.Event()
    with _ended_by_signals(end):
        signal.raise_signal(signal.SIGHUP)
        assert not end.is_set()
        signal.raise_signal(signal.SIGTERM)
    assert end.is_set()


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
        assert one.run(silent) == last
    assert followed == [first, last]
    assert all_.published[:2] == [(first, None), (last, live)]
    assert all_.said == ["stopping"]
    assert all_.watched == [True], "who follows sees the samples"


def test_a_signal_before_the_first_status_ends_it(tmp_path: Path) -> None:
    stopped: list[bool] = []

    def records(stop: threading.Event, publish: Publish, _: object) -> None:
        stopped.append(stop.wait(20.0))
        publish(replace(a_status(), recording=""), None)

    all_ = All(records)
    with Log(tmp_path / "a.log") as log:
        one = made(all_, log)
        one.lifetime.end.set()
        one.run(silent)
    assert stopped == [True]


@pytest.mark.parametrize("keep_on", [False, True])
def test_a_signal_ends_at_once_only_what_goes_on_after_a_campaign(
    keep_on: bool, tmp_path: Path
) -> None:
    """Else the recording is ended first, and its session file built."""
    status = BUILDING
    shown: list[tuple[float, str]] = []
    enough = threading.Event()
    stopped: list[bool] = []

    def records(stop: threading.Event, publish: Publish, _: object) -> None:
        publish(status, None)
        one.lifetime.end.set()
        enough.wait(20.0)
        stopped.append(stop.is_set())

    def stage(done: float, text: str = "") -> None:
        shown.append((done, text))
        if len(shown) == 2:
            enough.set()

    with Log(tmp_path / "a.log") as log:
        one = made(All(records), log, keep_on=keep_on)
        one.run(stage)
    assert stopped == [keep_on]
    assert shown[0] == (1.0, "building the session file")
    text = (tmp_path / "a.log").read_text()
    assert "recording Granada into" in text


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
        made(all_, log).run(lambda done, text: seen.set())
    news = [one for one, _ in all_.published if one is not status]
    assert news
    assert [alarm.code for alarm in news[0].alarms][-1:] == ["not_recording"]
    assert "alarm not_recording" in path.read_text()


def test_a_recorder_that_fails_ends_the_command_with_its_reason(tmp_path: Path) -> None:
    class Failing:
        def run(self, *_: object) -> None:
            raise InputError("can0", "is gone", "plug it in")

        def stopping(self) -> None:
            """Say nothing to systemd."""

    one = made(Failing(), Log(tmp_path / "a.log"), keep_on=True)
    with pytest.raises(InputError, match="is gone"):
        one.run(lambda *_: None)
