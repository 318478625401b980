"""A client before a recorder of another version, and a recorder that cannot listen."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path

import pytest
import zmq

from daq.control.address import Address, control_address, is_running
from daq.control.client import Client, OrderRefusedError, RecorderGoneError
from daq.control.messages import (
    LIVE,
    LIVE_TOPIC,
    PROTOCOL,
    REPLY,
    STATUS_TOPIC,
    Lane,
    Live,
    Reply,
)
from daq.control.orders import Order
from daq.control.server import Server
from daq.errors import InputError

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
