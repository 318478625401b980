"""Carries messages between a recorder and its clients: one controller, any number of viewers.

A client is present as long as its connection lasts; the kernel ends that of a killed process.  A
line of a client is ``PROTOCOL NUMBER ORDER JSON``; the recorder sends ``reply NUMBER JSON``,
``status JSON``, ``live JSON``, and ``watch`` to a client that another one has taken control from.
"""

from __future__ import annotations

import asyncio
import json
import logging
import queue
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import get_args

from pydantic import TypeAdapter, ValidationError

from dbc.words import BumpbenchError, InputError, printable

from .messages import (
    LIVE,
    PROTOCOL,
    REPLY,
    STATUS,
    AskStatus,
    Hello,
    Live,
    Order,
    Question,
    Reply,
    Setup,
    Status,
)

MAX_REQUEST_BYTES = 4_000_000
"""Largest request, bytes: a bench.toml of 1 MB, escaped."""
MAX_UNREAD_BYTES = 4_000_000
"""Number of bytes that wait for a client, above which it gets no news: some seconds of them."""
FIRST_S = 60.0
"""Time that the first client may take to connect, s: a terminal starts with its recorder."""

_ORDERS = {order.__name__: order for order in get_args(Order)}
_adapter = cache(TypeAdapter)  # builds a validator when it is needed first
_log = logging.getLogger("recorder")


class _Peer:
    """A connection of a client to the server."""

    def __init__(self, writer: asyncio.StreamWriter) -> None:
        self.writer = writer
        self.name = ""  # until it sends a hello
        self.is_answered = True


