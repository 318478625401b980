"""A recorder without an operator gives its orders itself, recording after recording."""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, cast

import pytest

from daq.bench.config import Bench
from daq.control.messages import Phase, Reply, SessionState, SessionStatus, Status, StorageStatus
from daq.control.monitoring import Heartbeats, Systemd
from daq.control.orders import Arm, Order, Stop, Until
from daq.recorder.recorder import Publish
from tui.recorders.daemon import Lifetime, _Daemon, _Signals
from tui.recorders.log import Log

from ..daq.a_status import a_status


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
    lifetime = Lifetime(arm, keep_on, None, lambda: cast(Bench, None), stay=stay)
    return _Daemon(cast(Any, engine), cast(Any, None), cast(Any, None), lifetime, Log(None))


def at(recording: str, phase: Phase, session: SessionState = SessionState.NONE) -> Status:
    state = SessionStatus(session)
    return replace(a_status(), recording=recording, phase=phase, session=state)


def test_each_recording_of_a_daemon_is_armed_once_and_ended_when_complete() -> None:
    engine = Engine()
    one = daemon(engine)
    for status in (
        at("a", Phase.IDLE),
        at("a", Phase.IDLE),
        at("a", Phase.WAITING),
        at("a", Phase.COMPLETE),
        at("a", Phase.COMPLETE),
        at("", Phase.IDLE, SessionState.BUILDING),
        at("", Phase.IDLE, SessionState.READY),
        at("b", Phase.IDLE),  # a terminal has begun another
        at("b", Phase.ARMED),
        at("b", Phase.PAUSED),
        at("b", Phase.IDLE),
    ):
        one._lead(status, end=False)
    arm = Arm(Until.COMPLETE)
    assert engine.orders == [arm, Stop(), arm]
    assert not one._stop.is_set()


def test_a_complete_recording_is_left_to_the_terminal_that_looks_at_it() -> None:
    engine = Engine()
    one = daemon(engine, stay=True)
    for phase in (Phase.IDLE, Phase.ARMED, Phase.COMPLETE, Phase.COMPLETE):
        one._lead(at("a", phase), end=False)
    assert engine.orders == [Arm(Until.COMPLETE)]


def test_without_arming_nothing_is_ordered() -> None:
    engine = Engine()
    one = daemon(engine, arm=False)
    for phase in Phase:
        one._lead(at("a", phase), end=False)
    assert engine.orders == []


@pytest.mark.parametrize("end", [False, True])
def test_a_campaign_ends_with_its_session_file(end: bool) -> None:
    engine = Engine()
    one = daemon(engine, keep_on=False)
    one._lead(at("a", Phase.ARMED if end else Phase.COMPLETE), end)
    one._lead(at("", Phase.IDLE, SessionState.BUILDING), end)
    assert not one._stop.is_set()
    one._lead(at("", Phase.IDLE, SessionState.READY), end)
    assert one._stop.is_set()
    assert engine.orders == [Stop()]


def test_an_end_that_a_full_disk_refuses_is_tried_again_until_it_has_room() -> None:
    """The frames that waited in memory were lost when the recorder went."""
    engine = Engine()
    engine.refuses = True
    one = daemon(engine, keep_on=False)
    for _ in range(4):
        one._lead(at("a", Phase.COMPLETE), end=False)
    assert engine.orders == [Stop(), Stop()]
    assert not one._stop.is_set()
    engine.refuses = False
    one._lead(at("a", Phase.COMPLETE), end=False)
    one._lead(at("", Phase.IDLE, SessionState.BUILDING), end=False)
    assert not one._stop.is_set()
    one._lead(at("", Phase.IDLE, SessionState.READY), end=False)
    assert one._stop.is_set()
    assert engine.orders == [Stop()] * 3


def test_a_signal_ends_a_recorder_whose_disk_is_full_and_keeps_the_recording() -> None:
    engine = Engine()
    engine.refuses = True
    one = daemon(engine, keep_on=False)
    one._lead(at("a", Phase.COMPLETE), end=False)
    one._lead(at("a", Phase.COMPLETE), end=True)
    assert one._stop.is_set()


class Deserted:
    """A recorder and its server: for how long no client has been there, s, look by look."""

    def __init__(self, *alone_s: float) -> None:
        self.looks = list(alone_s)
        self.stopped = False

    def alone_s(self) -> float:
        return self.looks.pop(0) if self.looks else 0.0

    def run(self, stop: threading.Event, publish: Publish, _: object) -> None:
        publish(a_status(), None)
        self.stopped = stop.wait(1.5)

    def publish(self, *_: object) -> None:
        pass

    def storage(self) -> StorageStatus:
        return StorageStatus()

    def heartbeats(self) -> Heartbeats:
        return Heartbeats((), time.monotonic(), time.monotonic())


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
    both = Deserted(*alone_s)
    lifetime = Lifetime(False, True, None, lambda: cast(Bench, None), attended=attended)
    one = _Daemon(cast(Any, both), cast(Any, both), Systemd(), lifetime, Log(None))
    one.run(_Signals(threading.Event()), lambda *_: None)
    assert both.stopped == (left is not None)
    if left is not None:
        assert both.looks == left
