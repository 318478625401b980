"""The run log: verdicts of persons and of the recorder, in any order."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from daq.bench.campaign import Campaign, Step
from daq.bench.config import Bench
from daq.control.messages import STATUS, Accept, Mark, Note, OverrideWarning, Reject
from daq.recorder.run_loop import order_event
from daq.runlog import (
    Code,
    RunLog,
    entry,
    finding_record,
    fold,
    next_step,
    parse_label,
    read_finding,
    verdict_entry,
)
from daq.runs import Event, Excitation, RunStatus
from dbc.words import Finding, Severity

from .a_status import a_status

RUN = "baseline_bounce_1"
BUMP = Event(1, Code.BUMP, 1.0, RUN)
REJECT = entry(Code.REJECT, 2, label=RUN, by="Ann", reason="door slammed")
UNDO, REDO = Event(4, Code.UNDO), Event(5, Code.REDO)
WEAK = Finding("too_weak", Severity.ERROR, "1 of 2 m/s2", "", "bump harder", 1.0, 2.0, "m/s2")
HUGE = verdict_entry(7, RUN, [WEAK]).text.replace("2.0", "2" + 400 * "0")
FINE = Finding("too_weak", Severity.NOTE, "3 of 2 m/s2", "", "", 3.0, 2.0, "m/s2")


def stand(*events: Event) -> tuple[RunStatus, str, tuple[str, ...]]:
    run = fold(events).runs[0]
    return run.status, run.by, tuple(f.code for f in run.findings)


def test_a_run_that_a_person_rejected_before_its_end_stays_rejected() -> None:
    """So it is in journals of November 2026."""
    events = (BUMP, REJECT, verdict_entry(3, RUN, [FINE]))
    assert stand(*events) == (RunStatus.REJECTED, "Ann", ("too_weak",))


def test_no_run_is_open_after_a_restart_whatever_is_undone() -> None:
    resumed = Event(3, Code.RESUMED)
    assert stand(BUMP, resumed) == (RunStatus.REJECTED, "", ("cut",))
    assert stand(BUMP, resumed, UNDO) == (RunStatus.ACCEPTED, "undo", ("cut",))
    assert stand(BUMP, REJECT, resumed) == (RunStatus.REJECTED, "Ann", ())
    assert stand(BUMP, verdict_entry(3, RUN, []), UNDO) == (RunStatus.REJECTED, "undo", ())


def test_a_value_that_is_no_number_can_be_sent_to_clients() -> None:
    odd = Finding("wrong_mode", Severity.NOTE, "no ratio", "", "", float("nan"), float("inf"), "")
    run_log = fold([BUMP, verdict_entry(2, RUN, [odd])])
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
        fine = fold([BUMP, verdict_entry(2, RUN, [FINE])])
        held = fine if isinstance(order, Reject) else run_log
        event = order_event(order, "Ann", 3, held, bench, None)
        assert event is not None
        assert json.loads(event.text)[key] in (clean, f"{clean}\n{clean}")
    for text, printed in ((foul, clean), ("\x07" * 50, "\\x07" * 50)):  # none is cut off
        mark = order_event(Mark(text), "Ann", 3, RunLog(), bench, None)
        assert mark is not None
        assert mark.text == printed


def test_a_verdict_after_an_undone_one_leaves_nothing_to_redo() -> None:
    accept = entry(Code.ACCEPT, 6, label=RUN, by="Ben", reason="fine")
    log = fold([BUMP, verdict_entry(2, RUN, [WEAK]), REJECT, UNDO])
    assert [len(log.done), len(log.undone)] == [1, 1]
    log = fold([accept], log)
    assert [len(log.done), len(log.undone)] == [2, 0]
    assert fold([REDO], log) == log
    found = stand(BUMP, verdict_entry(2, RUN, [WEAK]), REJECT, UNDO, accept, REDO)
    assert found == (RunStatus.ACCEPTED, "Ben", ("too_weak",))


def test_verdicts_are_undone_and_redone_in_turn() -> None:
    second = "baseline_bounce_2"
    events = [
        BUMP,
        verdict_entry(2, RUN, [FINE]),
        Event(3, Code.BUMP, 1.0, second),
        verdict_entry(4, second, [WEAK]),
    ]

    def statuses(*more: Event) -> list[str]:
        return [str(run.status) for run in fold([*events, *more]).runs]

    assert statuses() == ["accepted", "rejected"]
    assert statuses(UNDO) == ["accepted", "accepted"]
    assert statuses(UNDO, UNDO) == ["rejected", "accepted"]
    assert statuses(UNDO, UNDO, UNDO) == ["rejected", "accepted"]
    assert statuses(UNDO, UNDO, REDO) == ["accepted", "accepted"]
    assert statuses(UNDO, UNDO, REDO, REDO, REDO) == ["accepted", "rejected"]


def test_the_revision_counts_changes_of_the_session_file_alone() -> None:
    note = entry(Code.NOTE, 3, text="windy", label="", by="Ann")
    override = entry(Code.OVERRIDE, 4, subject="bus", reason="known", by="Ann")
    choose = entry(Code.CHOOSE, 5, mass_state="added", excitation="roll")
    steps: list[tuple[Event, int]] = [
        (BUMP, 1),
        (BUMP, 1),  # the same label
        (Event(2, Code.BUMP, 1.0, "no label"), 1),
        (verdict_entry(2, RUN, [WEAK]), 2),
        (note, 2),
        (Event(3, Code.MARK, text="here"), 2),
        (override, 3),
        (choose, 3),
        (Event(6, Code.BENCH, text="[bus]"), 4),
        (UNDO, 5),
        (REDO, 6),
        (REDO, 6),
        *((Event(7, Code.NOTE, text=text), 6) for text in ("not JSON", "[]", 9999 * "[")),
        (Event(7, Code.VERDICT, text=HUGE), 6),
        (entry(Code.ACCEPT, 7, label="added_roll_9", by="Ann", reason=""), 6),
        (Event(8, "alarm", text="x"), 6),
    ]
    log = RunLog()
    for event, revision in steps:
        log = fold([event], log)
        assert log.revision == revision, event
    assert [(remark.text, remark.revision) for remark in log.notes] == [("windy", 2), ("here", 2)]
    assert log.chosen is not None
    assert log.chosen[0] == "added"
    assert log.bench_text == "[bus]"


def test_a_choice_is_over_with_the_bump_that_was_chosen() -> None:
    choose = entry(Code.CHOOSE, 1, mass_state="baseline", excitation="bounce")
    other = entry(Code.CHOOSE, 1, mass_state="added", excitation="bounce")
    assert fold([choose, BUMP]).chosen is None
    assert fold([other, BUMP]).chosen is not None


def test_a_label_names_state_kind_and_attempt() -> None:
    for step in (
        Step("baseline", Excitation.BOUNCE, 1),
        Step("added", Excitation.WARP, 12),
        Step("added", Excitation.REAR_PITCH, 3),
    ):
        assert parse_label(step.label) == step
    for label in ("baseline_bounce_", "baseline_bounce_x", "baseline_hop_1", "baseline"):
        assert parse_label(label) is None


def test_the_next_step_is_the_first_kind_that_lacks_accepted_runs() -> None:
    campaign = Campaign((Excitation.BOUNCE, Excitation.ROLL), 2)

    def next_label(log: RunLog) -> str:
        step = next_step(campaign, log)
        return step.label if step else ""

    log = RunLog()
    labels = []
    for t_ns in range(8):
        labels.append(next_label(log))
        log = fold([Event(t_ns, Code.BUMP, 1.0, labels[-1])], log)
        assert next_label(log) == labels[-1]  # while it is recorded
        log = fold([verdict_entry(t_ns, labels[-1], [WEAK if t_ns == 1 else FINE])], log)
    assert labels == [
        "baseline_bounce_1",
        "baseline_bounce_2",
        "baseline_bounce_3",
        "baseline_roll_1",
        "baseline_roll_2",
        "added_bounce_1",
        "added_bounce_2",
        "added_roll_1",
    ]
    log = fold(
        [Event(9, Code.BUMP, 1.0, "added_roll_2"), verdict_entry(9, "added_roll_2", [])], log
    )
    assert next_label(log) == ""
    choose = entry(Code.CHOOSE, 10, mass_state="baseline", excitation="roll")
    assert next_label(fold([choose], log)) == "baseline_roll_3"
    assert log.accepted("baseline", Excitation.BOUNCE) == 2
    assert len(log.of("baseline", Excitation.BOUNCE)) == 3


def test_a_finding_is_stored_with_every_field_and_read_again() -> None:
    record = finding_record(WEAK)
    assert record == {
        "code": "too_weak", "passed": False, "subject": "", "value": 1.0, "limit": 2.0,
        "unit": "m/s2", "text": "1 of 2 m/s2", "advice": "bump harder",
    }  # fmt: skip
    assert read_finding(record) == WEAK
    assert read_finding(finding_record(FINE)) == FINE
    for key in record:
        with pytest.raises(ValueError, match="not the record of a finding"):
            read_finding({name: value for name, value in record.items() if name != key})
    for figure in (float("nan"), float("inf"), float("-inf")):
        odd = finding_record(replace(WEAK, value=figure, limit=figure))
        assert (odd["value"], odd["limit"]) == (0.0, 0.0)
