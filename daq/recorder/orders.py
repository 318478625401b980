"""Converts orders to events of the run log, or refuses them in one line for a person."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from dbc.frames import FrameBatch

from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec, parse_bench
from ..check.check import WORDS, check_bench
from ..control.messages import CheckItem, Reply
from ..control.orders import (
    Accept,
    Arm,
    Choose,
    Configure,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Redo,
    Reject,
    Undo,
    Until,
)
from ..errors import InputError, printable
from ..runlog.run_log import Code, LoggedRun, LoggedStatus, RunLog, entry, weights_change
from ..runs import BASELINE, Event
from ..samples.trigger import bench_mapping


class OrderError(Exception):
    """An order that cannot be carried out now; the text is one line for a person."""


def checked_arm(order: Arm, due: Step | None, run_log: RunLog) -> None:
    """Check that a run is due, and that the sender has seen which weights are on the car.

    Raises OrderError otherwise.
    """
    if due is None:
        raise OrderError("the campaign is complete: choose a run first")
    weights, answered = due.mass_state, order.mass_state == due.mass_state
    if weights_change(run_log, due) and not answered and order.until is not Until.COMPLETE:
        asked = "weights off" if weights == BASELINE else "weights on"
        raise OrderError(
            f"{asked}? the next run is of the car in state {printable(weights, 40)}: look at the "
            f'car, then arm with "mass_state": "{printable(weights, 40)}"'
        )


def order_event(order: Order, by: str, t_ns: int, run_log: RunLog, bench: Bench) -> Event | None:
    """Return the event of an order for the run log; None if the order has no event.

    `by`: name of its sender.  `t_ns`: data time.  Raises OrderError if the order is not possible
    now.
    """
    match order:
        case Accept():
            run = _found(run_log, order.label)
            if run.status is LoggedStatus.OPEN:
                raise OrderError(f"{run.label} is being recorded: wait for its end")
            if run.status is LoggedStatus.ACCEPTED:
                raise OrderError(f"{run.label} is already accepted")
            if not order.reason:
                raise OrderError(f"{run.label} was rejected: give the reason why it should be used")
            return entry(Code.ACCEPT, t_ns, label=run.label, by=by, reason=_clean(order.reason))
        case Reject():
            run = _found(run_log, order.label)
            if run.status is LoggedStatus.REJECTED:
                raise OrderError(f"{run.label} is already rejected")
            return entry(Code.REJECT, t_ns, label=run.label, by=by, reason=_clean(order.reason))
        case Undo():
            if not run_log.done:
                raise OrderError("there is no verdict to undo")
            return Event(t_ns, Code.UNDO, text=by)
        case Redo():
            if not run_log.undone:
                raise OrderError("there is nothing to redo")
            return Event(t_ns, Code.REDO, text=by)
        case Choose():
            return _choice(order, t_ns, run_log, bench)
        case Mark():
            return Event(t_ns, Code.MARK, text=_clean(order.text))
        case Note():
            if order.label:
                _found(run_log, order.label)
            return entry(Code.NOTE, t_ns, text=_clean(order.text), label=order.label, by=by)
        case OverrideWarning():
            subject, reason = _clean(order.subject), _clean(order.reason)
            return entry(Code.OVERRIDE, t_ns, subject=subject, reason=reason, by=by)
        case Configure():
            return Event(t_ns, Code.BENCH, text=order.bench_text)
    return None


def _choice(order: Choose, t_ns: int, run_log: RunLog, bench: Bench) -> Event:
    states = [state.name for state in bench.mass_states]
    if order.mass_state not in states:
        raise OrderError(f"{order.mass_state!r} is not a mass state: {', '.join(states)}")
    if run_log.open is not None:
        raise OrderError(f"{run_log.open.label} is being recorded: wait for its end")
    kind = str(order.excitation)
    return entry(Code.CHOOSE, t_ns, mass_state=order.mass_state, excitation=kind)


def _clean(text: str) -> str:
    """Return a person's text without control characters, line by line.

    Terminals, reports and session files would be disturbed by them or refuse them.
    """
    return "\n".join(printable(line, len(text) * 10) for line in text.split("\n"))


def _found(run_log: RunLog, label: str) -> LoggedRun:
    """Return the run of a label; without a label, the run being recorded, or else the last."""
    run = (
        run_log.run(label)
        if label
        else run_log.open or (run_log.runs[-1] if run_log.runs else None)
    )
    if run is None:
        raise OrderError(f"there is no run {label!r}" if label else "there is no run yet")
    return run


# Queues the orders for the recorder's writer thread -----------------------------------------------


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


# Runs the bench check on the last seconds of frames, to answer a client ---------------------------

MOST = 4
"""Largest number of waiting checks: each keeps the frames of some seconds in memory."""


class Checks:
    """Runs bench checks one after another in a separate thread, because they take some time."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1, "check")
        self._waiting: list[Future[Reply]] = []

    def begin(self, bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
        """Start a check; the answer is set when it ends.

        Raises OrderError if too many wait already.
        """
        self._waiting = [waiting for waiting in self._waiting if not waiting.done()]
        if len(self._waiting) >= MOST:
            raise OrderError("other checks are under way: try again")
        self._waiting.append(answer)
        self._thread.submit(_answer, bench, frames, answer)

    def close(self) -> None:
        """Start no further checks."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _answer(bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
    try:
        report = check_bench(bench, bench_codec(bench), frames, date.today())
        lines = tuple(
            CheckItem(
                WORDS[line.severity], line.subject, line.text, line.advice, dict(line.figures)
            )
            for line in report.lines
        )
    except Exception as error:  # any exception is reported to the client
        answer.set_exception(error)
        return
    answer.set_result(Reply(0, check=lines))


# Checks a bench.toml that will replace the present one during a recording -------------------------


def configured(old: Bench, text: str) -> Bench:
    """Return the bench of a new bench.toml, with the present buses and DBC.

    Raises OrderError if it cannot be used, or needs another bus or DBC.
    """
    try:
        bench = parse_bench(text, "bench.toml", Path(), old.dbc_text)
        bench_mapping(bench, bench_codec(bench))
        before = parse_bench(old.text, "bench.toml", Path(), old.dbc_text)
    except InputError as error:
        raise OrderError(str(error)) from error
    # The present buses may come from the command line, so the two files are compared.
    if bench.buses != before.buses:
        raise OrderError("bench.toml names other buses: end the recorder and start it with them")
    if bench.dbc_name != before.dbc_name:
        raise OrderError("bench.toml names another DBC: end the recorder and start it with it")
    return replace(bench, buses=old.buses, dbc_name=old.dbc_name, origin=old.origin)
