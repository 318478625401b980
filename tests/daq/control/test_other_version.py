"""A client before a recorder of another version, and a recorder that cannot listen."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import zmq

from daq.control.address import Address, control_address, is_running
from daq.control.client import Client, OrderRefusedError, RecorderGoneError
from daq.control.lock import is_locked, unreachable_words
from daq.control.log_copy import LogCopy, LogSource
from daq.control.messages import (
    LIVE,
    LIVE_TOPIC,
    PROTOCOL,
    STATUS_TOPIC,
    Lane,
    Live,
    LogNews,
    Reply,
)
from daq.control.orders import Mark, Order, Pause
from daq.control.server import Server
from daq.errors import InputError
from daq.runlog.runlog import LoggedRun, Override, Remark
from daq.runs import BASELINE, Excitation

from ..a_status import a_status

PATIENCE_MS = 60_000
Answer = Callable[[int], bytes]


def said(number: int, **more: object) -> bytes:
    return json.dumps({"number": number, "error": "", "protocol": PROTOCOL, **more}).encode()


@pytest.fixture
def address(tmp_path: Path) -> Address:
    return control_address(tmp_path / "today")


@contextmanager
def recorder(address: Address, *answers: Answer) -> Iterator[zmq.Socket[bytes]]:
    """Answer the first requests as stated, all others well; yield the socket of the news."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    requests, news = context.socket(zmq.ROUTER), context.socket(zmq.XPUB)
    requests.linger = news.linger = 0
    requests.bind(address.control)
    news.bind(address.news)
    closing = threading.Event()

    def run() -> None:
        waiting = list(answers)
        while not closing.is_set():
            if requests.poll(20):
                envelope, message = requests.recv_multipart()
                number = json.loads(message)["number"]
                answer = waiting.pop(0) if waiting else said
                requests.send_multipart([envelope, answer(number)])

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield news
    finally:
        closing.set()
        thread.join()
        requests.close()
        news.close()
        context.term()


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (lambda _: b"{}", "of another version"),
        (lambda _: b"\xff", "of another version"),
        (lambda n: said(n, protocol=PROTOCOL + 1), f"protocol {PROTOCOL + 1}, not {PROTOCOL}"),
        (lambda n: said(n, protocol=PROTOCOL - 1), f"protocol {PROTOCOL - 1}, not {PROTOCOL}"),
    ],
)
def test_a_recorder_of_another_version_is_named_as_one(
    address: Address, answer: Answer, why: str
) -> None:
    with recorder(address, answer), pytest.raises(RecorderGoneError, match=why):
        Client(address, "Anna", control=True)


def test_a_refusal_closes_the_connection(address: Address) -> None:
    with recorder(address, lambda n: said(n, error="Bert is in control")):
        with pytest.raises(OrderRefusedError, match="Bert is in control"):
            Client(address, "Anna", control=True)
        viewer = Client(address, "Anna", control=False)
        assert not viewer.in_control
        viewer.close()


def test_a_late_reply_to_an_earlier_request_is_passed_over(address: Address) -> None:
    with recorder(address, said, lambda n: said(n - 1, error="late")):
        client = Client(address, "Anna", control=False)
        with pytest.raises(RecorderGoneError, match=r"no answer within 0\.2 s"):
            client.ask(Pause(), timeout_s=0.2)
        client.close()


def test_news_that_cannot_be_read_are_passed_over(address: Address) -> None:
    with recorder(address) as news:
        client = Client(address, "Anna", control=False)
        assert news.poll(PATIENCE_MS)
        news.recv()  # its subscription
        live = Live(3, 0.02, (Lane("hub", (0.5,), (1.5,)),))
        news.send_multipart([STATUS_TOPIC, b"{}"])
        news.send_multipart([LIVE_TOPIC, b"not json"])
        news.send_multipart([LIVE_TOPIC, LIVE.dump_json(live)])
        assert client.news(60.0) == live
        assert client.news(0.0) is None
        client.close()
        assert client.news(60.0) is None


def no_answer(order: Order, by: str) -> Future[Reply]:
    return Future()


@pytest.mark.parametrize("which", [0, 1])
def test_a_recorder_that_cannot_listen_says_where_and_leaves_nothing_behind(
    address: Address, which: int
) -> None:
    taken = address.paths[which]
    taken.mkdir()
    with pytest.raises(InputError, match="cannot listen") as caught:
        Server(no_answer, address)
    assert str(address.paths[0]) in str(caught.value)
    assert not is_running(address)
    taken.rmdir()
    Server(no_answer, address).close()


def test_at_most_sixty_four_orders_wait_for_the_recorder(address: Address) -> None:
    server = Server(no_answer, address)
    try:
        with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
            socket.linger = 0
            socket.connect(address.control)

            def send(number: int, order: dict[str, object]) -> None:
                socket.send(json.dumps({"client": "c", "number": number, "order": order}).encode())

            send(1, {"order": "hello", "name": "Anna", "control": True})
            assert socket.poll(PATIENCE_MS)
            assert json.loads(socket.recv())["error"] == ""
            for number in range(100, 100 + 65):
                send(number, {"order": "pause"})
            assert socket.poll(PATIENCE_MS)
            reply = json.loads(socket.recv())
            assert (reply["number"], reply["error"]) == (164, "the recorder is busy: try again")
    finally:
        server.close()


