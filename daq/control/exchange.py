"""Carries messages between a recorder and its clients: one controller, any number of viewers.

In the recorder a separate thread passes requests on, returns the answers, and publishes the status.
No client can delay the recorder: messages that a client does not fetch are dropped at the client's
high-water mark.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from dataclasses import asdict, replace
from functools import cache
from typing import get_args
from uuid import uuid4

import zmq
from pydantic import TypeAdapter, ValidationError

from dbc.words import BumpbenchError, InputError, printable

from .address import Address, is_running, make_private
from .messages import (
    LIVE,
    LIVE_TOPIC,
    PROTOCOL,
    REPLY,
    STATUS,
    STATUS_TOPIC,
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
FIRST_S = 60.0
"""Time, s, that the first client may take to connect: a terminal starts together with its
recorder."""
LOOK_S = 1.0
"""Time between two checks that the sockets still exist, s."""

LEASE_S = 5.0
"""Time without a message, s, after which a client counts as gone."""

_ORDERS = {order.__name__: order for order in get_args(Order)}
_adapter = cache(TypeAdapter)  # builds a validator when it is needed first
_log = logging.getLogger("recorder")


class Server:
    """Answers requests and publishes until it is closed.

    `submit`: function of the recorder that takes an order and the name of its sender, and returns a
    future without blocking.  `address`: address to listen at; a stale socket is replaced.  `setup`:
    settings with which the recorder was started; may be changed at any time.  Raises InputError if
    the server cannot listen there.
    """

    def __init__(
        self,
        submit: Callable[[Order, str], Future[Reply]],
        address: Address,
        setup: Setup | None = None,
    ) -> None:
        self._submit, self._address, self.setup = submit, address, setup
        self._alone_since_s = time.monotonic() + FIRST_S
        self._has_clients = False
        self._peers = Peers()
        self._status: Status | None = None
        self._answers: deque[tuple[bytes, bytes, Future[Reply]]] = deque()
        # The recorder appends without waiting; the oldest are dropped if this thread lags.
        # Number of statuses that wait for this thread; further ones replace the oldest.
        self._news: deque[tuple[Status, Live | None]] = deque(maxlen=16)
        self._closing = threading.Event()
        self._wake_in, self._wake_out = os.pipe()
        os.set_blocking(self._wake_in, False)
        os.set_blocking(self._wake_out, False)
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._requests = self._context.socket(zmq.ROUTER)
        self._requests.maxmsgsize = 4 * MAX_REQUEST_BYTES  # a longer line is cut
        self._publisher = self._context.socket(zmq.PUB)
        self._looked_s = time.monotonic()
        self._ends = ((self._requests, address.control), (self._publisher, address.news))
        try:
            for socket, endpoint in self._ends:
                # Time for sending the last messages when the server is closed, ms.
                socket.linger = 300
                # Number of messages kept for a client that does not fetch them: 5 s of statuses, or
                # as many replies.
                socket.sndhwm = 100
                socket.bind(endpoint)
        except zmq.ZMQError as error:
            self._release()
            why = f"cannot listen: {error.strerror}"
            raise InputError(str(address.paths[0]), why, "see who owns that directory") from error
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)
        self._thread.start()

    def alone_s(self) -> float:
        """Return the time without any client, s; the first client may take `FIRST_S`."""
        return max(time.monotonic() - self._alone_since_s, 0.0)

    def has_clients(self) -> bool:
        """Return whether any client was connected recently; from any thread, never blocks."""
        return self._has_clients

    def publish(self, status: Status, live: Live | None) -> None:
        """Publish to all clients; called by the recorder: never blocks, never raises."""
        self._news.append((status, live))
        self._wake()

    def close(self) -> None:
        """Send the answers that are ready, stop listening and remove the sockets."""
        self._closing.set()
        self._wake()
        self._thread.join()
        self._release()
        for path in self._address.paths:
            path.unlink(missing_ok=True)

    def _release(self) -> None:
        self._requests.close()
        self._publisher.close()
        self._context.term()
        os.close(self._wake_in)
        os.close(self._wake_out)

    def _wake(self) -> None:
        with suppress(OSError):  # full: the thread is already awake; closed: it has ended
            os.write(self._wake_out, b"!")

    # The server's thread -----------------------------------------------------------------------

    def _run(self) -> None:
        poller = zmq.Poller()
        poller.register(self._requests, zmq.POLLIN)
        poller.register(self._wake_in, zmq.POLLIN)
        while not self._closing.is_set():
            try:
                # Longest wait for a request or news, ms.
                poller.poll(500)
                self._cycle()
            except Exception as error:  # any exception: the next client must be served
                _log.error("control: %r", error)
        self._cycle()

    def _cycle(self) -> None:
        with suppress(BlockingIOError):
            os.read(self._wake_in, 4096)
        while self._news:
            self._send_news(*self._news.popleft())
        with suppress(zmq.Again):
            client, *message = self._requests.recv_multipart(zmq.NOBLOCK)
            self._take(client, message)
        while self._answers:
            client, number, answer = self._answers.popleft()
            try:
                self._reply(client, number, answer.result())
            except CancelledError:
                self._reply(client, number, Reply("the recorder is ending"))
            except Exception as error:  # any exception is reported to the client
                self._reply(client, number, Reply(printable(str(error) or repr(error), 400)))
        if time.monotonic() - self._looked_s > LOOK_S:
            self._looked_s = time.monotonic()
            self._listen_again()

    def _listen_again(self) -> None:
        """Bind sockets again whose files are gone: a logout deletes a user's run-time directory."""
        gone = [path for path in self._address.paths if not path.is_socket()]
        with suppress(InputError, zmq.ZMQError):  # until it is possible
            for socket, endpoint in self._ends if gone else ():
                make_private(gone[0].parent)
                with suppress(zmq.ZMQError):  # the last attempt to bind it failed
                    socket.unbind(endpoint)
                socket.bind(endpoint)
                _log.warning("control: %s was deleted and has been created again", endpoint)

    def _send_news(self, status: Status, live: Live | None) -> None:
        now_s = time.monotonic()
        controller, viewers = self._peers.controller(now_s), self._peers.viewers(now_s)
        self._has_clients = bool(controller or viewers)
        if self._has_clients:
            self._alone_since_s = now_s
        self._status = replace(status, controller=controller, viewers=viewers)
        with suppress(zmq.Again):
            news = [STATUS_TOPIC, STATUS.dump_json(self._status)]
            self._publisher.send_multipart(news, zmq.NOBLOCK)
            if live is not None:
                self._publisher.send_multipart([LIVE_TOPIC, LIVE.dump_json(live)], zmq.NOBLOCK)

    def _take(self, client: bytes, message: list[bytes]) -> None:
        """Answer a request, or pass it to the recorder."""
        number = message[1] if len(message) == 4 else b"0"
        try:
            order = _order(message)
        except ValueError as error:  # with one line for a person
            self._reply(client, number, Reply(printable(str(error), 200)))
            return
        now_s, name = time.monotonic(), client.decode("utf-8", "replace")
        self._peers.seen(name, now_s)
        self._has_clients = True
        if isinstance(order, Hello):
            refusal = self._peers.hello(name, order, now_s)
            self._reply(client, number, Reply(refusal, self._status, setup=self.setup))
        elif isinstance(order, AskStatus) and self._status is not None:
            self._reply(client, number, Reply(status=self._status))
        elif not isinstance(order, Question) and not self._peers.in_control(name):
            holder = self._peers.controller(now_s)
            who = f"{holder} is in control" if holder else "you are not in control"
            self._reply(client, number, Reply(f"{who}: you can only watch"))
        else:
            answer = self._submit(order, self._peers.name(name))
            answer.add_done_callback(lambda done: self._answered(client, number, done))

    def _answered(self, client: bytes, number: bytes, answer: Future[Reply]) -> None:
        """Let the server's thread send an answer; called by the recorder's thread."""
        self._answers.append((client, number, answer))
        self._wake()

    def _reply(self, client: bytes, number: bytes, reply: Reply) -> None:
        message = [client, b"%d" % PROTOCOL, number, REPLY.dump_json(reply)]
        with suppress(zmq.ZMQError):  # the client does not fetch them, or is gone
            self._requests.send_multipart(message, zmq.NOBLOCK)


