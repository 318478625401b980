"""Converts orders to events of the run log, or refuses them in one line for a person."""

from __future__ import annotations

from ..bench.campaign import Step
from ..bench.config import Bench
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
from ..errors import printable
from ..runlog.entries import entry
from ..runlog.runlog import Code, LoggedRun, LoggedStatus, RunLog, weights_change
from ..runs import BASELINE, Event


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
