"""Recorder and clients over real sockets, with a recorder that only keeps the orders it gets."""

from __future__ import annotations

import json
import os
import shutil
import stat
import subprocess
import sys
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
import zmq
from pydantic import TypeAdapter, ValidationError

from daq.bench.campaign import Origin
from daq.control.address import Address, control_address, is_running
from daq.control.exchange import (
    MAX_REQUEST_BYTES,
    Client,
    OrderRefusedError,
    Peers,
    RecorderGoneError,
    Server,
)
from daq.control.messages import (
    PROTOCOL,
    REPLY,
    Accept,
    Arm,
    AskBench,
    AskCheck,
    AskHistory,
    AskStatus,
    Hello,
    Lane,
    Live,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Pause,
    Reject,
    Reply,
    Status,
    setup_of,
)
from dbc.words import InputError

from ..a_status import a_status
from ..small_campaign import small_bench

PATIENCE_S = 150.0
NOW = b"%d" % PROTOCOL


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
def address(tmp_path: Path) -> Address:
    return control_address(tmp_path / "today")


@pytest.fixture
def engine() -> Engine:
    return Engine()


@pytest.fixture
def server(engine: Engine, address: Address) -> Iterator[Server]:
    server = Server(engine.submit, address)
    yield server
    server.close()


def until(condition: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def raw(address: Address, *message: bytes, client: bytes = b"c") -> tuple[bytes, bytes, Reply]:
    """Send what need not be a request; return protocol and number of the answer, and the answer."""
    with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
        socket.linger = 0
        socket.identity = client
        socket.connect(address.control)
        socket.send_multipart(message)
        assert socket.poll(int(PATIENCE_S * 1e3))
        protocol, number, answer = socket.recv_multipart()
    reply: Reply = REPLY.validate_json(answer)
    return protocol, number, reply


def hello(address: Address, client: str, name: str, **more: object) -> str:
    order = json.dumps({"name": name, "control": True, **more}).encode()
    return raw(address, NOW, b"1", b"Hello", order, client=client.encode())[2].error


def test_orders_and_answers(server: Server, engine: Engine, address: Address) -> None:
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


def test_one_controller_many_viewers(server: Server, engine: Engine, address: Address) -> None:
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
    until(lambda: not anna.in_control)  # its heart has noticed, and does not fight
    berta.close()  # gives control back
    Client(address, "Clara", control=True).close()
    for client in (anna, *viewers):
        client.close()


def test_control_of_a_killed_terminal_is_free_at_once(
    server: Server, address: Address, tmp_path: Path
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


def test_a_client_survives_a_restart_of_the_recorder(engine: Engine, address: Address) -> None:
    first = Server(engine.submit, address)
    client = Client(address, "Anna", control=True)
    client.ask(Pause())
    first.close()
    assert not is_running(address)
    assert not any(path.exists() for path in address.paths)
    with pytest.raises(RecorderGoneError, match="no answer"):
        client.ask(Pause(), timeout_s=0.05)
    second = Server(engine.submit, address)

    def in_control_again() -> bool:
        try:
            client.ask(Pause(), timeout_s=1.0)
        except (OrderRefusedError, RecorderGoneError):
            return False
        return True

    until(in_control_again)
    client.close()
    second.close()


def test_a_stale_socket_is_replaced(engine: Engine, address: Address) -> None:
    for path in address.paths:
        path.write_bytes(b"")
    with pytest.raises(RecorderGoneError, match="no recorder is running"):
        Client(address, "Anna", control=True)
    server = Server(engine.submit, address)
    Client(address, "Anna", control=True).close()
    server.close()


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ((b"",), "protocol none is not supported"),
        ((b'{"client": "c", "number": 9, "order": {"order": "status"}}',), "protocol none"),
        ((b"99", b"9", b"AskStatus", b"{}"), "protocol 99 is not supported, only"),
        ((NOW, b"9", b"Fly", b"{}"), "no order b'Fly'"),
        ((NOW, b"9", b"Mark", b"\xff\xfe\x00"), "not an order: Mark: "),
        ((NOW, b"9", b"Mark", b"[" * 100_000), "not an order"),
        ((NOW, b"9", b"Mark", b"{}"), "not an order: Mark.text: Field required"),
        ((NOW, b"9", b"Pause", b"{}"), "not in control"),
        ((NOW, b"9", b"Mark", b" " * (MAX_REQUEST_BYTES + 1)), "the limit is"),
    ],
)
def test_what_is_no_request_gets_one_line(
    server: Server, engine: Engine, address: Address, message: tuple[bytes, ...], said: str
) -> None:
    protocol, number, reply = raw(address, *message)
    assert said in reply.error
    assert len(reply.error) <= 200
    assert reply.error.isprintable()
    assert number == (b"9" if len(message) == 4 else b"0")
    assert protocol == NOW
    assert engine.orders == []
    Client(address, "Anna", control=True).close()  # all goes on


def test_a_flood_beyond_the_limit_ends_the_line_alone(server: Server, address: Address) -> None:
    with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
        socket.linger = 0
        socket.connect(address.control)
        socket.send(b"x" * (5 * MAX_REQUEST_BYTES))
        Client(address, "Anna", control=True).close()
        assert socket.poll(0) == 0


