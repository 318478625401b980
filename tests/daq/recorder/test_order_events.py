"""Orders of a person as events of the run log, and those that make no sense now."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from daq.bench.config import Bench
from daq.control.orders import (
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
from daq.recorder.orders import OrderError, OrderQueue, checked_arm, order_event
from daq.runlog.run_log import Change, LoggedRun, LoggedStatus, RunLog
from daq.runs import BASELINE, Event, Excitation

from ..small_campaign import small_bench

BENCH: Bench = small_bench()
FIRST = LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 5, LoggedStatus.ACCEPTED)
LAST = replace(FIRST, label="baseline_roll_2", repeat=2, status=LoggedStatus.REJECTED)
OPEN = replace(FIRST, label="baseline_roll_3", repeat=3, status=LoggedStatus.OPEN)
CHANGE = Change(LAST, FIRST)


def event(order: Order, *runs: LoggedRun, **facts: Any) -> Event | None:
    return order_event(order, "Ann", 77, replace(RunLog(runs), **facts), BENCH)


def said(found: Event | None) -> tuple[str, int, object]:
    assert found is not None
    return str(found.code), found.t_ns, json.loads(found.text)


@pytest.mark.parametrize(
    ("order", "runs", "why"),
    [
        (Accept(""), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Accept("baseline_roll_3", "x"), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Accept("", "x"), (LAST, FIRST), "baseline_roll_1 is already accepted"),
        (Accept("baseline_roll_1", "x"), (FIRST, LAST), "baseline_roll_1 is already accepted"),
        (Accept(""), (FIRST, LAST), "give the reason"),
        (Accept(""), (), "no run yet"),
        (Accept("other"), (FIRST,), "no run 'other'"),
        (Reject(), (FIRST, LAST), "baseline_roll_2 is already rejected"),
        (Choose(BASELINE, Excitation.ROLL), (FIRST, OPEN), "baseline_roll_3 is being recorded"),
        (Choose("loaded", Excitation.ROLL), (), "not a mass state: baseline, added"),
        (Note("x", "other"), (FIRST,), "no run 'other'"),
        (Undo(), (FIRST,), "no verdict to undo"),
        (Redo(), (FIRST,), "nothing to redo"),
    ],
)
def test_what_makes_no_sense_now_is_refused(
    order: Order, runs: tuple[LoggedRun, ...], why: str
) -> None:
    with pytest.raises(OrderError, match=why):
        event(order, *runs)


def test_orders_that_make_sense_are_events() -> None:
    verdict = {"label": "baseline_roll_2", "by": "Ann", "reason": "mine"}
    assert said(event(Accept("", "mine"), FIRST, LAST)) == ("accept", 77, verdict)
    verdict = {"label": "baseline_roll_3", "by": "Ann", "reason": "foot"}
    assert said(event(Reject(reason="foot"), LAST, OPEN, FIRST)) == ("reject", 77, verdict)
    verdict = {"label": "baseline_roll_1", "by": "Ann", "reason": "foot"}
    assert said(event(Reject("baseline_roll_1", "foot"), FIRST, OPEN)) == ("reject", 77, verdict)
    chosen = {"mass_state": "added", "excitation": "warp"}
    assert said(event(Choose("added", Excitation.WARP), FIRST)) == ("choose", 77, chosen)
    note = {"text": "wet", "label": "", "by": "Ann"}
    assert said(event(Note("wet"))) == ("note", 77, note)
    override = {"subject": "bus", "reason": "known", "by": "Ann"}
    assert said(event(OverrideWarning("bus", "known"))) == ("override", 77, override)
    assert event(Undo(), FIRST, done=(CHANGE,)) == Event(77, "undo", text="Ann")
    assert event(Redo(), FIRST, undone=(CHANGE,)) == Event(77, "redo", text="Ann")
    assert event(Configure("x = 1")) == Event(77, "bench", text="x = 1")
    assert event(Pause()) is None


def test_texts_lose_their_control_characters_and_keep_their_lines() -> None:
    found = event(Mark("a\x1b[2Jb\nc\x07"))
    assert found is not None
    first, second = found.text.split("\n")
    assert first.startswith("a")
    assert first.endswith("b")
    assert second.startswith("c")
    assert first.isprintable()
    assert second.isprintable()
    escaped = event(Mark("\x07" * 50))
    assert escaped is not None
    assert escaped.text == "\\x07" * 50  # none is cut off, though each is four characters


def test_nothing_can_be_armed_where_no_run_is_due() -> None:
    for until in Until:
        with pytest.raises(OrderError, match="campaign is complete"):
            checked_arm(Arm(until), None, RunLog())


def test_orders_that_wait_are_cancelled_together() -> None:
    orders = OrderQueue()
    assert not orders.are_waiting
    answers = [orders.put(Pause(), name) for name in ("Ann", "Ben")]
    assert orders.are_waiting
    orders.cancel()
    assert [answer.cancelled() for answer in answers] == [True, True]
    assert not orders.are_waiting
    assert orders.take() is None
