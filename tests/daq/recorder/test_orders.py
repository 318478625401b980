"""Orders of a person as events of the run log, and those that make no sense now."""

from __future__ import annotations

import json
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from daq.bench.campaign import Origin, Step
from daq.bench.config import Bench, BusConfig, default_bench_text, load_bench
from daq.bus.source import HopLosses
from daq.check.check import CheckReport
from daq.control.messages import (
    Accept,
    Acknowledge,
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
    Reply,
    Undo,
    Until,
)
from daq.journal.reader import read_journal
from daq.journal.writer import JournalWriter
from daq.recorder.recording import Recording
from daq.recorder.run_loop import OrderError, OrderQueue, answer_check, configured, order_event
from daq.runlog import Change, LoggedRun, LoggedStatus, RunLog, fold
from daq.runs import ADDED, BASELINE, Event, Excitation
from dbc import Codec, FrameBatch
from dbc.finding import Finding, Severity

from ..small_campaign import blocks, bumps, small_bench
from .stepped import LINK, armed, feed, now, status_of, step

BENCH: Bench = small_bench()
FIRST = LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 5, LoggedStatus.ACCEPTED)
LAST = replace(FIRST, label="baseline_roll_2", repeat=2, status=LoggedStatus.REJECTED)
OPEN = replace(FIRST, label="baseline_roll_3", repeat=3, status=LoggedStatus.OPEN)
CHANGE = (Change(LAST, FIRST),)


def event(order: Order, *runs: LoggedRun, **facts: Any) -> Event | None:
    return order_event(order, "Ann", 77, replace(RunLog(runs), **facts), BENCH, None)


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
        (Arm(Until.COMPLETE), (FIRST,), "campaign is complete"),
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
    assert event(Pause()) == Event(77, "pause", text="Ann")
    assert event(Acknowledge()) is None


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


def test_orders_come_in_turn_and_a_closed_queue_refuses_them() -> None:
    orders = OrderQueue()
    assert orders.take() is None
    assert not orders.arrived.is_set()
    assert not orders.are_waiting
    first, second, third = (orders.put(Pause(), name) for name in ("Ann", "Ben", "Cho"))
    assert orders.arrived.is_set()
    assert second.cancel()
    assert orders.take() == (Pause(), "Ann", first)
    assert orders.are_waiting
    orders.close()
    assert third.cancelled()
    assert not orders.are_waiting
    refused = orders.put(Pause(), "Dee")
    assert isinstance(refused.exception(0), OrderError)
    assert orders.take() is None


# Another bench.toml within a recording, and bench checks that wait for each other -----------------

TEXT = default_bench_text()
OLD = replace(
    load_bench(None),
    text=TEXT,
    buses=(BusConfig("slcan", "/dev/ttyACM0", 250_000),),  # as the command line says
    dbc_name="the one in force",
    origin=Origin.REPLAYED,
)


def test_another_bench_keeps_buses_dbc_and_origin_in_force() -> None:
    text = TEXT.replace("repeats = 2", "repeats = 3")
    assert text != TEXT
    new = configured(OLD, text)
    assert new.campaign.repeats == 3
    assert new.text == text
    assert (new.buses, new.dbc_name, new.origin) == (OLD.buses, OLD.dbc_name, OLD.origin)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (TEXT + "[campaign]\n", "bench.toml"),
        ("x = 1\n" + TEXT, "unknown key x"),
        (TEXT.replace("IMU_Accel.acc_z", "IMU_Accel.acc_q"), "no signal"),
        (TEXT.replace("[bus]", '[bus]\nname = "other"'), "other buses"),
        (TEXT.replace('dbc = ""', 'dbc = "other.dbc"'), "another DBC"),
    ],
)
def test_a_bench_that_cannot_go_on_is_refused(text: str, why: str) -> None:
    with pytest.raises(OrderError, match=why):
        configured(OLD, text)


def test_a_check_is_answered_with_its_lines_or_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Finding("rate", Severity.WARNING, "slow", "message M", "set it", figures={"hz": 5.0})
    report = CheckReport(1.0, 2, (line,))
    monkeypatch.setattr("daq.recorder.run_loop.check_bench", lambda *_: report)
    answer = Future[Reply]()
    answer_check(BENCH, FrameBatch.empty(), answer)
    assert answer.result(0).check == (line,)
    monkeypatch.setattr("daq.recorder.run_loop.check_bench", lambda *_: 1 / 0)
    answer = Future()
    answer_check(BENCH, FrameBatch.empty(), answer)
    assert isinstance(answer.exception(0), ZeroDivisionError)


# Orders to a recording, and a bench.toml that changes within it -----------------------------------