def _order(message: list[bytes]) -> Order:
    """Return the order in a message.

    Raises ValueError with one line for a person if there is none.
    """
    size = sum(map(len, message))
    if size > MAX_REQUEST_BYTES:
        raise ValueError(f"a request of {size} bytes; the limit is {MAX_REQUEST_BYTES}")
    protocol, _, name, body = message if len(message) == 4 else (b"", b"", b"", b"")
    if protocol != b"%d" % PROTOCOL:
        spoken = printable(protocol.decode("utf-8", "replace"), 20) or "none"
        text = f"protocol {spoken} is not supported, only {PROTOCOL}"
        raise ValueError(f"{text}: use one version of Bumpbench")
    kind = _ORDERS.get(name.decode("utf-8", "replace"))
    if kind is None:
        raise ValueError(f"there is no order {name!r}")
    try:
        order: Order = _adapter(kind).validate_json(body)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, (kind.__name__, *first["loc"])))
        raise ValueError(f"not an order: {place}: {first['msg']}") from error
    return order


class Peers:
    """The clients that have recently sent a message.

    A client's id begins with the number of its process: all clients are on this machine.  A client
    loses control only to one that asks for it, so a terminal that was delayed keeps it.
    """

    def __init__(self) -> None:
        self._hellos: dict[str, Hello] = {}
        self._seen_s: dict[str, float] = {}
        self._controller = ""

    def seen(self, client: str, now_s: float) -> None:
        """Note a message of a client, and forget clients that are gone."""
        self._seen_s[client] = now_s
        for other in [c for c, seen_s in self._seen_s.items() if now_s - seen_s > LEASE_S]:
            if other != self._controller:
                self._forget(other)

    def hello(self, client: str, hello: Hello, now_s: float) -> str:
        """Admit a client as controller or viewer; return why it is refused, or an empty text."""
        holder = self.controller(now_s)
        if hello.control and holder and self._controller != client and not hello.take_over:
            self._forget(client)
            return f"{holder} is in control (take over, or only watch)"
        self._hellos[client] = hello
        if hello.control:
            self._controller = client
        elif client == self._controller:
            self._controller = ""
        return ""

    def in_control(self, client: str) -> bool:
        """Return whether this client may send orders."""
        return client == self._controller

    def controller(self, now_s: float) -> str:
        """Return the name of the client in control; empty if there is none or it is gone."""
        client = self._controller
        silent_s = now_s - self._seen_s.get(client, now_s)
        # Time without a message, s, after which a client whose process has ended counts as gone: a
        # new terminal must not wait for a dead one.
        if not client or silent_s > LEASE_S or (silent_s > 1.0 and not _lives(client)):
            return ""
        return self.name(client)

    def viewers(self, now_s: float) -> int:
        """Return the number of clients that only watch."""
        return sum(
            hello.attends and now_s - self._seen_s[client] <= LEASE_S
            for client, hello in self._hellos.items()
            if client != self._controller
        )

    def name(self, client: str) -> str:
        """Return the name that a client gave, or its id."""
        hello = self._hellos.get(client)
        return printable(hello.name if hello else client, 60)

    def _forget(self, client: str) -> None:
        self._seen_s.pop(client, None)
        self._hellos.pop(client, None)


