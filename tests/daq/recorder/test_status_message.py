"""Every figure of a status message is that of the recording it is of."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.alarms import Watch
from daq.bench.config import Bench
from daq.bench.origin import Origin
from daq.clocks import Now
from daq.control.messages import (
    BusState,
    BusStatus,
    DiskStatus,
    LeftOut,
    Phase,
    QueueStatus,
    SessionState,
    SessionStatus,
    StorageStatus,
)
from daq.control.orders import Until
from daq.recorder.run_loop import LoopState
from daq.recorder.status import Host, State, build_status, counts_of
from daq.runlog.runlog import Change, LoggedRun, LoggedStatus, Override, Remark, RunLog
from daq.runs import BASELINE, Excitation, Losses

from ..small_campaign import small_bench

S = 1_000_000_000
BENCH: Bench = replace(small_bench(), origin=Origin.SIMULATED)
RUN = LoggedRun("baseline_bounce_1", BASELINE, Excitation.BOUNCE, 1, 5, LoggedStatus.REJECTED)
GOOD = replace(RUN, label="baseline_bounce_2", repeat=2, status=LoggedStatus.ACCEPTED)
LOG = RunLog(
    (RUN, GOOD), (Change(GOOD, RUN),), (Change(RUN, GOOD),), None, (Remark(1, "wet"),),
    (Override(1, "bus", "known", "Bob"),), "", 17,
)  # fmt: skip
HOST = Host(
    "r1", "/data", "bumpbench 9", DiskStatus(1, 2, 3, 0.4), QueueStatus(1, 2, 3),
    SessionStatus(SessionState.READY, "s.h5", "", "r1", 16), StorageStatus(9, 8, 0.5), "new",
)  # fmt: skip
BUS = BusStatus("can0", BusState.OK, 0.5, 100.0, 7, 0, 0)
ALARMS = Watch()
ALARMS.buses, ALARMS.sensors_alive, ALARMS.sensors_expected = (BUS,), 3, 4
LOOP = LoopState(Phase.WAITING, 100 * S, Until.EXCITATION, (BASELINE, Excitation.ROLL), 2, "x")
STATE = State(
    103 * S, 99 * S, 12345, LOOP, ("hub_acc_fl",), 0.25, ALARMS, Losses(counter_gaps=6),
    (LeftOut("baseline_bounce_2", "odd"),),
)  # fmt: skip


def test_a_status_says_what_is() -> None:
    counts = counts_of(BENCH, LOG)
    status = build_status(Now(77, 1.0), HOST, BENCH, LOG, counts, STATE)
    assert (status.wall_ns, status.t_ns, status.bump_ns) == (77, 103 * S, 99 * S)
    assert (status.recording, status.folder, status.software) == ("r1", "/data", "bumpbench 9")
    assert (status.vehicle, status.bench_crc32) == (BENCH.vehicle.name, 12345)
    assert (status.phase, status.phase_s) == (Phase.WAITING, 3.0)
    assert (status.countdown_s, status.halted, status.peak_left) == (None, "", 0.25)
    assert status.not_at_rest == ("hub_acc_fl",)
    assert (status.runs, status.notes, status.overrides) == (LOG.runs, LOG.notes, LOG.overrides)
    assert (status.undo, status.redo) == (
        "baseline_bounce_1 rejected", "baseline_bounce_2 accepted",
    )  # fmt: skip
    assert (status.sensors_alive, status.sensors_expected) == (3, 4)
    assert (status.buses, status.losses) == ((BUS,), Losses(counter_gaps=6))
    assert (status.disk, status.queue, status.session) == (HOST.disk, HOST.queue, HOST.session)
    assert (status.storage, status.begun) == (HOST.storage, "new")
    assert (status.revision, status.origin) == (17, Origin.SIMULATED)
    assert status.proposed == STATE.proposed
    assert (status.due, status.tallies) == (counts.due, counts.tallies)


@pytest.mark.parametrize(
    ("phase", "until", "since_s", "countdown_s", "named"),
    [
        (Phase.ACCEPTED, Until.COMPLETE, 101.0, 1.0, False),
        (Phase.REJECTED, Until.COMPLETE, 99.0, 0.0, False),
        (Phase.ACCEPTED, Until.RUN, 101.0, None, False),
        (Phase.ARMED, Until.COMPLETE, 101.0, None, False),
        (Phase.WAITING, Until.COMPLETE, 110.0, None, True),
    ],
)
def test_seconds_and_channels_are_reported_where_they_mean_something(
    phase: Phase, until: Until, since_s: float, countdown_s: float | None, named: bool
) -> None:
    """The operator of this bench has three seconds to reject a run."""
    loop = replace(LOOP, phase=phase, until=until, since_ns=round(since_s * S), halted="too_weak")
    state = replace(STATE, loop=loop)
    status = build_status(Now(77, 1.0), HOST, BENCH, LOG, counts_of(BENCH, LOG), state)
    assert status.countdown_s == countdown_s
    assert status.phase_s == max(103.0 - since_s, 0.0)
    assert bool(status.not_at_rest) is named
    assert status.halted == "too_weak"


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
