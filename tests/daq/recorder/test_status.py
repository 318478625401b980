"""The status of a run log, also of one that is weeks long."""

from __future__ import annotations

from dataclasses import replace

from daq.control.messages import STATUS
from daq.recorder.status import status_runs
from daq.runlog.entries import verdict_entry
from daq.runlog.fold import fold
from daq.runlog.runlog import Code, LoggedRun, LoggedStatus, RunLog
from daq.runs import Event
from dbc.finding import Finding, Severity

from ..a_status import a_status

FINE = Finding("too_weak", Severity.NOTE, "3 of 2 m/s2 " * 8, "", "", 3.0, 2.0, "m/s2")
WEAK = replace(FINE, severity=Severity.ERROR, text="1 of 2 m/s2", advice="bump harder")
CAMPAIGN, WEEKS = 60, 3000


def _run_log(runs: int) -> RunLog:
    """Return a run_log in which every tenth run is rejected."""
    events = []
    for k in range(1, runs + 1):
        label = f"baseline_bounce_{k}"
        events.append(Event(10 * k, Code.BUMP, 1.0, label))
        verdict = [FINE] * 8 + [FINE if k % 10 else WEAK]
        events.append(verdict_entry(10 * k + 1, label, verdict))
    return fold(events)


def _size(runs: tuple[LoggedRun, ...]) -> int:
    return len(STATUS.dump_json(replace(a_status(), runs=runs)))


def test_a_campaign_is_published_whole() -> None:
    run_log = _run_log(CAMPAIGN)
    assert status_runs(run_log) == run_log.runs


def test_of_weeks_all_runs_are_published_with_what_stood_against_them() -> None:
    run_log = _run_log(WEEKS)
    status = status_runs(run_log)
    assert [run.label for run in status] == [run.label for run in run_log.runs]
    assert [run.reasons for run in status] == [run.reasons for run in run_log.runs]
    assert sum(run.status is LoggedStatus.REJECTED for run in status) == WEEKS // 10
    assert status[-CAMPAIGN:] == run_log.runs[-CAMPAIGN:]
    assert _size(status) < _size(run_log.runs) / 5
