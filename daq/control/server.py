"""Serves the clients of a recorder: one controller, any number of viewers.

A separate thread passes requests to the recorder, returns its answers, and publishes its status.
No client can delay the recorder: messages that a client does not fetch are dropped at the client's
high-water mark.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from dataclasses import dataclass, replace

import zmq
from pydantic import ValidationError
from pydantic_core import from_json

from ..errors import InputError, printable
from .address import Address, make_private
from .messages import (
    LIVE,
    LIVE_TOPIC,
    PROTOCOL,
    REPLY,
    REQUEST,
    STATUS,
    STATUS_TOPIC,
    Live,
    Reply,
    Request,
    Setup,
    Status,
)
from .orders import QUESTIONS, AskSetup, AskStatus, Hello, Order

MAX_REQUEST_BYTES = 4_000_000
"""Largest request, bytes: a bench.toml of 1 MB, escaped."""
ANSWER_S = 10.0
"""Time, s, after which a client gets an error if the recorder has not answered."""
MAX_PENDING = 64
"""Largest number of unanswered requests; further requests are refused."""
_HELD_MESSAGES = 100
"""Number of messages kept for a client that does not fetch them: 5 s of statuses, or as many
replies."""
_HELD_NEWS = 16
"""Number of statuses that wait for this thread; further ones replace the oldest."""
_LINGER_MS = 300
"""Time for sending the last messages when the server is closed, ms."""
FIRST_S = 60.0
"""Time, s, that the first client may take to connect: a terminal starts together with its
recorder."""
LOOK_S = 1.0
"""Time between two checks that the sockets still exist, s."""
_POLL_MS = 500
"""Longest wait for a request, ms, before overdue answers are refused."""

LEASE_S = 5.0
"""Time without a message, s, after which a client counts as gone."""
DEAD_S = 1.0
"""Time without a message, s, after which a client whose process has ended counts as gone: a new
terminal must not wait for a dead one."""

_log = logging.getLogger("recorder")


@dataclass(frozen=True, slots=True)
class _Pending:
    """A request that the recorder has not answered yet."""

    envelope: list[bytes]
    number: int
    answer: Future[Reply]
    deadline_s: float


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
        self._submit = submit
        self.setup = setup
        self._left_s = time.monotonic() + FIRST_S
        self._has_clients = False
        self._peers = Peers()
        self._pending: list[_Pending] = []
        self._status: Status | None = None
        # The recorder appends without waiting; the oldest are dropped if this thread lags.
        self._news: deque[tuple[Status, Live | None]] = deque(maxlen=_HELD_NEWS)
        self._closing = threading.Event()
        self._wake_in, self._wake_out = os.pipe()
        os.set_blocking(self._wake_in, False)
        os.set_blocking(self._wake_out, False)
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._requests = self._context.socket(zmq.ROUTER)
        self._requests.maxmsgsize = 4 * MAX_REQUEST_BYTES  # a longer line is cut
        self._publisher = self._context.socket(zmq.PUB)
        for end in (self._requests, self._publisher):
            end.linger = _LINGER_MS
            end.sndhwm = _HELD_MESSAGES
        self._address = address
        self._looked_s, self._deaf = time.monotonic(), False
        try:
            self._requests.bind(address.control)
            self._publisher.bind(address.news)
        except zmq.ZMQError as error:
            self._release()
            what = f"cannot listen: {error.strerror}"
            raise InputError(str(address.paths[0]), what, "see who owns that directory") from error
        self._thread = threading.Thread(target=self._run, name="control", daemon=True)
        self._thread.start()

    def alone_s(self) -> float:
        """Return the time without any client, s; the first client may take `FIRST_S`."""
        return max(time.monotonic() - self._left_s, 0.0)

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
                ready = dict(poller.poll(_POLL_MS))
                self._cycle(bool(ready.get(self._requests)))
            except Exception as error:  # any exception: the next client must be served
                _log.error("control: %r", error)
        self._cycle(False)

    def _cycle(self, requested: bool) -> None:
        with suppress(BlockingIOError):
            os.read(self._wake_in, 4096)
        while self._news:
            self._send_news(*self._news.popleft())
        if requested:
            with suppress(zmq.Again):
                *envelope, message = self._requests.recv_multipart(zmq.NOBLOCK)
                self._take(envelope, message)
        self._answer_pending()
        if time.monotonic() - self._looked_s > LOOK_S:
            self._looked_s = time.monotonic()
            self._listen_again()

    def _listen_again(self) -> None:
        """Bind sockets again whose files are gone: a logout deletes a user's run-time directory."""
        gone = [path for path in self._address.paths if not path.is_socket()]
        if not gone:
            return
        try:
            make_private(gone[0].parent)
            ends = (self._requests, self._address.control), (self._publisher, self._address.news)
            for end, endpoint in ends:
                with suppress(zmq.ZMQError):  # the last attempt to bind it failed
                    end.unbind(endpoint)
                end.bind(endpoint)
            _log.warning("control: %s was deleted and has been created again", gone[0])
            self._deaf = False
        except (InputError, zmq.ZMQError) as error:
            if not self._deaf:
                _log.warning("control: no client can connect: %s", error)
            self._deaf = True

    def _send_news(self, status: Status, live: Live | None) -> None:
        now_s = time.monotonic()
        controller, viewers = self._peers.controller(now_s), self._peers.viewers(now_s)
        self._has_clients = bool(controller or viewers)
        if self._has_clients:
            self._left_s = now_s
        self._status = replace(status, controller=controller, viewers=viewers)
        news = STATUS.dump_json(self._status)
        with suppress(zmq.Again):
            self._publisher.send_multipart([STATUS_TOPIC, news], zmq.NOBLOCK)
            if live is not None:
                self._publisher.send_multipart([LIVE_TOPIC, LIVE.dump_json(live)], zmq.NOBLOCK)

    def _take(self, envelope: list[bytes], message: bytes) -> None:
        """Answer a request, or pass it to the recorder."""
        request = _read(message)
        if isinstance(request, Reply):
            self._reply(envelope, request)
            return
        now_s = time.monotonic()
        order, number = request.order, request.number
        self._peers.seen(request.client, now_s)
        self._has_clients = True
        if isinstance(order, Hello):
            error = self._peers.hello(request.client, order, now_s)
            self._reply(envelope, Reply(number, error, self._status))
        elif isinstance(order, AskSetup):
            self._reply(envelope, Reply(number, setup=self.setup))
        elif isinstance(order, AskStatus) and self._status is not None:
            self._reply(envelope, Reply(number, status=self._status))
        elif not isinstance(order, QUESTIONS) and not self._peers.in_control(request.client):
            holder = self._peers.controller(now_s)
            who = f"{holder} is in control" if holder else "you are not in control"
            self._reply(envelope, Reply(number, f"{who}: you can only watch"))
        elif len(self._pending) >= MAX_PENDING:
            self._reply(envelope, Reply(number, "the recorder is busy: try again"))
        else:
            answer = self._submit(order, self._peers.name(request.client))
            self._pending.append(_Pending(envelope, number, answer, now_s + ANSWER_S))
            answer.add_done_callback(lambda _: self._wake())

    def _answer_pending(self) -> None:
        now_s = time.monotonic()
        for pending in self._pending[:]:
            if pending.answer.done():
                reply = replace(_outcome(pending.answer), number=pending.number)
            elif now_s > pending.deadline_s:
                text = f"the recorder did not answer within {ANSWER_S:g} s"
                reply = Reply(pending.number, text)
            else:
                continue
            self._pending.remove(pending)
            self._reply(pending.envelope, reply)

    def _reply(self, envelope: Sequence[bytes], reply: Reply) -> None:
        with suppress(zmq.ZMQError):  # the client does not fetch them, or is gone
            self._requests.send_multipart([*envelope, REPLY.dump_json(reply)], zmq.NOBLOCK)