def _lives(client: str) -> bool:
    """Return whether the process of a client runs; True if this cannot be determined."""
    number = client.partition("-")[0]
    if not (number.isascii() and number.isdigit()):
        return True
    try:
        os.kill(int(number), 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


# The client ---------------------------------------------------------------------------------------
#
# Only the client in control may send orders; other clients only watch.  A client sends a heartbeat
# twice per second, so that a dead client does not keep control.

HEARTBEAT_S = 0.5
"""Time between two heartbeats, s."""


class RecorderGoneError(BumpbenchError):
    """No recorder answers."""


class OrderRefusedError(Exception):
    """The recorder refuses an order, or does not answer; the text is one line for a person."""


class Client:
    """A connection to one recorder; it survives a restart of the recorder.

    `address`: `daq.control.address.control_address` of the recorder's folder.  `name`, `control`,
    `take_over`, `attends`: as of `Hello`.  Raises RecorderGoneError if no recorder answers, and
    OrderRefusedError if another client is in control.
    """

    def __init__(
        self,
        address: Address,
        name: str,
        control: bool,
        take_over: bool = False,
        attends: bool = True,
    ) -> None:
        self._address = address
        if not is_running(address):
            raise self._gone("no recorder is running there")
        self._number = 0
        self._lock, self._news_lock = threading.Lock(), threading.Lock()
        self._closed = threading.Event()
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._requests = self._context.socket(zmq.DEALER)
        self._requests.identity = f"{os.getpid()}-{uuid4().hex[:12]}".encode()
        self._news = self._context.socket(zmq.SUB)
        # Number of published messages kept for a client that does not fetch them.
        self._news.rcvhwm = 100
        self._news.subscribe(b"")
        for socket, endpoint in ((self._requests, address.control), (self._news, address.news)):
            socket.linger = 0
            socket.connect(endpoint)
        self._heart = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        try:
            reply = self.ask(Hello(name, control, take_over, attends))
        except (RecorderGoneError, OrderRefusedError):
            self._disconnect()
            raise
        self.first_status, self.setup = reply.status, reply.setup
        """Status at the time of the connection, None if there was none yet; and settings with which
        the recorder was started."""
        self._heart.start()

    @property
    def in_control(self) -> bool:
        """True if this client was in control at its last answer."""
        return self._hello.control

    def ask(self, order: Order, timeout_s: float = 2.0) -> Reply:
        """Send an order and return the recorder's answer; may be called by any thread.

        A `Hello` changes this client's name and whether it wants control.

        Raises RecorderGoneError if no answer comes in time; the order may nevertheless have been
        carried out.  Raises OrderRefusedError with the recorder's reason.
        """
        reply = self._answer(order, timeout_s)
        if isinstance(order, Hello):
            self._hello = replace(order, take_over=False)
        return reply

    def news(self, timeout_s: float) -> Status | Live | None:
        """Return the next published message, None if there is none in time; for one thread.

        Messages that are not fetched are dropped, the newest first.
        """
        deadline_s = time.monotonic() + timeout_s
        with self._news_lock:
            while not self._closed.is_set():
                remaining_s = deadline_s - time.monotonic()
                # Longest wait for a message, s, before checking whether the client was closed.
                if not self._news.poll(int(max(0.0, min(remaining_s, 0.1)) * 1e3)):
                    if remaining_s <= 0:
                        break
                    continue
                topic, body = self._news.recv_multipart(zmq.NOBLOCK)
                with suppress(ValidationError):  # from another version, which replies report
                    news: Status | Live = (LIVE if topic == LIVE_TOPIC else STATUS).validate_json(
                        body
                    )
                    return news
        return None

    def close(self) -> None:
        """Release control and disconnect."""
        if self._closed.is_set():
            return
        if self._hello.control:
            with suppress(RecorderGoneError, OrderRefusedError):
                self.ask(replace(self._hello, control=False), timeout_s=0.5)
        self._closed.set()
        self._heart.join()
        self._disconnect()

    def _disconnect(self) -> None:
        self._closed.set()
        with self._lock, self._news_lock:
            self._requests.close()
            self._news.close()
        self._context.term()

    def _beat(self) -> None:
        """Send heartbeats, also to a recorder that was restarted meanwhile."""
        while not self._closed.wait(HEARTBEAT_S):
            try:
                self._answer(self._hello, HEARTBEAT_S)
            except OrderRefusedError:  # another client has taken over: only watch from now on
                self._hello = Hello(self._hello.name)
            except RecorderGoneError:
                continue

    def _answer(self, order: Order, timeout_s: float) -> Reply:
        with self._lock:
            if self._closed.is_set():
                raise self._gone("the connection is closed")
            self._number += 1
            number = b"%d" % self._number
            deadline_s = time.monotonic() + timeout_s
            body = json.dumps(asdict(order)).encode()
            request = [b"%d" % PROTOCOL, number, type(order).__name__.encode(), body]
            with suppress(zmq.Again):
                self._requests.send_multipart(request, zmq.NOBLOCK)
                while (remaining_s := deadline_s - time.monotonic()) > 0:
                    if self._requests.poll(int(remaining_s * 1e3) + 1):
                        reply = self._read(self._requests.recv_multipart(zmq.NOBLOCK), number)
                        if reply is not None:
                            return reply
        raise self._gone(f"no answer within {timeout_s:g} s")

    def _read(self, message: list[bytes], number: bytes) -> Reply | None:
        """Return the answer in a message; None if it is a late one to an earlier request."""
        try:
            protocol, answered, answer = message
            if int(protocol) != PROTOCOL:
                raise self._gone(f"the recorder speaks protocol {int(protocol)}, not {PROTOCOL}")
            reply: Reply = REPLY.validate_json(answer)
        except ValueError as error:
            raise self._gone("the recorder is of another version") from error
        if answered != number:
            return None
        if reply.error:
            raise OrderRefusedError(reply.error)
        return reply

    def _gone(self, reason: str) -> RecorderGoneError:
        return RecorderGoneError(str(self._address.paths[0]), reason, "start `bumpbench record`")
