"""Orders as entries of the book: what can be refused is refused here, in one line for a person."""

from __future__ import annotations

from ..bench.config import Bench
from ..control.orders import (
    Accept,
    Choose,
    Configure,
    Mark,
    Note,
    Order,
    OverrideWarning,
    Redo,
    Reject,
    Undo,
)
from ..errors import printable
from ..runlog.entries import entry
from ..runlog.runlog import Code, LoggedRun, LoggedStatus, RunLog
from ..runs import Event


class OrderError(Exception):
    """An order that cannot be carried out now; the text is one line for a person."""


def order_event(order: Order, by: str, t_ns: int, book: RunLog, bench: Bench) -> Event | None:
    """Return the entry that an order makes in the book; None if it makes none.

    Parameters
    ----------
    order : Order
        The order.
    by : str
        Who gave it.
    t_ns : int
        Data time.
    book, bench : Book, Bench
        As they stand.

    Raises
    ------
    OrderError
        If it makes no sense now.
    """
    match order:
        case Accept():
            run = _found(book, order.label)
            if run.status is LoggedStatus.OPEN:
                raise OrderError(f"{run.label} is being recorded: wait for its end")
            if run.status is LoggedStatus.ACCEPTED:
                raise OrderError(f"{run.label} is accepted already")
            if not order.reason:
                raise OrderError(f"{run.label} was rejected: say why it is to be used")
            return entry(Code.ACCEPT, t_ns, label=run.label, by=by, reason=_said(order.reason))
        case Reject():
            run = _found(book, order.label)
            if run.status is LoggedStatus.REJECTED:
                raise OrderError(f"{run.label} is rejected already")
            return entry(Code.REJECT, t_ns, label=run.label, by=by, reason=_said(order.reason))
        case Undo():
            if not book.done:
                raise OrderError("there is no verdict to undo")
            return Event(t_ns, Code.UNDO, text=by)
        case Redo():
            if not book.undone:
                raise OrderError("there is nothing to redo")
            return Event(t_ns, Code.REDO, text=by)
        case Choose():
            return _choice(order, t_ns, book, bench)
        case Mark():
            return Event(t_ns, Code.MARK, text=_said(order.text))
        case Note():
            if order.label:
                _found(book, order.label)
            return entry(Code.NOTE, t_ns, text=_said(order.text), label=order.label, by=by)
        case OverrideWarning():
            subject, reason = _said(order.subject), _said(order.reason)
            return entry(Code.OVERRIDE, t_ns, subject=subject, reason=reason, by=by)
        case Configure():
            return Event(t_ns, Code.BENCH, text=order.bench_text)
    return None


def _choice(order: Choose, t_ns: int, book: RunLog, bench: Bench) -> Event:
    states = [state.name for state in bench.mass_states]
    if order.mass_state not in states:
        raise OrderError(f"{order.mass_state!r} is no mass state: {', '.join(states)}")
    if book.open is not None:
        raise OrderError(f"{book.open.label} is being recorded: wait for its end")
    kind = str(order.excitation)
    return entry(Code.CHOOSE, t_ns, mass_state=order.mass_state, excitation=kind)


def _said(text: str) -> str:
    """Return what a person wrote, line by line without control characters.

    It goes to terminals, reports and session files, where they would do harm or be refused.
    """
    return "\n".join(printable(line, len(text) * 10) for line in text.split("\n"))


def _found(book: RunLog, label: str) -> LoggedRun:
    """Return the run that is meant; without a label the one being recorded, or else the last."""
    run = book.run(label) if label else book.open or (book.runs[-1] if book.runs else None)
    if run is None:
        raise OrderError(f"there is no run {label!r}" if label else "there is no run yet")
    return run
