"""Clients: who is in control, the limits of orders, and a recorder of another version."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq
from pydantic import TypeAdapter, ValidationError

from daq.control.address import Address, control_address, is_running
from daq.control.exchange import Client, OrderRefusedError, Peers, RecorderGoneError, Server
from daq.control.messages import (
    LIVE,
    LIVE_TOPIC,
    PROTOCOL,
    REPLY,
    STATUS_TOPIC,
    Accept,
    AskCheck,
    AskHistory,
    Hello,
    Lane,
    Live,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Reject,
    Reply,
)
from daq.errors import InputError

ALIVE = f"{os.getpid()}-a"


def ended_process() -> str:
    """Return the id of a client whose process has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return f"{process.pid}-b"


@pytest.mark.parametrize(("silent_s", "name"), [(5.0, "Ann"), (5.1, "")])
def test_a_controller_is_gone_after_five_silent_seconds(silent_s: float, name: str) -> None:
    peers = Peers()
    peers.seen(ALIVE, 100.0)
    assert peers.hello(ALIVE, Hello("Ann", True), 100.0) == ""
    assert peers.controller(100.0 + silent_s) == name
    assert peers.in_control(ALIVE)


@pytest.mark.parametrize(("silent_s", "name"), [(1.0, "Ann"), (1.1, "")])
def test_a_dead_controller_is_gone_after_one_second(silent_s: float, name: str) -> None:
    peers, client = Peers(), ended_process()
    peers.seen(client, 100.0)
    assert peers.hello(client, Hello("Ann", True), 100.0) == ""
    assert peers.controller(100.0 + silent_s) == name


def test_viewers_are_those_heard_of_within_five_seconds() -> None:
    peers = Peers()
    for client, t_s in ((ALIVE, 100.0), ("x-1", 100.0), ("x-2", 102.0)):
        peers.seen(client, t_s)
        peers.hello(client, Hello(client, client == ALIVE), t_s)
    assert peers.viewers(105.0) == 2
    assert peers.viewers(105.1) == 1
    peers.seen("x-2", 105.1)
    assert peers.name("x-1") == "x-1"  # forgotten
    assert peers.viewers(107.1) == 1


def test_control_goes_to_another_only_if_it_is_free_released_or_taken_over() -> None:
    peers = Peers()
    peers.seen(ALIVE, 100.0)
    peers.hello(ALIVE, Hello("Ann", True), 100.0)
    assert "Ann is in control" in peers.hello("x-1", Hello("Ben", True), 101.0)
    assert peers.hello("x-1", Hello("Ben", True, take_over=True), 101.0) == ""
    assert peers.in_control("x-1")
    assert not peers.in_control(ALIVE)
    peers.hello("x-1", Hello("Ben"), 102.0)
    assert peers.controller(102.0) == ""
    assert peers.hello(ALIVE, Hello("Ann", True), 102.0) == ""


LIMITS: tuple[tuple[type, str, object, object], ...] = (
    (AskHistory, "seconds", 60, 60.1),
    (AskHistory, "seconds", 1e-3, 0),
    (AskCheck, "seconds", 10, 10.1),
    (AskCheck, "seconds", 1e-3, 0),
    (Accept, "reason", "x" * 500, "x" * 501),
    (Reject, "reason", "x" * 500, "x" * 501),
    (Mark, "text", "x" * 200, "x" * 201),
    (Note, "text", "x" * 2000, "x" * 2001),
    (Note, "text", "x", ""),
    (OverrideWarning, "subject", "x" * 200, "x" * 201),
    (OverrideWarning, "reason", "x" * 500, "x" * 501),
    (OverrideWarning, "reason", "x", ""),
)
OTHERS: dict[type, dict[str, object]] = {
    Accept: {"label": "baseline_bounce_1"},
    OverrideWarning: {"subject": "az", "reason": "known"},
}


@pytest.mark.parametrize(("order", "field", "allowed", "refused"), LIMITS)
def test_an_order_holds_no_more_than_it_may(
    order: type, field: str, allowed: object, refused: object
) -> None:
    adapter: TypeAdapter[object] = TypeAdapter(order)
    whole = OTHERS.get(order, {})
    assert adapter.validate_python(whole | {field: allowed})
    with pytest.raises(ValidationError, match=field):
        adapter.validate_python(whole | {field: refused})


def test_a_client_that_asks_once_is_no_viewer() -> None:
    """`bumpbench status`, repeated by a script, must not keep a demonstration alive."""
    peers = Peers()
    for client, attends in (("x-1", False), ("x-2", True)):
        peers.seen(client, 100.0)
        peers.hello(client, Hello(client, attends=attends), 100.0)
    assert peers.viewers(100.0) == 1


# A client before a recorder of another version ---------------------------------------------------

PATIENCE_MS = 60_000
NOW = b"%d" % PROTOCOL
Answer = Callable[[bytes], list[bytes]]


def said(number: bytes, error: str = "") -> list[bytes]:
    return [NOW, number, REPLY.dump_json(Reply(error))]


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
                client, _, number, *_ = requests.recv_multipart()
                answer = waiting.pop(0) if waiting else said
                requests.send_multipart([client, *answer(number)])

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


OLD = b'{"number": 0, "error": "not a request", "protocol": 3}'


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (lambda _: [OLD], "of another version"),  # one before the present form of requests
        (lambda n: [NOW, n, b"\xff"], "of another version"),
        (lambda n: [NOW, n, b'{"setup": 1}'], "of another version"),
        (lambda n: [b"99", n, b"{}"], f"protocol 99, not {PROTOCOL}"),
    ],
)
def test_a_recorder_of_another_version_is_named_as_one(
    address: Address, answer: Answer, why: str
) -> None:
    with recorder(address, answer), pytest.raises(RecorderGoneError, match=why):
        Client(address, "Anna", control=True)


def test_a_refusal_closes_the_connection(address: Address) -> None:
    with recorder(address, lambda n: said(n, "Bert is in control")):
        with pytest.raises(OrderRefusedError, match="Bert is in control"):
            Client(address, "Anna", control=True)
        viewer = Client(address, "Anna", control=False)
        assert not viewer.in_control
        viewer.close()


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