class Server:
    """Answers requests and publishes until it is closed, in a separate thread.

    No client can delay the recorder: one that does not read gets no news and no further answers.

    `submit`: function of the recorder that takes an order and the name of its sender, and returns a
    future without blocking.  `address`: path of the socket; a stale one is replaced.  `setup`:
    settings with which the recorder was started.  Raises InputError if the server cannot listen.
    """

    def __init__(
        self,
        submit: Callable[[Order, str], Future[Reply]],
        address: Path,
        setup: Setup | None = None,
    ) -> None:
        self._submit, self._address, self.setup = submit, address, setup
        self._alone_since_s = time.monotonic() + FIRST_S
        self._peers: list[_Peer] = []
        self._controller: _Peer | None = None
        self._status: Status | None = None
        # Statuses that wait for this thread; further ones replace the oldest.
        self._news: deque[tuple[Status, Live | None]] = deque(maxlen=16)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="control", daemon=True)
        self._thread.start()
        listening = asyncio.start_unix_server(self._serve, address, limit=MAX_REQUEST_BYTES)
        try:
            self._server = asyncio.run_coroutine_threadsafe(listening, self._loop).result()
        except OSError as error:
            self._end_thread()
            why = f"cannot listen: {error.strerror or error}"
            raise InputError(str(address), why, "see who owns that directory") from error

    def alone_s(self) -> float:
        """Return the time without any client, s; 0 in the first `FIRST_S` after the start."""
        if any(peer.name for peer in self._peers):
            return 0.0
        return max(time.monotonic() - self._alone_since_s, 0.0)

    def has_clients(self) -> bool:
        """Return whether any client is connected; from any thread, never blocks."""
        return bool(self._peers)

    def publish(self, status: Status, live: Live | None) -> None:
        """Publish a status, and samples if there are new ones: never blocks, never raises."""
        self._news.append((status, live))
        with suppress(RuntimeError):  # closed
            self._loop.call_soon_threadsafe(self._send_news)

    def close(self) -> None:
        """Send the answers that are ready, stop listening and remove the socket."""
        asyncio.run_coroutine_threadsafe(self._disconnect(), self._loop).result()
        self._end_thread()

    def _end_thread(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    # The server's thread -----------------------------------------------------------------------

    async def _disconnect(self) -> None:
        """Remove the socket, send the last answers, and end the connections of all clients.

        A client is disconnected once its request is answered, or after 0.3 s.
        """
        self._address.unlink(missing_ok=True)
        # A server that is closed while it accepts a connection leaves its socket open.
        await asyncio.sleep(0.01)
        deadline_s = time.monotonic() + 0.3
        while tasks := asyncio.all_tasks() - {asyncio.current_task()}:
            is_overdue = time.monotonic() > deadline_s
            for peer in self._peers:
                if is_overdue:
                    peer.writer.transport.abort()
                elif peer.is_answered:
                    peer.writer.close()  # sends what is written first
            for task in tasks if is_overdue else ():
                task.cancel()
            await asyncio.wait(tasks, timeout=0.02)
        self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer the requests of one client, one after the other, until it is gone."""
        peer = _Peer(writer)
        self._peers.append(peer)
        try:
            while line := await reader.readline():
                peer.is_answered = False
                number, reply = await self._answer(peer, line)
                writer.write(b"reply %s %s\n" % (number, REPLY.dump_json(reply)))
                peer.is_answered = True
                await writer.drain()
        except (ValueError, ConnectionError):  # a line that is too long, or the client is gone
            pass
        finally:
            self._peers.remove(peer)
            if self._controller is peer:
                self._controller = None
            if peer.name:
                self._alone_since_s = time.monotonic()
            writer.close()

    async def _answer(self, peer: _Peer, line: bytes) -> tuple[bytes, Reply]:
        """Return the number of a request, and its answer: of this server, or of the recorder."""
        words = (*line.rstrip(b"\n").split(b" ", 3), b"", b"", b"", b"")  # missing ones are empty
        protocol, number, name, body = words[:4]
        number = number if number.isdigit() else b"0"
        try:
            order = _order(protocol, name, body)
            if isinstance(order, Hello):
                return number, Reply(self._hello(peer, order), self._status, setup=self.setup)
            if isinstance(order, AskStatus) and self._status is not None:
                return number, Reply(status=self._status)
            if not isinstance(order, Question) and peer is not self._controller:
                reason = "you are not in control"
                if self._controller is not None:
                    reason = f"{self._controller.name} is in control"
                return number, Reply(f"{reason}: you can only watch")
            return number, await asyncio.wrap_future(self._submit(order, peer.name))
        except Exception as error:  # any exception is reported to the client, in one line
            return number, Reply(printable(str(error) or repr(error), 400))

    def _hello(self, peer: _Peer, hello: Hello) -> str:
        """Admit a client as controller or viewer; return why it is refused, or an empty text."""
        controller = self._controller
        if hello.control and controller is not None and controller is not peer:
            if not hello.take_over:
                return f"{controller.name} is in control (take over, or only watch)"
            controller.writer.write(b"watch\n")
        peer.name = printable(hello.name, 60) or "a client"
        if hello.control:
            self._controller = peer
        elif controller is peer:
            self._controller = None
        return ""

    def _send_news(self) -> None:
        """Send the statuses that wait to all clients, except those that do not read."""
        while self._news:
            status, live = self._news.popleft()
            clients = [peer for peer in self._peers if peer.name]
            viewers = sum(peer is not self._controller for peer in clients)
            name = self._controller.name if self._controller else ""
            self._status = replace(status, controller=name, viewers=viewers)
            if not clients:
                continue
            news = b"status %s\n" % STATUS.dump_json(self._status)
            if live is not None:
                news += b"live %s\n" % LIVE.dump_json(live)
            for peer in clients:
                transport = peer.writer.transport
                unread_bytes = transport.get_write_buffer_size()
                if unread_bytes < MAX_UNREAD_BYTES and not transport.is_closing():
                    peer.writer.write(news)


def _order(protocol: bytes, name: bytes, body: bytes) -> Order:
    """Return the order in a request.

    Raises ValueError with one line for a person if there is none.
    """
    if protocol != b"%d" % PROTOCOL:
        spoken = protocol.decode("ascii", "replace")[:20] or "none"
        text = f"protocol {spoken} is not supported, only {PROTOCOL}"
        raise ValueError(f"{text}: use one version of Bumpbench")
    order_type = _ORDERS.get(order_name := name.decode("utf-8", "replace"))
    if order_type is None:
        raise ValueError(f"there is no order {order_name[:60]!r}")
    try:
        order: Order = _adapter(order_type).validate_json(body)
    except ValidationError as error:
        mistake = error.errors(include_url=False)[0]
        key = ".".join(map(str, (order_type.__name__, *mistake["loc"])))
        raise ValueError(f"not an order: {key}: {mistake['msg']}") from error
    return order


# The client ---------------------------------------------------------------------------------------


class RecorderGoneError(BumpbenchError):
    """No recorder answers."""


class OrderRefusedError(Exception):
    """The recorder refuses an order, or does not answer; the text is one line for a person."""


class Client:
    """A connection to one recorder.

    `address`: `daq.control.address.control_address` of the recorder's folder.  `name`, `control`,
    `take_over`: as of `Hello`.  Raises RecorderGoneError if no recorder answers, and
    OrderRefusedError if another client is in control.
    """

    def __init__(self, address: Path, name: str, control: bool, take_over: bool = False) -> None:
        self._address = address
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.connect(str(address))
        except OSError as error:
            self._socket.close()
            raise self._gone("no recorder is running there") from error
        self.in_control = False
        self._number = 0  # of the last request
        self._lock = threading.Lock()
        self._replies: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()  # None at the end
        # Five seconds of status and live samples that are not fetched; further ones are dropped.
        self._news: queue.Queue[tuple[bytes, bytes]] = queue.Queue(100)
        self._ended = threading.Event()
        self._reader = threading.Thread(target=self._read, name="client", daemon=True)
        self._reader.start()
        try:
            reply = self.ask(Hello(name, control, take_over))
        except (RecorderGoneError, OrderRefusedError):
            self.close()
            raise
        self.first_status, self.setup = reply.status, reply.setup
        """Status at the time of the connection, None if there was none yet; and settings with which
        the recorder was started."""

    def ask(self, order: Order, timeout_s: float = 2.0) -> Reply:
        """Send an order and return the recorder's answer; may be called by any thread.

        A `Hello` changes this client's name and whether it wants control.

        Raises RecorderGoneError if no answer comes in time; the order may nevertheless have been
        carried out.  Raises OrderRefusedError with the recorder's reason.
        """
        with self._lock:
            self._number += 1
            deadline_s = time.monotonic() + timeout_s
            body = json.dumps(asdict(order)).encode()
            request = (PROTOCOL, self._number, type(order).__name__.encode(), body)
            with suppress(OSError):  # the reader finds the end of the connection
                self._socket.sendall(b"%d %d %s %s\n" % request)
            while True:
                try:
                    answer = self._replies.get(timeout=max(deadline_s - time.monotonic(), 0.0))
                except queue.Empty:
                    raise self._gone(f"no answer within {timeout_s:g} s") from None
                if answer is None:
                    self._replies.put(None)  # for the next caller
                    raise self._gone("the connection has ended")
                try:
                    number, reply_json = answer.split(b" ", 1)
                    reply: Reply = REPLY.validate_json(reply_json)
                    is_expected = int(number) in (0, self._number)  # else to an earlier request
                except ValueError as error:
                    raise self._gone("the recorder is of another version") from error
                if is_expected:
                    break
        if reply.error:
            raise OrderRefusedError(reply.error)
        if isinstance(order, Hello):
            self.in_control = order.control
        return reply

    def news(self, timeout_s: float) -> Status | Live | None:
        """Return the next published message, None if there is none in time; for one thread.

        Messages that are not fetched are dropped, the newest first.  Raises RecorderGoneError if
        the recorder has ended.
        """
        try:
            kind, body = self._news.get(timeout=timeout_s) if timeout_s else self._news.get_nowait()
        except queue.Empty:
            if self._ended.is_set():
                raise self._gone("the recorder has ended") from None
            return None
        with suppress(ValidationError):  # from another version, which replies report
            news: Status | Live = (LIVE if kind == b"live" else STATUS).validate_json(body)
            return news
        return None

    def close(self) -> None:
        """Release control and disconnect."""
        with suppress(OSError):  # the recorder was faster
            self._socket.shutdown(socket.SHUT_RDWR)
        self._reader.join()
        self._socket.close()

    def _read(self) -> None:
        """Sort the lines of the recorder into answers and news, until the connection ends."""
        with suppress(OSError), self._socket.makefile("rb") as lines:
            for line in lines:
                kind, _, body = line.rstrip(b"\n").partition(b" ")
                if kind == b"reply":
                    self._replies.put(body)
                elif kind == b"watch":
                    self.in_control = False
                else:
                    with suppress(queue.Full):
                        self._news.put_nowait((kind, body))
        self._ended.set()
        self._replies.put(None)

    def _gone(self, reason: str) -> RecorderGoneError:
        """Return the error that no recorder answers at the address, with the reason."""
        return RecorderGoneError(str(self._address), reason, "start `bumpbench record`")
