"""A recorder that was restarted measures its runs again from the journal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Procedure
from daq.bench.config import bench_codec, load_bench
from daq.bus.source import HopLosses
from daq.clocks import Now
from daq.control.orders import Arm, Until
from daq.journal.folder import last_recording
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from daq.recorder.judging import is_accepted, is_only_unlike, recall
from daq.recorder.recording import Recording
from daq.runlog.run_log import LoggedRun, LoggedStatus
from daq.runs import BASELINE, Excitation
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from daq.verdict import RunMeasure
from dbc.finding import Finding, Severity

from ..recorder_run import Running, Script, sources
from ..small_campaign import START_NS, blocks
from .stepped import step

BENCH = replace(
    load_bench(None),
    campaign=Campaign((Excitation.BOUNCE,), 2, (BASELINE,)),
    procedure=Procedure(accept_after_s=0.0),
)


def record(folder: Path) -> Recording:
    codec = bench_codec(BENCH)
    head = JournalHead(BENCH.text, BENCH.dbc_text, "test", START_NS, 0, "ab" * 16)
    limits = replace(BENCH.recorder, segment_bytes=100_000)
    with JournalWriter(folder, head, limits) as writer:
        recording = Recording(BENCH, codec, writer)
        recording.carry_out(Arm(Until.COMPLETE), "Ann", Now(START_NS, 0.0))
        for run in campaign_frames(BENCH, codec, SimulatedCar(), 3, START_NS):
            for block in blocks(run, 400):
                t_ns = int(block.t_ns[-1])
                now = Now(t_ns, (t_ns - START_NS) * 1e-9)
                step(recording, block, HopLosses(), now)
                writer.maintain(now.monotonic_s)
    return recording


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recording]:
    folder = tmp_path_factory.mktemp("journal")
    return folder, record(folder)


def test_runs_are_measured_anew_as_they_were(recorded: tuple[Path, Recording]) -> None:
    folder, recording = recorded
    assert [run.status for run in recording.run_log.runs] == [LoggedStatus.ACCEPTED] * 2
    tail = last_recording(folder)
    assert tail is not None
    assert len(tail.segments) > 2
    found: dict[str, RunMeasure] = {}
    recall(tail, BENCH, found.update).join(60.0)
    assert found.keys() == recording.measures.keys()
    for label, measure in found.items():
        before = recording.measures[label]
        assert measure.peak_m_s2 is not None
        assert measure.peak_m_s2 > 10.0
        assert (measure.peak_m_s2, measure.frequency_hz) == (before.peak_m_s2, before.frequency_hz)
        assert measure.waves.keys() == before.waves.keys() != set()
        assert all(np.array_equal(measure.waves[n], before.waves[n]) for n in before.waves)


def test_a_recorder_that_goes_on_compares_with_the_runs_from_before(
    recorded: tuple[Path, Recording], tmp_path: Path
) -> None:
    folder, before = recorded
    copytree(folder, tmp_path / "journal")
    with Running(BENCH, tmp_path, sources(Script([]))) as running:
        running.until(lambda _: bool(running.recorder._recording.measures))
        measures = running.recorder._recording.measures
    assert measures.keys() == {"baseline_bounce_1", "baseline_bounce_2"}
    assert [m.peak_m_s2 for m in measures.values()] == [
        before.measures[label].peak_m_s2 for label in measures
    ]


def test_a_journal_that_has_gone_is_no_reason_to_stop(
    recorded: tuple[Path, Recording], tmp_path: Path
) -> None:
    copytree(recorded[0], tmp_path, dirs_exist_ok=True)
    tail = last_recording(tmp_path)
    assert tail is not None
    for path in tail.segments:
        path.unlink()
    found: dict[str, RunMeasure] = {}
    thread = recall(tail, BENCH, found.update)
    thread.join(60.0)
    assert not thread.is_alive()
    assert found == {}


def test_later_runs_are_compared_with_accepted_runs_and_those_that_are_only_unlike() -> None:
    run = LoggedRun("baseline_bounce_2", BASELINE, Excitation.BOUNCE, 2, 0, LoggedStatus.REJECTED)
    odd, weak = (Finding(code, Severity.ERROR, "") for code in ("not_repeatable", "too_weak"))
    assert is_only_unlike(replace(run, findings=(odd,)))
    assert not is_only_unlike(replace(run, findings=(weak, odd)))
    assert not is_only_unlike(replace(run, findings=(odd,), by="Ann"))
    assert not is_only_unlike(replace(run, findings=(odd,), status=LoggedStatus.ACCEPTED))
    assert not is_accepted(replace(run, findings=(odd,)))
    assert is_accepted(replace(run, status=LoggedStatus.ACCEPTED))
