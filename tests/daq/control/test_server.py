"""Recorder and clients over real sockets, with a recorder that only keeps the orders it gets."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.campaign import Origin
from daq.control.address import control_address, is_running
from daq.control.exchange import (
    MAX_REQUEST_BYTES,
    Client,
    OrderRefusedError,
    RecorderGoneError,
    Server,
)
from daq.control.messages import (
    PROTOCOL,
    REPLY,
    Arm,
    AskBench,
    AskStatus,
    Hello,
    Lane,
    Live,
    Mark,
    Order,
    Pause,
    Reply,
    Status,
    setup_of,
)
from dbc.words import InputError

from ..a_status import a_status
from ..small_campaign import small_bench

PATIENCE_S = 150.0


class Engine:
    def __init__(self) -> None:
        self.orders: list[tuple[Order, str]] = []
        self.answer: Callable[[Future[Reply]], None] = lambda future: future.set_result(
            Reply(status=a_status(1))
        )

    def submit(self, order: Order, by: str) -> Future[Reply]:
        self.orders.append((order, by))
        future: Future[Reply] = Future()
        self.answer(future)
        return future


@pytest.fixture
def address(tmp_path: Path) -> Path:
    return control_address(tmp_path / "today")


@pytest.fixture
def engine() -> Engine:
    return Engine()


@pytest.fixture
def server(engine: Engine, address: Path) -> Iterator[Server]:
    server = Server(engine.submit, address)
    yield server
    server.close()


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def lines_of(address: Path, *requests: bytes) -> Iterator[bytes]:
    """Send lines that need not be requests, and yield the lines that are answered."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(address))
        connection.sendall(b"".join(request + b"\n" for request in requests))
        with connection.makefile("rb") as lines:
            yield from lines


def test_orders_and_answers(server: Server, engine: Engine, address: Path) -> None:
    client = Client(address, "Anna", control=True)
    assert client.in_control
    reply = client.ask(Mark("boards moved"))
    assert reply.status == a_status(1)
    assert engine.orders == [(Mark("boards moved"), "Anna")]

    engine.answer = lambda future: future.set_result(Reply("no run is open"))
    with pytest.raises(OrderRefusedError, match="no run is open"):
        client.ask(Pause())
    engine.answer = lambda future: future.set_exception(ValueError("first\nsecond"))
    with pytest.raises(OrderRefusedError, match=r"first\\nsecond"):
        client.ask(Pause())
    client.close()
    client.close()
    with pytest.raises(RecorderGoneError):
        client.ask(Pause())


def test_one_controller_many_viewers(server: Server, engine: Engine, address: Path) -> None:
    anna = Client(address, "Anna", control=True)
    viewers = [Client(address, f"viewer {i}", control=False) for i in range(2)]
    live = Live(7, 0.01, (Lane("hub", (0.5, None), (1.5, None)),))
    server.publish(a_status(2), None)
    until(lambda: viewers[0].ask(AskStatus()).status is not None)
    messages: list[Status | Live | None] = []
    for viewer in viewers:
        received: list[Status | Live | None] = []
        while live not in received:  # a subscription takes a moment
            server.publish(a_status(3), live)
            received.append(viewer.news(0.1))
        assert a_status(3) not in received  # it carries who is there
        messages += received
    statuses = [status for status in messages if isinstance(status, Status)]
    assert {(s.controller, s.viewers, s.t_ns) for s in statuses} <= {
        ("Anna", 2, 2),
        ("Anna", 2, 3),
    }
    assert statuses

    viewers.append(Client(address, "viewer 2", control=False))
    assert viewers[2].first_status == replace(a_status(3), controller="Anna", viewers=2)
    viewers[0].ask(AskBench())  # a question is anybody's
    with pytest.raises(OrderRefusedError, match="Anna is in control"):
        viewers[0].ask(Arm())
    with pytest.raises(OrderRefusedError, match="Anna is in control"):
        Client(address, "Berta", control=True)
    assert [order for order, _ in engine.orders] == [AskBench()]

    berta = Client(address, "Berta", control=True, take_over=True)
    berta.ask(Arm())
    assert engine.orders[-1] == (Arm(), "Berta")
    with pytest.raises(OrderRefusedError, match="Berta is in control"):
        anna.ask(Pause())
    until(lambda: not anna.in_control)  # it learns of it, and does not fight
    berta.ask(Hello("Bertha\x1b[2J", control=True))
    with pytest.raises(OrderRefusedError, match=r"Bertha\\x1b\[2J is in control"):
        anna.ask(Pause())
    berta.close()  # gives control back
    Client(address, "Clara", control=True).close()
    for client in (anna, *viewers):
        client.close()