@pytest.mark.parametrize(
    ("error", "text"), [(ValueError("full"), "full"), (KeyError(), "KeyError()")]
)
def test_an_order_that_fails_is_answered_with_its_error(
    address: Address, error: Exception, text: str
) -> None:
    def failing(order: Order, by: str) -> Future[Reply]:
        answer: Future[Reply] = Future()
        answer.set_exception(error)
        return answer

    server = Server(failing, address)
    try:
        client = Client(address, "Anna", control=True)
        with pytest.raises(OrderRefusedError) as caught:
            client.ask(Mark("x"), timeout_s=60.0)
        assert str(caught.value) == text
        client.close()
    finally:
        server.close()


def test_a_socket_whose_folder_cannot_be_made_again_is_reported_once(
    address: Address, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("daq.control.server.LOOK_S", -1.0)
    server = Server(no_answer, address)
    looked = threading.Event()
    asked = threading.Semaphore(0)

    def make_private(directory: Path) -> None:
        asked.release()
        if not looked.is_set():
            raise InputError(str(directory), "belongs to somebody else", "")

    monkeypatch.setattr("daq.control.server.make_private", make_private)
    try:
        for path in address.paths:
            path.unlink()
        for _ in range(3):
            server.publish(a_status(1), None)
            assert asked.acquire(timeout=60.0)
        refused = [r for r in caplog.records if "no client can connect" in r.getMessage()]
        assert len(refused) == 1
        looked.set()
        server.publish(a_status(1), None)
        assert asked.acquire(timeout=60.0)
    finally:
        server.close()
    assert any("has been created again" in record.getMessage() for record in caplog.records)


def test_a_place_that_no_lock_can_be_in_is_not_locked(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "ascii")
    assert not is_locked(tmp_path / "file" / "folder")


def test_a_folder_that_cannot_be_looked_into_is_said_to_be(tmp_path: Path) -> None:
    """As one of another user; here its name is too long."""
    folder = tmp_path / ("x" * 300)
    assert not is_locked(folder)
    assert unreachable_words(folder) == "its recorder cannot be reached: File name too long"
    assert unreachable_words(tmp_path) == ""


RUN = LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 0)


@pytest.mark.parametrize(("behind", "known"), [(-1, False), (0, True), (999, True), (1000, False)])
def test_a_state_up_to_a_thousand_changes_old_is_known_already(behind: int, known: bool) -> None:
    copy = LogCopy()
    assert not copy.take(LogNews(5000))
    assert copy.take(LogNews(5000, (RUN,), whole=True))
    assert copy.take(LogNews(5000 - behind)) is (known or behind == -1)
    assert copy.filled(a_status(1)).runs == (RUN,)
    assert not copy.take(LogNews(5002 + (behind == -1)))


@pytest.mark.parametrize(("runs", "sent"), [(9, 9), (10, 0)])
def test_a_change_of_ten_runs_is_asked_for(runs: int, sent: int) -> None:
    source = LogSource(7)
    status = replace(
        a_status(1), runs=tuple(replace(RUN, label=f"r{k}", repeat=k) for k in range(runs))
    )
    left, news = source.parted(status)
    assert (left.runs, left.notes, left.overrides) == ((), (), ())
    assert (len(news.runs), news.serial) == (sent, 8 if sent else 9)
    assert source.parted(status)[1] == news
    assert (source.whole.serial, source.whole.runs) == (news.serial, status.runs)


@pytest.mark.parametrize(("size", "sent"), [(2_700, 1), (3_000, 0)])
def test_a_long_change_is_asked_for(size: int, sent: int) -> None:
    source = LogSource(7)
    _, news = source.parted(replace(a_status(1), notes=(Remark(1, "x" * size),)))
    assert len(news.notes) == sent


def test_notes_and_overrides_are_sent_once_and_their_loss_is_a_new_log() -> None:
    source = LogSource(1)
    notes = (Remark(1, "a"), Remark(2, "b"))
    overrides = (Override(1, "bus", "known", "Bob"),)
    status = replace(a_status(1), notes=notes[:1], overrides=overrides)
    first = source.parted(status)[1]
    assert (first.serial, first.notes, first.overrides) == (2, notes[:1], overrides)
    second = source.parted(replace(status, notes=notes))[1]
    assert (second.serial, second.notes, second.overrides) == (3, notes[1:], ())
    whole = replace(status, notes=notes)
    for fewer in (replace(whole, notes=notes[1:]), replace(whole, overrides=())):
        source.parted(whole)
        before = source.whole.serial
        news = source.parted(fewer)[1]
        assert (news.serial, news.notes, news.overrides) == (before + 2, (), ())
