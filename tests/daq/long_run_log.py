"""A run log of weeks."""

from __future__ import annotations

from dataclasses import replace

from daq.runlog.run_log import Code, RunLog, fold, verdict_entry
from daq.runs import Event
from dbc.finding import Finding, Severity

FINE = Finding("too_weak", Severity.NOTE, "3 of 2 m/s2 " * 8, "", "", 3.0, 2.0, "m/s2")
WEAK = replace(FINE, severity=Severity.ERROR, text="1 of 2 m/s2", advice="bump harder")


def long_run_log(runs: int, log: RunLog | None = None) -> RunLog:
    """Return a run log in which every tenth run is rejected; `log`: to be continued."""
    events = []
    for k in range(1 + len(log.runs if log else ()), runs + 1):
        label = f"baseline_bounce_{k}"
        events.append(Event(10 * k, Code.BUMP, 1.0, label))
        events.append(verdict_entry(10 * k + 1, label, [FINE] * 8 + [FINE if k % 10 else WEAK]))
    return fold(events, log)
