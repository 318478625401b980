"""The feed of a recorder: what it posts when that falls silent or changes hands, and its orders."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import Queue
from typing import ClassVar

import pytest

from daq.bench.campaign import Origin
from daq.control.client import OrderRefusedError, RecorderGoneError
from daq.control.messages import Reply, Setup, Status
from daq.control.orders import Arm, Order
from tui.terminal.state import feed
from tui.terminal.state.feed import Lost, News, RecorderFeed, Role

from ...daq.a_status import a_status

GONE = RecorderGoneError("here", "no recorder is running there", "start one")
STATUS = replace(a_status(5), controller="JL")


class Scripted:
    """A client that brings what the test has written down, then nothing; the second is refused."""

    made: ClassVar[list[tuple[str, bool, bool]]] = []
    asked: ClassVar[list[tuple[Order, float]]] = []
    script: ClassVar[list[Status | str | None]] = []
    """News; a text is that control was lost with it."""
    looks: ClassVar[list[float]] = []
    refuses: ClassVar[int] = 0
    again: ClassVar[threading.Event] = threading.Event()
    """Set by the second connection."""
    first_status = None
    setup = Setup(Origin.REAL)

    def __init__(self, _: object, name: str, control: bool = True, take_over: bool = False) -> None:
        Scripted.made.append((name, control, take_over))
        if len(Scripted.made) > 1:
            Scripted.again.set()
        if control and Scripted.refuses:
            Scripted.refuses -= 1
            raise OrderRefusedError("JL is in control")
        if not Scripted.script and len(Scripted.made) > 1:
            raise GONE
        self.in_control = control

    def ask(self, order: Order, timeout_s: float = 0.0) -> Reply:
        """Answer, unless it is an order to arm."""
        Scripted.asked.append((order, timeout_s))
        if isinstance(order, Arm):
            raise RecorderGoneError("here", "it has ended", "start one")
        return Reply(setup=Setup(Origin.REAL))

    def news(self, timeout_s: float) -> Status | None:
        """Bring the next news."""
        Scripted.looks.append(timeout_s)
        found = Scripted.script.pop(0) if Scripted.script else None
        if isinstance(found, str):
            self.in_control = False
            return STATUS
        return found

    def close(self) -> None:
        """Go."""


@pytest.fixture
def client(monkeypatch: pytest.MonkeyPatch) -> type[Scripted]:
    for name in ("made", "asked", "script", "looks"):
        monkeypatch.setattr(Scripted, name, [])
    monkeypatch.setattr(Scripted, "refuses", 0)
    monkeypatch.setattr(Scripted, "again", threading.Event())
    monkeypatch.setattr(feed, "Client", Scripted)
    monkeypatch.setattr(feed, "is_running", lambda _: True)
    monkeypatch.setattr(feed, "RETRY_S", 0.001)
    return Scripted


def posts(folder: Path, enough: Callable[[list[News]], bool]) -> list[News]:
    """Return what a feed posts until that is enough."""
    queue: Queue[News] = Queue()
    listener = RecorderFeed(folder, "MK", lambda: None)
    listener.start(queue.put)
    posted: list[News] = []
    try:
        while not enough(posted):
            posted.append(queue.get(timeout=30))
    finally:
        listener.stop()
    return posted


def lost(posted: list[News]) -> bool:
    return any(isinstance(news, Lost) for news in posted)


def test_a_recorder_without_news_for_two_seconds_is_lost(
    tmp_path: Path, client: type[Scripted]
) -> None:
    client.script += [STATUS, None, None, None, STATUS]
    posted = posts(tmp_path, lost)
    assert posted == [
        Role(True), Setup(Origin.REAL), STATUS, STATUS,
        Lost("the recorder has been silent for 2 s", "all frames up to then are on the disk"),
    ]  # fmt: skip
    assert client.looks == [0.25] * 13, "news begin the two seconds anew"
    assert client.made[0] == ("MK", True, False)


def test_a_recorder_that_has_ended_is_lost_at_once(
    tmp_path: Path, client: type[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feed, "is_running", lambda _: False)
    client.script += [STATUS]
    *_, last = posts(tmp_path, lost)
    assert last == Lost("the recorder has ended", "all frames up to then are on the disk")
    assert len(client.looks) == 2


def test_control_that_another_terminal_has_taken_is_said_once(
    tmp_path: Path, client: type[Scripted]
) -> None:
    client.script += [STATUS, "taken", STATUS]
    posted = posts(tmp_path, lost)
    roles = [news for news in posted if isinstance(news, Role)]
    assert roles == [Role(True), Role(False, "another terminal has taken control: C takes it back")]


@pytest.mark.parametrize(("age_s", "inherits"), [(3.9, True), (4.0, False)])
def test_a_new_terminal_inherits_control_that_is_free_within_four_seconds(
    age_s: float,
    inherits: bool,
    tmp_path: Path,
    client: type[Scripted],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Scripted, "refuses", 1)
    clock = [0.0]
    monkeypatch.setattr("tui.terminal.state.feed.time.monotonic", lambda: clock[0])
    free = replace(STATUS, controller="")

    news = Scripted.news

    def late(scripted: Scripted, timeout_s: float) -> Status | None:
        clock[0] = age_s
        return news(scripted, timeout_s)

    monkeypatch.setattr(Scripted, "news", late)
    client.script += [STATUS, free, free, STATUS]
    posted = posts(tmp_path, lost if not inherits else lambda all_: Role(True) in all_)
    assert posted[0] == Role(False, "JL is in control")
    assert client.made[:2] == [("MK", True, False), ("MK", False, False)]
    assert (Role(True) in posted) is inherits


def test_a_recorder_is_started_when_the_one_before_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, slept, started = [0.0], list[float](), list[float]()

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        clock[0] += 5.0

    monkeypatch.setattr("tui.terminal.state.feed.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("tui.terminal.state.feed.time.sleep", sleep)
    monkeypatch.setattr(feed, "is_locked", lambda _: clock[0] < 20.0)
    listener = RecorderFeed(tmp_path, "MK", lambda: started.append(clock[0]))
    listener.restart()
    assert (started, slept) == ([20.0], [0.1] * 4)
    assert listener._is_starting()
    clock[0] = 0.0
    monkeypatch.setattr(feed, "is_locked", lambda _: True)
    with pytest.raises(OrderRefusedError, match="has not ended: see its log"):
        listener.restart()
    assert clock[0] == 25.0, "twenty seconds and a look"
    assert len(started) == 1