def test_ids_that_look_like_processes_are_only_looked_at(server: Server, address: Address) -> None:
    for client in ("0-a", "-1", "99999999999999999999-a", "x"):
        assert hello(address, client, "Anna\x1b[2J", take_over=True) == ""
    assert "is in control" in hello(address, "y", "Berta")
    assert "\x1b" not in hello(address, "y", "Berta")


def give_up(answer: Future[Reply]) -> None:
    answer.cancel()


def test_a_late_answer_is_not_that_to_the_next_question(
    server: Server, engine: Engine, address: Address
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
    engine.answer = give_up
    with pytest.raises(OrderRefusedError, match="is ending"):
        client.ask(Pause())
    client.close()


def test_a_client_that_never_reads_delays_no_other(
    server: Server, engine: Engine, address: Address
) -> None:
    """R15: neither statuses that are not fetched nor replies that are not read are kept."""
    with (
        zmq.Context() as context,
        context.socket(zmq.SUB) as news,
        context.socket(zmq.DEALER) as orders,
    ):
        for socket, end in ((news, address.news), (orders, address.control)):
            socket.linger = 0
            socket.rcvhwm = 1
            socket.connect(end)
        news.subscribe(b"")
        viewer = Client(address, "viewer", control=False)
        while not isinstance(viewer.news(0.05), Status):
            server.publish(a_status(), None)
        engine.answer = lambda future: future.set_result(Reply(bench_text="x" * 100_000))
        for _ in range(200):  # 20 MB of replies that are not read
            orders.send_multipart([NOW, b"1", b"AskBench", b"{}"])
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


def test_a_client_learns_what_the_recorder_was_started_with(
    server: Server, address: Address
) -> None:
    bench = small_bench()
    server.setup = setup_of(replace(bench, origin=Origin.SIMULATED))
    client = Client(address, "Anna", control=False)
    client.close()
    reported = client.setup
    assert reported is not None
    assert (reported.origin, reported.vehicle) == (Origin.SIMULATED, bench.vehicle.name)
    assert reported.bench_crc32 == zlib.crc32(bench.text.encode())
    assert reported.dbc_crc32 == zlib.crc32(bench.dbc_text.encode())
    assert reported.buses == tuple(f"{bus.interface} {bus.channel}" for bus in bench.buses)


def test_the_server_knows_for_how_long_no_client_has_been_there(
    server: Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun_s = time.monotonic()

    def alone_at(later_s: float) -> float:
        with monkeypatch.context() as patch:
            patch.setattr("daq.control.exchange.time.monotonic", lambda: begun_s + later_s)
            return server.alone_s()

    assert alone_at(59.0) == 0.0
    assert alone_at(70.0) == pytest.approx(10.0, abs=2.0)
    client = Client(address, "Anna", control=False)

    def seen() -> bool:
        server.publish(a_status(1), None)
        return alone_at(70.0) > 20.0  # counted from now on, not from the first minute's end

    until(seen)
    client.close()


def test_whether_a_client_is_there_is_known(
    server: Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A recorder that no client watches looks at its frames less often."""
    monkeypatch.setattr("daq.control.exchange.LEASE_S", 0.5)
    assert not server.has_clients()
    viewer = Client(address, "viewer", control=False)
    assert server.has_clients()  # at once, not only with the next status
    server.publish(a_status(1), None)
    until(lambda: viewer.ask(AskStatus()).status == replace(a_status(1), viewers=1))
    viewer.close()

    def is_alone() -> bool:
        server.publish(a_status(2), None)
        return not server.has_clients()

    until(is_alone)


@pytest.mark.parametrize("folder_too", [False, True])
def test_sockets_that_were_deleted_are_bound_again(
    tmp_path: Path, server: Server, address: Address, folder_too: bool
) -> None:
    client = Client(address, "Anna", control=True)
    if folder_too:
        shutil.rmtree(address.paths[0].parent)
    else:
        for path in address.paths:
            path.unlink()
    assert not is_running(address)
    until(lambda: is_running(address))
    second = Client(address, "Bert", control=False)
    server.publish(a_status(7), None)
    assert second.ask(AskStatus()).status is not None
    assert client.ask(AskStatus()).status is not None  # its connection never broke
    assert stat.S_IMODE(address.paths[0].parent.stat().st_mode) == 0o700
    second.close()
    client.close()


# Clients: who is in control, the limits of orders, and a recorder of another version --------------

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

Answer = Callable[[bytes], list[bytes]]


@contextmanager
def recorder(address: Address, answer: Answer) -> Iterator[None]:
    """Answer all requests as stated."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    requests = context.socket(zmq.ROUTER)
    requests.linger = 0
    requests.bind(address.control)
    closing = threading.Event()

    def run() -> None:
        while not closing.is_set():
            if requests.poll(20):
                client, _, number, *_ = requests.recv_multipart()
                requests.send_multipart([client, *answer(number)])

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        closing.set()
        thread.join()
        requests.close()
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
