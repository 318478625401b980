"""Converts orders to events of the run log, or refuses them in one line for a person."""

from __future__ import annotations

import threading
from collections import deque
from concurrent.futures import Future
from dataclasses import replace
from datetime import date
from pathlib import Path

from dbc.frames import FrameBatch

from ..bench.campaign import Step
from ..bench.config import Bench, bench_codec, parse_bench
from ..check.check import check_bench
from ..control.messages import Reply
from ..control.orders import (
    Accept,
    Arm,
    Choose,
    Configure,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Pause,
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


Pending = tuple[Order | Bench, str, Future[Reply]]
"""An order, or a bench to continue with; the name of the person; and the future of the answer."""


class OrderQueue:
    """A queue of orders for the recorder's writer; `put` may be called from any thread.

    `arrived`: set when an order was put in, to wake the thread that takes them.
    """

    def __init__(self) -> None:
        self.arrived = threading.Event()
        self._orders: deque[Pending] = deque()
        self._lock = threading.Lock()
        self._closed = False

    def put(self, order: Order | Bench, by: str) -> Future[Reply]:
        """Append an order; the future fails with `OrderError` if the queue is closed."""
        answer: Future[Reply] = Future()
        with self._lock:
            if self._closed:
                answer.set_exception(OrderError("the recorder is ending"))
            else:
                self._orders.append((order, by, answer))
        self.arrived.set()
        return answer

    @property
    def are_waiting(self) -> bool:
        """True if there are waiting orders."""
        return bool(self._orders)

    def take(self) -> Pending | None:
        """Remove and return the oldest order that was not cancelled; None if there is none."""
        while self._orders:
            pending = self._orders.popleft()
            if pending[2].set_running_or_notify_cancel():
                return pending
        return None

    def close(self) -> None:
        """Cancel the orders that wait, and refuse further ones."""
        with self._lock:
            self._closed = True
        while self._orders:
            self._orders.popleft()[2].cancel()


def order_event(
    order: Order,
    by: str,
    t_ns: int,
    run_log: RunLog,
    bench: Bench,
    due: Step | None,
) -> Event | None:
    """Return the event of an order on the runs; None if the order has no event.

    `by`: name of its sender.  `t_ns`: data time.  `due`: next step of the campaign.
    Raises OrderError if the order is not possible now.
    """
    match order:
        case Arm():
            _check_arm(order, due, run_log)
            return Event(t_ns, "arm", text=f"{order.until} {by}")
        case Pause():
            return Event(t_ns, "pause", text=by)
        case Accept():
            run = _logged(run_log, order.label)
            if run.status is LoggedStatus.OPEN:
                raise OrderError(f"{run.label} is being recorded: wait for its end")
            if run.status is LoggedStatus.ACCEPTED:
                raise OrderError(f"{run.label} is already accepted")
            if not order.reason:
                raise OrderError(f"{run.label} was rejected: give the reason why it should be used")
            return entry(Code.ACCEPT, t_ns, label=run.label, by=by, reason=_clean(order.reason))
        case Reject():
            run = _logged(run_log, order.label)
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
            states = [state.name for state in bench.mass_states]
            if order.mass_state not in states:
                raise OrderError(f"{order.mass_state!r} is not a mass state: {', '.join(states)}")
            if run_log.open is not None:
                raise OrderError(f"{run_log.open.label} is being recorded: wait for its end")
            kind = str(order.excitation)
            return entry(Code.CHOOSE, t_ns, mass_state=order.mass_state, excitation=kind)
        case Mark():
            return Event(t_ns, Code.MARK, text=_clean(order.text))
        case Note():
            if order.label:
                _logged(run_log, order.label)
            return entry(Code.NOTE, t_ns, text=_clean(order.text), label=order.label, by=by)
        case OverrideWarning():
            subject, reason = _clean(order.subject), _clean(order.reason)
            return entry(Code.OVERRIDE, t_ns, subject=subject, reason=reason, by=by)
        case Configure():
            return Event(t_ns, Code.BENCH, text=order.bench_text)
    return None


def _check_arm(order: Arm, due: Step | None, run_log: RunLog) -> None:
    """Check that a run is due, and that the sender has seen which weights are on the car."""
    if due is None:
        raise OrderError("the campaign is complete: choose a run first")
    weights, answered = due.mass_state, order.mass_state == due.mass_state
    if weights_change(run_log, due) and not answered and order.until is not Until.COMPLETE:
        asked = "weights off" if weights == BASELINE else "weights on"
        raise OrderError(
            f"{asked}? the next run is of the car in state {printable(weights, 40)}: look at the "
            f'car, then arm with "mass_state": "{printable(weights, 40)}"'
        )


def _clean(text: str) -> str:
    """Return a person's text without control characters, line by line.

    Terminals, reports and session files would be disturbed by them or refuse them.
    """
    return "\n".join(printable(line, len(text) * 10) for line in text.split("\n"))


def _logged(run_log: RunLog, label: str) -> LoggedRun:
    """Return the run of a label; without a label, the run being recorded, or else the last."""
    last = run_log.runs[-1] if run_log.runs else None
    run = run_log.run(label) if label else run_log.open or last
    if run is None:
        raise OrderError(f"there is no run {label!r}" if label else "there is no run yet")
    return run


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


def answer_check(bench: Bench, frames: FrameBatch, answer: Future[Reply]) -> None:
    """Check the bench with the last frames, and set the answer."""
    try:
        report = check_bench(bench, bench_codec(bench), frames, date.today())
        answer.set_result(Reply(check=report.lines))
    except Exception as error:  # any exception is reported to the client
        answer.set_exception(error)
