"""The run log: verdicts of persons and of the recorder, in any order."""

from __future__ import annotations

import json

import pytest

from daq.bench.config import Bench
from daq.control.messages import STATUS
from daq.control.orders import Accept, Mark, Note, OverrideWarning, Reject
from daq.recorder.orders import order_event
from daq.runlog.entries import entry, verdict_entry
from daq.runlog.fold import fold
from daq.runlog.runlog import Code, LoggedStatus, RunLog
from daq.runs import Event
from dbc.finding import Finding, Severity

from ..a_status import a_status

RUN = "baseline_bounce_1"
BUMP = Event(1, Code.BUMP, 1.0, RUN)
REJECT = entry(Code.REJECT, 2, label=RUN, by="Ann", reason="door slammed")
UNDO, REDO = Event(4, Code.UNDO), Event(5, Code.REDO)
WEAK = Finding("too_weak", Severity.ERROR, "1 of 2 m/s2", "", "bump harder", 1.0, 2.0, "m/s2")
FINE = Finding("too_weak", Severity.NOTE, "3 of 2 m/s2", "", "", 3.0, 2.0, "m/s2")


def stand(*events: Event) -> tuple[LoggedStatus, str, tuple[str, ...]]:
    run = fold(events).runs[0]
    return run.status, run.by, tuple(f.code for f in run.findings)


def test_a_run_rejected_in_its_midst_is_open_again_when_that_is_undone() -> None:
    assert stand(BUMP, REJECT, UNDO) == (LoggedStatus.OPEN, "", ())
    # The recorder decides in the end, and a weak bump is not let in by the back door.
    weak = verdict_entry(6, RUN, [WEAK])
    assert stand(BUMP, REJECT, UNDO, weak) == (LoggedStatus.REJECTED, "", ("too_weak",))
    assert stand(BUMP, REJECT, UNDO, REDO) == (LoggedStatus.REJECTED, "Ann", ())


@pytest.mark.parametrize(
    ("finding", "status"), [(WEAK, LoggedStatus.REJECTED), (FINE, LoggedStatus.ACCEPTED)]
)
def test_the_recorders_verdict_lies_beneath_that_of_a_person_who_was_faster(
    finding: Finding, status: LoggedStatus
) -> None:
    events = (BUMP, REJECT, verdict_entry(3, RUN, [finding]))
    assert stand(*events) == (LoggedStatus.REJECTED, "Ann", ("too_weak",))
    assert stand(*events, UNDO) == (status, "", ("too_weak",))
    assert stand(*events, UNDO, REDO) == (LoggedStatus.REJECTED, "Ann", ("too_weak",))


def test_a_run_without_findings_is_not_open_for_ever() -> None:
    events = (BUMP, REJECT, verdict_entry(3, RUN, []), UNDO)
    assert stand(*events) == (LoggedStatus.ACCEPTED, "", ())
    assert stand(BUMP, verdict_entry(3, RUN, []), UNDO) == (LoggedStatus.REJECTED, "undo", ())


def test_no_run_is_open_after_a_restart_whatever_is_undone() -> None:
    resumed = Event(3, Code.RESUMED)
    assert stand(BUMP, resumed) == (LoggedStatus.REJECTED, "", ("cut",))
    assert stand(BUMP, REJECT, resumed) == (LoggedStatus.REJECTED, "Ann", ("cut",))
    assert stand(BUMP, REJECT, resumed, UNDO) == (LoggedStatus.REJECTED, "", ("cut",))
    assert stand(BUMP, REJECT, UNDO, resumed) == (LoggedStatus.REJECTED, "", ("cut",))


def test_a_value_that_is_no_number_can_be_told_to_clients() -> None:
    odd = Finding("wrong_mode", Severity.NOTE, "no ratio", "", "", float("nan"), float("inf"), "")
    run_log = fold([BUMP, verdict_entry(2, RUN, [odd])])
    from dataclasses import replace

    status = replace(a_status(1), runs=run_log.runs)
    assert STATUS.validate_json(STATUS.dump_json(status)).runs == run_log.runs


def test_what_persons_write_carries_no_control_character(bench: Bench) -> None:
    foul, clean = "a\x00b\x1b[31m\u202ec", "a\\x00b\\x1b[31m\\u202ec"
    run_log = fold([BUMP, verdict_entry(2, RUN, [WEAK])])
    for order, key in (
        (Accept(RUN, foul), "reason"),
        (Reject(RUN, foul), "reason"),
        (Note(f"{foul}\n{foul}"), "text"),
        (OverrideWarning("bus", foul), "reason"),
    ):
        held = fold([BUMP]) if isinstance(order, Reject) else run_log
        event = order_event(order, "Ann", 3, held, bench)
        assert event is not None
        assert json.loads(event.text)[key] in (clean, f"{clean}\n{clean}")
    mark = order_event(Mark(foul), "Ann", 3, RunLog(), bench)
    assert mark is not None
    assert mark.text == clean
