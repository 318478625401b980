"""When a recorder that does not answer is called lost; what comes with a connection."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path
from queue import Empty, Queue
from typing import NoReturn

import pytest
from filelock import FileLock

from daq.bench.campaign import Origin
from daq.control.client import RecorderGoneError
from daq.control.messages import Reply, Setup
from daq.control.orders import AskStatus, Order
from tui.terminal.state import feed
from tui.terminal.state.feed import BIRTH_S, Lost, News, RecorderFeed, Role

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
    monkeypatch.setattr("tui.terminal.state.feed.time.monotonic", lambda: clock[0])
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
    monkeypatch.setattr("tui.terminal.state.feed.time.monotonic", lambda: clock[0])
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