def _outcome(answer: Future[Reply]) -> Reply:
    try:
        return answer.result()
    except CancelledError:
        return Reply(0, "the recorder is ending")
    except Exception as error:  # any exception is reported to the client
        return Reply(0, printable(str(error) or repr(error), 400))


def _read(message: bytes) -> Request | Reply:
    """Return the request in a message, or a reply with the error in it."""
    if len(message) > MAX_REQUEST_BYTES:
        text = f"a request of {len(message)} bytes; the limit is {MAX_REQUEST_BYTES}"
        return Reply(0, text)
    try:
        request: Request = REQUEST.validate_json(message)
    except ValidationError as error:
        number, protocol = _number_and_protocol(message)
        if protocol != PROTOCOL:
            return Reply(number, _other_protocol(protocol))
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        return Reply(number, printable(f"not a request: {place}: {first['msg']}", 200))
    if request.protocol != PROTOCOL:
        return Reply(request.number, _other_protocol(request.protocol))
    return request


def _other_protocol(protocol: int) -> str:
    return f"protocol {protocol} is not supported, only {PROTOCOL}: use one version of Bumpbench"


def _number_and_protocol(message: bytes) -> tuple[int, int]:
    """Return number and protocol of an invalid request as far as they can be read."""
    with suppress(ValueError):
        found = from_json(message)
        if isinstance(found, dict):
            number, protocol = found.get("number"), found.get("protocol")
            return (
                number if isinstance(number, int) else 0,
                protocol if isinstance(protocol, int) else PROTOCOL,
            )
    return 0, PROTOCOL