def test_control_of_a_killed_terminal_is_free_at_once(
    server: Server, address: Path, tmp_path: Path
) -> None:
    code = (
        "import sys, time; from pathlib import Path\n"
        "from daq.control.address import control_address\n"
        "from daq.control.exchange import Client\n"
        "client = Client(control_address(Path(sys.argv[1])), 'Anna', True)\n"
        "print('in control', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "today")], stdout=subprocess.PIPE, text=True
    ) as terminal:
        assert terminal.stdout
        assert terminal.stdout.readline() == "in control\n"
        with pytest.raises(OrderRefusedError, match="Anna is in control"):
            Client(address, "Berta", control=True)
        terminal.kill()
        terminal.wait()
        tries = 0
        while True:
            tries += 1
            try:
                Client(address, "Berta", control=True).close()
                break
            except OrderRefusedError:
                assert tries < 200
                time.sleep(0.01)


def test_the_end_of_a_recorder_ends_its_connections(engine: Engine, address: Path) -> None:
    server = Server(engine.submit, address)
    client = Client(address, "Anna", control=True)
    engine.answer = lambda future: threading.Timer(0.1, future.set_result, [Reply()]).start()
    stop = threading.Timer(0.05, server.close)
    stop.start()
    client.ask(Pause())  # the last answers are sent
    stop.join()
    with pytest.raises(RecorderGoneError, match="has ended"):
        client.ask(Pause())
    with pytest.raises(RecorderGoneError, match="has ended"):
        client.news(0.0)
    client.close()
    assert not address.exists()


def test_a_stale_socket_is_replaced(engine: Engine, address: Path) -> None:
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(address))
    with pytest.raises(RecorderGoneError, match="no recorder is running"):
        Client(address, "Anna", control=True)
    server = Server(engine.submit, address)
    Client(address, "Anna", control=True).close()
    server.close()


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        (b"", "protocol none is not supported"),
        (b"GET / HTTP/1.1", "protocol GET is not supported"),
        (b"99 9 AskStatus {}", "protocol 99 is not supported, only"),
        (b"%d 9 Fly {}" % PROTOCOL, "no order b'Fly'"),
        (b"%d 9 Mark \xff\xfe\x00" % PROTOCOL, "not an order: Mark: "),
        (b"%d 9 Mark %s" % (PROTOCOL, b"[" * 100_000), "not an order"),
        (b"%d 9 Mark {}" % PROTOCOL, "not an order: Mark.text: Field required"),
        (b"%d 9 Pause {}" % PROTOCOL, "not in control"),
    ],
)
def test_what_is_no_request_gets_one_line(
    server: Server, engine: Engine, address: Path, line: bytes, answer: str
) -> None:
    first = next(lines_of(address, line))
    kind, number, body = first.split(b" ", 2)
    reply: Reply = REPLY.validate_json(body)
    assert answer in reply.error
    assert len(reply.error) <= 400
    assert reply.error.isprintable()
    assert kind == b"reply"
    assert int(number) == (9 if b" 9 " in line else 0)
    assert engine.orders == []
    Client(address, "Anna", control=True).close()  # all goes on


def test_a_line_without_an_end_ends_its_connection_alone(server: Server, address: Path) -> None:
    with socket.socket(socket.AF_UNIX) as flood:
        flood.connect(str(address))
        with pytest.raises(ConnectionError):
            flood.sendall(b"x" * 5 * MAX_REQUEST_BYTES)
    Client(address, "Anna", control=True).close()


def test_a_late_answer_is_not_that_to_the_next_question(
    server: Server, engine: Engine, address: Path
) -> None:
    asked: list[Future[Reply]] = []
    engine.answer = asked.append
    client = Client(address, "Anna", control=True)
    with pytest.raises(RecorderGoneError, match="no answer within"):
        client.ask(Pause(), timeout_s=0.01)
    until(lambda: bool(asked))
    asked[-1].set_result(Reply())
    engine.answer = lambda future: future.set_result(Reply(bench_text="x = 1"))
    assert client.ask(AskBench()).bench_text == "x = 1"
    client.close()


