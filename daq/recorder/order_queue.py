"""Queues the orders for the recorder's writer thread."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import Future
from dataclasses import dataclass

from ..bench.config import Bench
from ..control.messages import Reply
from ..control.orders import Order
from .orders import OrderError


@dataclass(frozen=True, slots=True)
class PendingOrder:
    """An order, or a bench to continue with, and the future of its answer."""

    order: Order | Bench
    by: str
    """Name of the person."""
    answer: Future[Reply]


class OrderQueue:
    """A queue of orders; `put` may be called from any thread and never blocks.

    `arrived`: set when an order was put in, to wake the thread that takes them.
    """

    def __init__(self) -> None:
        self.arrived = threading.Event()
        self._orders: deque[PendingOrder] = deque()
        self._lock = threading.Lock()
        self._closed = False

    def put(self, order: Order | Bench, by: str) -> Future[Reply]:
        """Append an order; the future fails with `OrderError` if the queue is closed."""
        answer: Future[Reply] = Future()
        with self._lock:
            if self._closed:
                answer.set_exception(OrderError("the recorder is ending"))
                return answer
            self._orders.append(PendingOrder(order, by, answer))
        self.arrived.set()
        return answer

    @property
    def are_waiting(self) -> bool:
        """True if there are waiting orders."""
        return bool(self._orders)

    def take(self) -> PendingOrder | None:
        """Remove and return the oldest order that was not cancelled; None if there is none."""
        while self._orders:
            pending = self._orders.popleft()
            if pending.answer.set_running_or_notify_cancel():
                return pending
        return None

    def close(self) -> None:
        """Refuse further orders."""
        with self._lock:
            self._closed = True

    def cancel(self) -> None:
        """Cancel the orders that wait."""
        while self._orders:
            self._orders.popleft().answer.cancel()
