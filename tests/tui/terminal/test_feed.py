"""The feed of a recorder: when it is lost, what a connection brings, and its orders."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from queue import Empty, Queue
from typing import ClassVar, NoReturn

import pytest
from filelock import FileLock

from daq.bench.campaign import Origin
from daq.control.exchange import OrderRefusedError, RecorderGoneError
from daq.control.messages import Arm, AskStatus, Order, Reply, Setup, Status
from tui.terminal import feed
from tui.terminal.feed import BIRTH_S, Lost, News, RecorderFeed, Role

from ...daq.a_status import a_status


class Connected:
    """A client whose recorder has nothing new."""

    in_control = True
    first_status = a_status(5)
    setup = Setup(Origin.REAL)

    def __init__(self, *_: object, **__: object) -> None:
        self.asked: list[Order] = []

    def ask(self, order: Order, _timeout_s: float = 2.0) -> Reply:
        self.asked.append(order)
        return Reply()

    def news(self, timeout_s: float) -> None:
        threading.Event().wait(timeout_s)

    def close(self) -> None:
        pass


def test_orders_can_be_given_as_soon_as_there_is_news(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(feed, "Client", Connected)
    monkeypatch.setattr(feed, "is_running", lambda _: True)
    monkeypatch.setattr(feed, "SLICE_S", 0.01)
    posted: Queue[tuple[News, Reply]] = Queue()
    listener = RecorderFeed(tmp_path, "MK", lambda: None)
    listener.start(lambda news: posted.put((news, listener._ask(AskStatus()))))
    try:
        first = [posted.get(timeout=10)[0] for _ in range(3)]
    finally:
        listener.stop()
    assert first == [Role(True), Setup(Origin.REAL), a_status(5)]


def test_a_recorder_that_has_only_just_been_started_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    tried = threading.Semaphore(0)

    def refused(*_: object, **__: object) -> NoReturn:
        tried.release()
        raise RecorderGoneError("here", "no recorder is running there", "start one")

    monkeypatch.setattr(feed, "Client", refused)
    monkeypatch.setattr(feed, "RETRY_S", 0.01)
    monkeypatch.setattr("tui.terminal.feed.time.monotonic", lambda: clock[0])
    reported: Queue[News] = Queue()
    listener = RecorderFeed(tmp_path, "MK", lambda: None)
    listener.start(reported.put)
    try:
        for _ in range(3):
            assert tried.acquire(timeout=10)
        with pytest.raises(Empty):
            reported.get_nowait()
        clock[0] = BIRTH_S + 1
        assert reported.get(timeout=10) == Lost("no recorder is running there", "start one")
    finally:
        listener.stop()


def test_a_recorder_that_cannot_be_reached_is_not_said_to_be_absent(tmp_path: Path) -> None:
    listener = RecorderFeed(tmp_path, "MK", lambda: None)
    gone = RecorderGoneError("here", "no recorder is running there", "start one")
    assert listener._lost(gone) == Lost("no recorder is running there", "start one")
    with FileLock(tmp_path / "recorder.lock"):
        said = listener._lost(gone)
    assert said.text == "a recorder (pid unknown) writes there, but does not answer here"
    assert "another HOME" in said.advice


def test_a_recorder_that_starts_slowly_is_not_lost_while_its_process_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, there = [0.0], [True]
    monkeypatch.setattr("tui.terminal.feed.time.monotonic", lambda: clock[0])
    monkeypatch.setattr(feed, "is_locked", lambda _: there[0])
    listener = RecorderFeed(tmp_path, "MK", lambda: None)
    listener._born_s = 0.0
    for now_s, is_there, starting in (
        (4.9, False, True),
        (5.1, False, False),
        (5.1, True, True),
        (29.9, True, True),
        (30.1, True, False),
    ):
        clock[0], there[0] = now_s, is_there
        assert listener._is_starting() is starting, now_s


def test_a_restart_is_reported_as_one(tmp_path: Path) -> None:
    started: list[int] = []
    listener = RecorderFeed(tmp_path, "MK", lambda: started.append(1))
    posted: list[News] = []
    listener._post = posted.append
    listener.restart()
    assert started == [1]
    assert posted == [feed.STARTING]


@pytest.mark.parametrize("runs", [False, True])
def test_a_recorder_is_started_where_none_answers(
    runs: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[int] = []
    monkeypatch.setattr(feed, "is_running", lambda _: runs)
    RecorderFeed(tmp_path, "MK", lambda: started.append(1)).attach()
    assert started == [1] * (not runs)


@pytest.mark.parametrize(
    ("end", "words"),
    [
        ("raise SystemExit(2)", "the recorder ended: no room for the journal"),
        ("import os; os.kill(os.getpid(), 9)", "the recorder was ended by SIGKILL"),
        ("", "no recorder is running there"),
    ],
)
def test_a_recorder_that_does_not_come_up_is_reported_with_the_reason_in_its_log(
    end: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "recorder.log").write_text("bumpbench: error: no room for the journal\n")
    process = subprocess.Popen([sys.executable, "-I", "-S", "-c", end])
    process.wait()
    monkeypatch.setattr(feed, "is_running", lambda _: False)
    listener = RecorderFeed(tmp_path, "MK", lambda: process)
    listener.attach()
    gone = RecorderGoneError("here", "no recorder is running there", "start one")
    lost = listener._lost(gone)
    assert lost.text == words
    if end:
        assert "recorder.log" in lost.advice
        assert not listener._is_starting(), "one that has ended is not waited for"


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
        return Reply()

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
    monkeypatch.setattr("tui.terminal.feed.time.monotonic", lambda: clock[0])
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

    monkeypatch.setattr("tui.terminal.feed.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("tui.terminal.feed.time.sleep", sleep)
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
