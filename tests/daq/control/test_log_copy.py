"""Statuses that do not grow with the runs, and clients that know all runs nevertheless."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import pytest
import zmq

from daq.control.address import Address, control_address
from daq.control.client import Client
from daq.control.log_copy import LogCopy, LogSource
from daq.control.messages import Live, LogNews, Reply, Status
from daq.control.orders import AskLog, AskStatus, Order
from daq.control.server import Server
from daq.runlog.entries import entry
from daq.runlog.fold import advance
from daq.runlog.runlog import Code, RunLog
from daq.runs import Event

from ..a_status import a_status
from ..long_run_log import long_run_log

RUNS = 2000
PATIENCE_S = 30.0


def status_of(log: RunLog, t_ns: int = 0) -> Status:
    return replace(a_status(t_ns), runs=log.runs, notes=log.notes, overrides=log.overrides)


def rejected(log: RunLog, label: str) -> RunLog:
    return advance(log, entry(Code.REJECT, 5, label=label, by="Ann", reason="slipped"))


def noted(log: RunLog, text: str) -> RunLog:
    return advance(log, entry(Code.NOTE, 5, text=text, label="", by="Ann"))


def changes() -> Iterator[RunLog]:
    """Yield logs, each with one change."""
    log = long_run_log(50)
    yield log
    yield (log := long_run_log(51, log))
    yield (log := advance(log, Event(600, Code.BUMP, 1.0, "added_roll_1")))
    yield (log := rejected(log, "baseline_bounce_3"))
    yield (log := noted(log, "wet floor"))
    yield (log := advance(log, Event(7, Code.MARK, text="check")))
    override = {"subject": "IMU", "reason": "known", "by": "Ann"}
    yield (log := advance(log, entry(Code.OVERRIDE, 8, **override)))
    yield advance(log, Event(9, Code.UNDO, text="Ann"))


def test_a_copy_that_takes_each_change_has_the_log() -> None:
    source, copy = LogSource(100), LogCopy()
    for k, log in enumerate(changes()):
        status, news = source.parted(status_of(log))
        assert (status.runs, status.notes, status.overrides) == ((), (), ())
        if k == 0:
            assert not copy.take(news)  # it begins with the whole log
            assert copy.take(source.whole)
        else:
            assert len(news.runs) + len(news.notes) + len(news.overrides) == 1
            assert copy.take(news)
        assert copy.filled(status) == status_of(log)
        assert source.parted(status_of(log))[1] == news  # nothing has changed
        assert copy.take(news)


@pytest.mark.parametrize("missed", range(1, 8))
def test_a_copy_that_has_missed_a_change_asks(missed: int) -> None:
    source, copy = LogSource(100), LogCopy()
    for k, log in enumerate(changes()):
        status, news = source.parted(status_of(log))
        if k == missed:
            continue
        taken = copy.take(news)
        assert taken is (k not in (0, missed + 1))
        if not taken:
            copy.take(source.whole)
        assert copy.filled(status) == status_of(log)


def test_a_new_recording_and_a_great_change_are_asked_for() -> None:
    source, copy = LogSource(100), LogCopy()
    logs = [long_run_log(3), long_run_log(2), long_run_log(40), RunLog(), long_run_log(1)]
    logs.append(noted(long_run_log(1), "x" * 3000))
    for log in logs:
        status, news = source.parted(status_of(log))
        if not copy.take(news):
            copy.take(source.whole)
        assert copy.filled(status) == status_of(log)
    assert source.whole.serial == 100 + 2 + 2 + 2 + 2 + 1 + 2


def test_a_late_status_takes_nothing_back_and_another_recorder_is_noticed() -> None:
    source, copy = LogSource(10_000), LogCopy()
    copy.take(source.whole)
    early = source.parted(status_of(long_run_log(1)))[1]
    copy.take(early)
    copy.take(source.parted(status_of(long_run_log(2)))[1])
    assert copy.take(early)
    assert len(copy.filled(a_status()).runs) == 2
    assert not copy.take(LogNews(9_000))
    assert copy.take(LogNews(9_003))


class Published:
    """A server with a status, and what it sends."""

    def __init__(self, address: Address) -> None:
        self.server = Server(self._submit, address)
        self.address = address
        self._context = zmq.Context()
        self._news = self._context.socket(zmq.SUB)
        self._news.linger = 0
        self._news.subscribe(b"status")
        self._news.connect(address.news)
        self.log = long_run_log(RUNS)

    def _submit(self, order: Order, by: str) -> Future[Reply]:
        future: Future[Reply] = Future()
        future.set_result(Reply(0, status=status_of(self.log)))
        return future

    def publish(self) -> int:
        """Publish the status until it is received; return its size, bytes."""
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            self.server.publish(status_of(self.log), None)
            if self._news.poll(100):
                return len(self._news.recv_multipart()[1])
        raise AssertionError("nothing was published")

    def close(self) -> None:
        self._news.close()
        self._context.term()
        self.server.close()

    def reply_bytes(self, order: str) -> int:
        body = {"client": "c", "number": 1, "order": {"order": order}, "protocol": 2}
        with self._context.socket(zmq.DEALER) as socket:
            socket.linger = 0
            socket.connect(self.address.control)
            socket.send(json.dumps(body).encode())
            assert socket.poll(int(PATIENCE_S * 1e3))
            return len(socket.recv())


@pytest.fixture
def published(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Published]:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    one = Published(control_address(tmp_path))
    try:
        yield one
    finally:
        one.close()


def until(client: Client, what: Callable[[Status], bool]) -> Status:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        news: Status | Live | None = client.news(0.2)
        if isinstance(news, Status) and what(news):
            return news
    raise AssertionError("no such status came")


def test_a_status_of_two_thousand_runs_has_less_than_8_kb_and_viewers_see_all(
    published: Published,
) -> None:
    assert published.publish() < 8000
    assert published.reply_bytes("status") < 8000
    assert published.reply_bytes("log") > 1_000_000
    viewer = Client(published.address, "viewer", control=False)
    asked = viewer.ask(AskStatus()).status
    assert asked is not None
    assert asked.runs == published.log.runs
    assert viewer.ask(AskLog()).log is not None

    published.log = long_run_log(RUNS + 1, published.log)
    for _ in range(3):
        assert published.publish() < 8000
    seen = until(viewer, lambda s: len(s.runs) == RUNS + 1)
    assert seen.runs == published.log.runs
    published.log = rejected(published.log, "baseline_bounce_7")
    published.log = noted(published.log, "wet floor")
    assert published.publish() < 8000
    seen = until(viewer, lambda s: len(s.notes) == 1)
    assert seen.runs == published.log.runs
    assert seen.runs[6].reasons == ("rejected by Ann: slipped",)
    viewer.close()
