"""Implements a client of the recorder: sends orders, receives the published messages.

Only the client in control may send orders; other clients only watch.  A client sends a heartbeat
twice per second, so that a dead client does not keep control.
"""

from __future__ import annotations

import json
import os
import threading
import time
from contextlib import suppress
from dataclasses import asdict, replace
from uuid import uuid4

import zmq
from pydantic import ValidationError

from ..errors import BumpbenchError
from .address import Address, is_running
from .messages import LIVE, LIVE_TOPIC, PROTOCOL, REPLY, STATUS, Hello, Live, Order, Reply, Status

HEARTBEAT_S = 0.5
"""Time between two heartbeats, s."""
_SLICE_S = 0.1
"""Longest wait for a message, s, before checking whether the client was closed."""
_NEWS_HELD = 100
"""Number of published messages kept for a client that does not fetch them."""


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
        self._news.rcvhwm = _NEWS_HELD
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
                if not self._news.poll(int(max(0.0, min(remaining_s, _SLICE_S)) * 1e3)):
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
