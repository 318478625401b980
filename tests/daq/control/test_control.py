"""Recorder and clients over real sockets; the folder of a recorder; what systemd hears of it."""

from __future__ import annotations

import os
import shutil
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.campaign import Origin
from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.control.address import (
    FolderLockedError,
    control_address,
    is_locked,
    is_running,
    lone_recorder,
    unreachable_words,
)
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
from daq.control.monitoring import Heartbeats, Systemd, standstill
from daq.files import write_bytes
from daq.journal.writer import JournalWriter
from dbc.words import InputError

from ..a_status import a_status
from ..crash_frames import HEAD, block
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
    seen = {(status.controller, status.viewers, status.t_ns) for status in statuses}
    assert set() < seen <= {("Anna", 2, 2), ("Anna", 2, 3)}

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


def test_a_killed_process_leaves_neither_control_nor_the_lock_of_a_folder(
    server: Server, address: Path, tmp_path: Path
) -> None:
    code = (
        "import sys, time; from pathlib import Path\n"
        "from daq.control.address import control_address, lone_recorder\n"
        "from daq.control.exchange import Client\n"
        "client = Client(control_address(Path(sys.argv[1])), 'Anna', True)\n"
        "with lone_recorder(Path(sys.argv[2])):\n"
        "    print('in control', flush=True); time.sleep(60)"
    )
    folder = tmp_path / "new" / "today"
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "today"), str(folder)],
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        assert other.stdout
        assert other.stdout.readline() == "in control\n"
        with pytest.raises(OrderRefusedError, match="Anna is in control"):
            Client(address, "Berta", control=True)
        with (
            pytest.raises(FolderLockedError, match="another recorder writes there"),
            lone_recorder(folder),
        ):
            pass
        assert "a recorder writes there" in unreachable_words(folder)
        other.kill()
        other.wait()

    def has_control() -> bool:
        with suppress(OrderRefusedError):
            Client(address, "Berta", control=True).close()
            return True
        return False

    until(has_control)
    with lone_recorder(folder), lone_recorder(tmp_path / "elsewhere"):
        pass


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
        (b"%d 9 Fly {}" % PROTOCOL, "there is no order 'Fly'"),
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


def test_a_line_without_an_end_ends_its_connection_alone(
    server: Server, address: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with socket.socket(socket.AF_UNIX) as flood:
        flood.connect(str(address))
        with pytest.raises(ConnectionError):
            flood.sendall(b"x" * 5 * MAX_REQUEST_BYTES)
    Client(address, "Anna", control=True).close()
    assert not caplog.records  # of an exception in the server


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
    bench = replace(small_bench(), origin=Origin.SIMULATED)
    server.setup = setup_of(bench)
    client = Client(address, "Anna", control=False)
    client.close()
    assert client.setup == server.setup
    assert server.setup.origin is Origin.SIMULATED
    assert server.setup.bench_crc32 == zlib.crc32((bench.text + bench.dbc_text).encode())


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
    assert not server.has_clients()
    client = Client(address, "Anna", control=False)
    assert server.has_clients()  # at once, not only with the next status
    assert alone_at(70.0) == 0.0
    server.publish(a_status(1), None)
    until(lambda: client.ask(AskStatus()).status == replace(a_status(1), viewers=1))
    client.close()
    until(lambda: alone_at(70.0) > 0.0)
    assert alone_at(70.0) > 60.0  # counted from now on, not from the first minute's end
    assert not server.has_clients()


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


def test_a_recorder_that_cannot_listen_says_where(address: Path) -> None:
    address.mkdir()
    with pytest.raises(InputError, match="cannot listen") as caught:
        Server(_unused, address)
    assert str(address) in str(caught.value)
    assert not is_running(address)
    address.rmdir()
    Server(_unused, address).close()


# The folder of a recorder -------------------------------------------------------------------------


def test_files_are_0640_and_folders_0750(tmp_path: Path) -> None:
    folder = tmp_path / "today"
    before = os.umask(0o000)
    assert not is_locked(folder)
    with lone_recorder(folder):
        assert is_locked(folder)
        with JournalWriter(folder / "journal", HEAD, RecorderConfig(reserve_bytes=0.0)) as writer:
            writer.append(block(0, 10), HopLosses())
        write_bytes(folder / "note.json", b"{}")
        script = f"open({str(folder / 'session.h5')!r}, 'w').close()"
        assert subprocess.run([sys.executable, "-S", "-c", script], check=False).returncode == 0
        made = [folder, *folder.rglob("*")]
        modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in made}
    folders = {"today", "journal"}
    assert modes == {name: 0o750 if name in folders else 0o640 for name in modes}
    assert set(modes) >= {"journal_0001.bbj", "note.json", "session.h5"}
    assert os.umask(before) == 0o000
    assert not is_locked(folder)


