"""What is counted in a run log, also in one that is weeks long."""

from __future__ import annotations

import time

from daq.bench.config import Bench
from daq.bus.source import HopLosses
from daq.clocks import Now
from daq.recorder.recording import Recording
from daq.recorder.status import counts_of
from daq.runlog.runlog import RunLog
from daq.runs import Excitation
from dbc import Codec, FrameBatch

from ..long_run_log import long_run_log
from .stepped import HOST, step


def test_kinds_beyond_the_campaign_are_counted_behind_it(bench: Bench) -> None:
    counts = counts_of(bench, RunLog())
    assert counts.due is not None
    assert counts.due.step.label == "baseline_bounce_1"
    counts = counts_of(bench, long_run_log(20))
    bounce = counts.tallies[0]
    assert (bounce.mass_state, bounce.excitation) == ("baseline", Excitation.BOUNCE)
    assert (bounce.accepted, bounce.rejected) == (18, 2)
    assert counts.due is not None
    assert counts.due.step.excitation is not Excitation.BOUNCE


def test_a_turn_with_thousands_of_runs_counts_them_only_when_they_change(
    bench: Bench, codec: Codec
) -> None:
    def turns_s(run_log: RunLog) -> float:
        recording = Recording(bench, codec, _Nowhere(), run_log)
        recording.status(Now(0, 0.0), HOST)
        begun_s = time.process_time()
        for k in range(100):
            step(recording, FrameBatch.empty(), HopLosses(), Now(k, 0.1 * k))
            recording.status(Now(k, 0.1 * k), HOST)
        return time.process_time() - begun_s

    few, many = long_run_log(20), long_run_log(2000)
    few_s = min(turns_s(few) for _ in range(3))
    many_s = min(turns_s(many) for _ in range(3))
    assert many_s < 3 * few_s


class _Nowhere:
    def append(self, frames: FrameBatch, losses: HopLosses) -> None: ...

    def append_events(self, events: object) -> None: ...