def test_weights_that_change_are_asked_for_when_the_run_is_armed() -> None:
    def armed(order: Arm, due: Step, log: RunLog) -> None:
        found = order_event(order, "Ann", 77, log, BENCH, due)
        assert found == Event(77, "arm", text=f"{order.until} Ann")

    first = Step(BASELINE, Excitation.ROLL, 1)
    done = RunLog(runs=(LoggedRun("baseline_roll_1", BASELINE, Excitation.ROLL, 1, 0),))
    loaded = Step(ADDED, Excitation.BOUNCE, 1)
    armed(Arm(), first, RunLog())
    armed(Arm(), replace(first, repeat=2), done)
    for order in (Arm(), Arm(Until.RUN, "baseline")):
        with pytest.raises(OrderError, match=r'weights on[?].* arm with "mass_state": "added"'):
            armed(order, loaded, done)
    armed(Arm(mass_state="added"), loaded, done)
    armed(Arm(Until.COMPLETE), loaded, done)
    back = RunLog(runs=(LoggedRun("added_roll_1", ADDED, Excitation.ROLL, 1, 0),))
    with pytest.raises(OrderError, match=r'weights off[?].* arm with "mass_state": "baseline"'):
        armed(Arm(), first, back)


def test_orders_are_written_down_and_those_that_make_no_sense_refused(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = armed(quick, codec, journal)
    frames = bumps(codec, 1)
    feed(recording, blocks(frames.select(slice(0, 700))))
    with pytest.raises(OrderError, match="is being recorded"):
        recording.carry_out(Configure(quick.text), "Ann", now())
    feed(recording, blocks(frames.select(slice(700, None))))
    recording.carry_out(Reject(reason="foot"), "Ann", now())
    with pytest.raises(OrderError, match="already rejected"):
        recording.carry_out(Reject("baseline_bounce_1"), "Ann", now())
    with pytest.raises(OrderError, match="give the reason"):
        recording.carry_out(Accept("baseline_bounce_1"), "Ann", now())
    recording.carry_out(Undo(), "Ann", now())
    recording.carry_out(Redo(), "Ann", now())
    recording.carry_out(Accept("baseline_bounce_1", "it was mine"), "Bob", now())
    recording.carry_out(Mark("here"), "Bob", now())
    recording.carry_out(Note("wet", "baseline_bounce_1"), "Bob", now())
    recording.carry_out(OverrideWarning("bus", "known"), "Bob", now())
    recording.carry_out(Acknowledge(), "Bob", now())
    recording.carry_out(Choose("added", Excitation.WARP), "Bob", now())
    status = status_of(recording)
    assert status.due is not None
    assert status.due.step.label == "added_warp_1"
    assert [(note.text, note.label) for note in status.notes] == [
        ("here", ""),
        ("wet", "baseline_bounce_1"),
    ]
    assert [(one.subject, one.by) for one in status.overrides] == [("bus", "Bob")]
    (run,) = status.runs
    assert (run.status, run.by, run.reason) == (LoggedStatus.ACCEPTED, "Bob", "it was mine")
    journal.close()
    events = read_journal(journal.paths).events
    assert fold(events) == recording.run_log
    assert {e.t_ns for e in events if e.code == "mark"} == {int(frames.t_ns[-1])}


def test_bench_toml_may_change_within_a_recording(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    with pytest.raises(OrderError, match="is not TOML"):
        recording.carry_out(Configure("[[["), "Ann", now())
    assert recording.bench == quick
    other = quick.text.replace('name = "Ford Granada"', 'name = "Other"')
    recording.carry_out(Configure(other), "Ann", now())
    assert status_of(recording).vehicle == "Other"
    journal.close()
    assert [(e.code, e.text) for e in read_journal(journal.paths).events] == [("bench", other)]


def test_what_was_lost_before_bench_toml_changed_is_no_news(
    quick: Bench, codec: Codec, journal: JournalWriter
) -> None:
    recording = Recording(quick, codec, journal)
    frames = bumps(codec, 1)
    whole = frames.select(np.delete(np.arange(len(frames)), [50, 51]))
    given, lost = blocks(whole), HopLosses(queue_dropped=9)
    for block in given[: len(given) // 2]:
        step(recording, block, lost, now(block), [LINK])
    recording.carry_out(Configure(quick.text), "Ann", now())
    status = [
        event.text.partition(":")[0]
        for block in given[len(given) // 2 :]
        for event in step(recording, block, lost, now(block), [LINK])
        if event.code == "alarm"
    ]
    assert not {"queue_dropped", "counter_gap HUB_Front"} & set(status), status
    assert status_of(recording).buses[0].frames == len(whole)