class Peers:
    """The clients that have recently sent a message.

    A client's id begins with the number of its process: all clients are on this machine.  A client
    loses control only to one that asks for it, so a terminal that was delayed keeps it.
    """

    def __init__(self) -> None:
        self._names: dict[str, str] = {}
        self._seen_s: dict[str, float] = {}
        self._attending: set[str] = set()
        self._controller = ""

    def seen(self, client: str, now_s: float) -> None:
        """Note a message of a client, and forget clients that are gone."""
        self._seen_s[client] = now_s
        for other in [c for c, seen_s in self._seen_s.items() if now_s - seen_s > LEASE_S]:
            if other != self._controller:
                self._seen_s.pop(other)
                self._attending.discard(other)
                self._names.pop(other, None)

    def hello(self, client: str, hello: Hello, now_s: float) -> str:
        """Admit a client as controller or viewer; return why it is refused, or an empty text."""
        self._names[client] = printable(hello.name, 60)
        if hello.attends:
            self._attending.add(client)
        if not hello.control:
            if client == self._controller:
                self._controller = ""
            return ""
        holder = self.controller(now_s)
        if holder and self._controller != client and not hello.take_over:
            self._seen_s.pop(client, None)
            self._names.pop(client)
            return f"{holder} is in control (take over, or only watch)"
        self._controller = client
        return ""

    def in_control(self, client: str) -> bool:
        """Return whether this client may send orders."""
        return client == self._controller

    def controller(self, now_s: float) -> str:
        """Return the name of the client in control; empty if there is none or it is gone."""
        client = self._controller
        if not client:
            return ""
        silent_s = now_s - self._seen_s.get(client, now_s)
        if silent_s > LEASE_S or (silent_s > DEAD_S and not _lives(client)):
            return ""
        return self.name(client)

    def viewers(self, now_s: float) -> int:
        """Return the number of clients that only watch."""
        alive = [c for c in self._attending if now_s - self._seen_s.get(c, -LEASE_S) <= LEASE_S]
        return len(alive) - (self._controller in alive)

    def name(self, client: str) -> str:
        """Return the name that a client gave, or its id."""
        return self._names.get(client) or printable(client, 60)


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