def test_a_folder_that_cannot_be_made_or_looked_into_is_said_to_be(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", "ascii")
    with pytest.raises(InputError, match="Not a directory"), lone_recorder(tmp_path / "file" / "x"):
        pass
    assert not is_locked(tmp_path / "file" / "folder")
    folder = tmp_path / ("x" * 300)  # as one of another user; here its name is too long
    assert not is_locked(folder)
    assert unreachable_words(folder) == "its recorder cannot be reached: File name too long"
    assert unreachable_words(tmp_path) == ""


# The sockets -------------------------------------------------------------------------------------


def _unused(_: Order, by: str) -> Future[Reply]:
    raise AssertionError(by)


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the directory of a user without settings of systemd."""
    state = tmp_path / "s"
    monkeypatch.delenv("RUNTIME_DIRECTORY")
    monkeypatch.setenv("XDG_STATE_HOME", str(state))
    monkeypatch.setattr("daq.control.address._SERVICE", tmp_path / "service")
    return state / "bumpbench" / "run"


def test_the_directory_is_private_and_ones_own(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = control_address(tmp_path)
    assert address.parent == state
    assert address == control_address(tmp_path / "x" / "..")
    assert address != control_address(tmp_path / "x")
    assert stat.S_IMODE(state.stat().st_mode) == 0o700
    for mode, why in ((0o755, ""), (0o720, "written by others"), (0o702, "written by others")):
        state.chmod(mode)
        if why:
            with pytest.raises(InputError, match=why):
                control_address(tmp_path)
        else:
            assert control_address(tmp_path).parent == state
            assert stat.S_IMODE(state.stat().st_mode) == 0o700
    state.rmdir()
    state.symlink_to(tmp_path)  # somebody else was faster
    with pytest.raises(InputError, match="is a link, not a directory"):
        control_address(tmp_path)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path / ("d" * 100)))
    with pytest.raises(InputError, match="path too long"):
        Server(_unused, control_address(tmp_path))
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(Path(__file__)))
    with pytest.raises(InputError, match="File exists"):
        control_address(tmp_path)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    monkeypatch.setattr(os, "getuid", lambda: tmp_path.stat().st_uid + 1)
    with pytest.raises(InputError, match="belongs to another user"):
        control_address(tmp_path)


def test_the_recorder_of_the_service_is_seen_first(
    tmp_path: Path, state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = Path(tempfile.mkdtemp(prefix="bb"))
    try:
        monkeypatch.setenv("RUNTIME_DIRECTORY", str(short))
        there = control_address(tmp_path)
        server = Server(_unused, there)
        monkeypatch.delenv("RUNTIME_DIRECTORY")
        assert control_address(tmp_path) != there
        monkeypatch.setattr("daq.control.address._SERVICE", short)  # as root sees the unit's
        assert control_address(tmp_path) == there
        # The unit's folder is a link, to one of the user who also owns the directory.
        link = tmp_path / "link"
        link.symlink_to(tmp_path)
        with monkeypatch.context() as another:
            another.setattr(os, "getuid", lambda: 4242)
            assert control_address(link) == there
        short.chmod(0o777)  # it may be anybody's
        assert control_address(tmp_path) != there
        server.close()
    finally:
        shutil.rmtree(short)


def test_no_sockets_no_recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="not UTF-8"):
        control_address(tmp_path / os.fsdecode(b"caf\xe9"))
    monkeypatch.delattr(os, "getuid")
    with pytest.raises(InputError, match="Linux or macOS"):
        control_address(tmp_path)


# What systemd hears of a recorder -----------------------------------------------------------------

WELL = Heartbeats((("can0", 100.0), ("can1", 100.1)), 100.0, 100.0)


@pytest.mark.parametrize(
    ("heartbeats", "now_s", "hanging"),
    [
        (WELL, 102.0, ""),
        (WELL, 102.1, "the reader of can0 has had no cycle for 2.1 s"),
        (Heartbeats((), 100.0, 0.0), 102.0, ""),
        (Heartbeats((), 100.0, 0.0), 102.1, "the writer has had no cycle for 2.1 s"),
        (Heartbeats((), 159.0, 100.0), 160.0, ""),
        (Heartbeats((), 159.0, 100.0), 160.6, "nothing has reached the disk for 61 s"),
        (Heartbeats((), 200.0, 0.0), 200.0, ""),  # nothing was stored yet
    ],
)
def test_a_thread_hangs_after_two_seconds_and_a_disk_after_sixty(
    heartbeats: Heartbeats, now_s: float, hanging: str
) -> None:
    assert standstill(heartbeats, now_s) == hanging


@contextmanager
def notify_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Listen as systemd does."""
    monkeypatch.chdir(tmp_path)  # a Unix socket's path is short
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind("notify")
        listener.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", "notify")
        yield listener


def heard(listener: socket.socket) -> list[str]:
    lines: list[str] = []
    while True:
        try:
            lines += listener.recv(4096).decode().splitlines()
        except BlockingIOError:
            return lines


def test_systemd_hears_only_what_was_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with notify_socket(tmp_path, monkeypatch) as listener:
        systemd = Systemd()
        status = a_status()
        # Not ready: a bus has not been tried; then: nothing is on the disk.
        systemd.notify(replace(WELL, readers=(("can0", 100.0), ("can1", 0.0))), status, 100.0)
        systemd.notify(replace(WELL, durable_s=0.0), status, 100.0)
        lines = heard(listener)
        assert "READY=1" not in lines
        text = "STATUS=2/3 buses, 12,031 frames/s, lag 40 ms, 212 GB free, 4 frames lost"
        assert text in lines
        systemd.notify(WELL, status, 100.0)
        assert heard(listener) == ["WATCHDOG=1", "READY=1", text]
        systemd.notify(WELL, status, 101.0)
        assert heard(listener) == ["WATCHDOG=1", text]

        # A frozen reader, a frozen writer, a dead disk: the watchdog starves.
        for frozen in (
            replace(WELL, readers=(("can0", 97.0), ("can1", 100.0))),
            replace(WELL, writer_s=97.0),
            replace(WELL, durable_s=39.0),
        ):
            assert systemd.notify(frozen, status, 100.0)
            assert not [line for line in heard(listener) if line.startswith("WATCHDOG")]
        assert systemd.notify(WELL, status, 100.0) == ""
        assert "WATCHDOG=1" in heard(listener)

        systemd.stopping()
        assert heard(listener) == ["STOPPING=1"]

        # A socket that is not emptied blocks nothing.
        for i in range(2000):
            systemd.notify(WELL, replace(status, sensors_alive=i), 100.0)
        systemd.close()


def test_without_systemd_nothing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    systemd = Systemd()
    assert systemd.notify(WELL, a_status(), 100.0) == ""
    systemd.close()