def test_a_client_that_never_reads_delays_no_other(
    server: Server, engine: Engine, address: Path
) -> None:
    """R15: neither statuses that are not fetched nor replies that are not read are kept."""
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.connect(str(address))
        deaf.sendall(b'%d 1 Hello {"name": "deaf"}\n' % PROTOCOL)
        viewer = Client(address, "viewer", control=False)
        engine.answer = lambda future: future.set_result(Reply(bench_text="x" * 100_000))
        deaf.sendall(b"%d 1 AskBench {}\n" % PROTOCOL * 200)  # 20 MB of replies that are not read
        longest_s = 0.0
        live = Live(0, 0.01, (Lane("hub", (0.5,) * 1000, (1.5,) * 1000),))
        for i in range(3_000):
            begun_s = time.perf_counter()
            server.publish(a_status(i), live)
            longest_s = max(longest_s, time.perf_counter() - begun_s)
        # A blocked send would take for ever; what the scheduler does on a busy machine does not.
        assert longest_s < 5.0

        def has_the_last() -> bool:
            server.publish(a_status(77_777), None)
            message = viewer.news(0.1)
            return isinstance(message, Status) and message.t_ns == 77_777

        until(has_the_last)  # the viewer did not listen either, and does now
        assert viewer.ask(AskStatus()).status is not None
        viewer.close()


def test_a_client_learns_what_the_recorder_was_started_with(server: Server, address: Path) -> None:
    bench = small_bench()
    server.setup = setup_of(replace(bench, origin=Origin.SIMULATED))
    client = Client(address, "Anna", control=False)
    client.close()
    reported = client.setup
    assert reported is not None
    assert reported.origin is Origin.SIMULATED
    assert reported.bench_crc32 == zlib.crc32((bench.text + bench.dbc_text).encode())
    assert reported.buses == tuple(f"{bus.interface} {bus.channel}" for bus in bench.buses)


def test_the_server_knows_for_how_long_no_client_has_been_there(
    server: Server, address: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun_s = time.monotonic()

    def alone_at(later_s: float) -> float:
        """Return it at a time after the first minute or within it."""
        with monkeypatch.context() as patch:
            patch.setattr("daq.control.exchange.time.monotonic", lambda: begun_s + later_s)
            return server.alone_s()

    assert alone_at(59.0) == 0.0
    assert alone_at(70.0) == pytest.approx(10.0, abs=2.0)
    client = Client(address, "Anna", control=False)
    assert alone_at(70.0) == 0.0
    client.close()
    until(lambda: alone_at(70.0) > 0.0)
    assert alone_at(70.0) > 60.0  # counted from now on, not from the first minute's end


def test_whether_a_client_is_there_is_known(server: Server, address: Path) -> None:
    """A recorder that no client watches looks at its frames less often."""
    assert not server.has_clients()
    viewer = Client(address, "viewer", control=False)
    assert server.has_clients()  # at once, not only with the next status
    server.publish(a_status(1), None)
    until(lambda: viewer.ask(AskStatus()).status == replace(a_status(1), viewers=1))
    viewer.close()
    until(lambda: not server.has_clients())


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"status", "no answer"),
        (b"reply", "of another version"),
        (b"reply 1 \xff", "of another version"),
        (b'reply 1 {"setup": 1}', "of another version"),
        (b"reply 6 1 {}", "of another version"),
    ],
)
def test_a_recorder_of_another_version_is_named_as_one(
    address: Path, monkeypatch: pytest.MonkeyPatch, answer: bytes, why: str
) -> None:
    monkeypatch.setattr(Client.ask, "__defaults__", (0.5,))
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(address))
        listener.listen()
        with ThreadPoolExecutor(1) as recorder:
            accepted = recorder.submit(lambda: listener.accept()[0])
            accepted.add_done_callback(lambda _: accepted.result().sendall(answer + b"\n"))
            with pytest.raises(RecorderGoneError, match=why):
                Client(address, "Anna", control=True)
            accepted.result().close()


def no_answer(order: Order, by: str) -> Future[Reply]:
    return Future()


def test_a_recorder_that_cannot_listen_says_where(address: Path) -> None:
    address.mkdir()
    with pytest.raises(InputError, match="cannot listen") as caught:
        Server(no_answer, address)
    assert str(address) in str(caught.value)
    assert not is_running(address)
    address.rmdir()
    Server(no_answer, address).close()
