"""What is counted in a run log, also in one that is weeks long."""

from __future__ import annotations

import time
from dataclasses import replace

from daq.bench.campaign import Origin
from daq.bench.config import Bench
from daq.bus.source import HopLosses
from daq.clocks import Now
from daq.recorder.recording import Recording
from daq.recorder.status import counts_of
from daq.runlog.run_log import Change, LoggedRun, LoggedStatus, Override, Remark, RunLog
from daq.runs import BASELINE, Excitation
from dbc import Codec, FrameBatch

from ..long_run_log import long_run_log
from ..small_campaign import small_bench
from .stepped import step

BENCH: Bench = replace(small_bench(), origin=Origin.SIMULATED)
RUN = LoggedRun("baseline_bounce_1", BASELINE, Excitation.BOUNCE, 1, 5, LoggedStatus.REJECTED)
GOOD = replace(RUN, label="baseline_bounce_2", repeat=2, status=LoggedStatus.ACCEPTED)
LOG = RunLog(
    (RUN, GOOD), (Change(GOOD, RUN),), (Change(RUN, GOOD),), None, (Remark(1, "wet"),),
    (Override(1, "bus", "known", "Bob"),), "", 17,
)  # fmt: skip


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
        recording.status(Now(0, 0.0))
        begun_s = time.process_time()
        for k in range(100):
            step(recording, FrameBatch.empty(), HopLosses(), Now(k, 0.1 * k))
            recording.status(Now(k, 0.1 * k))
        return time.process_time() - begun_s

    few, many = long_run_log(20), long_run_log(2000)
    few_s = min(turns_s(few) for _ in range(3))
    many_s = min(turns_s(many) for _ in range(3))
    assert many_s < 3 * few_s


def test_what_is_due_comes_with_its_counts() -> None:
    counts = counts_of(BENCH, LOG)
    assert counts.due is not None
    assert counts.due.step.label == "baseline_roll_1"
    assert (counts.due.accepted, counts.due.planned, counts.due.rejected) == (0, 1, 0)
    first, *others = counts.tallies
    assert (first.accepted, first.planned, first.rejected) == (1, 1, 1)
    assert all((t.accepted, t.planned, t.rejected) == (0, 1, 0) for t in others)
    beyond = replace(RUN, label="baseline_warp_1", excitation=Excitation.WARP)
    last = counts_of(BENCH, RunLog((beyond,))).tallies[-1]
    assert (last.excitation, last.planned, last.rejected) == (Excitation.WARP, 0, 1)
    kinds = [(step.mass_state, step.excitation, step.label) for step in BENCH.campaign.steps]
    done = tuple(
        LoggedRun(label, state, kind, 1, 5, LoggedStatus.ACCEPTED) for state, kind, label in kinds
    )
    complete = counts_of(BENCH, RunLog(done))
    assert complete.due is None
    assert [tally.accepted for tally in complete.tallies] == [1] * 4


class _Nowhere:
    def append(self, frames: FrameBatch, losses: HopLosses) -> None: ...

    def append_events(self, events: object) -> None: ...
