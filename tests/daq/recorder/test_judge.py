"""Which samples, losses and earlier runs a run is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Step
from daq.bench.config import Bench, bench_codec, load_bench
from daq.bus.clock import Now
from daq.bus.source import HopLosses
from daq.control.orders import Arm, Until
from daq.journal.folder import last_recording
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from daq.recorder import judging
from daq.recorder.judging import (
    Judge,
    RecentLosses,
    RecentSamples,
    is_accepted,
    is_only_unlike,
    recall,
)
from daq.recorder.recording import Recording
from daq.runlog.run_log import LoggedRun, LoggedStatus, RunLog
from daq.runs import BASELINE, Excitation, Losses
from daq.samples.mapping import SampleBlock
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from daq.verdict import RunMeasure, RunWindow
from dbc import Codec
from dbc.finding import Finding, Severity

from ..recorder_run import Running, Script, sources
from ..small_campaign import START_NS, blocks
from .stepped import step

S = 1_000_000_000
BUMP_NS = 1_800_000_000 * S
STEP = Step(BASELINE, Excitation.ROLL, 4)
NONE = Losses()


class Seen:
    """The arguments with which the judge is called."""

    def __init__(self) -> None:
        self.window = RunWindow(0, {})
        self.accepted: list[RunMeasure] = []
        self.unlike: list[RunMeasure] = []

    def judge(
        self,
        bench: Bench,
        step: Step,
        window: RunWindow,
        accepted: Sequence[RunMeasure],
        unlike: Sequence[RunMeasure],
    ) -> tuple[tuple[Finding, ...], RunMeasure]:
        self.window, self.accepted, self.unlike = window, list(accepted), list(unlike)
        return (), RunMeasure(peak_m=9.0)


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> Seen:
    seen = Seen()
    monkeypatch.setattr(judging, "judge", seen.judge)
    return seen


def block(*times_s: float) -> SampleBlock:
    t_ns = BUMP_NS + np.rint(np.array(times_s) * 1e9).astype(np.int64)
    return {"hub": (t_ns, np.array(times_s))}


def fed(bench: Bench, codec: Codec, measures: dict[str, RunMeasure] | None = None) -> Judge:
    """Return a judge that has seen 3 s of samples, ten a second, and a loss in each."""
    judge = Judge(bench, codec, measures if measures is not None else {})
    for tenth in range(-20, 10):
        at_ns = BUMP_NS + tenth * S // 10
        judge.add(at_ns, at_ns, block(tenth / 10), replace(NONE, crc_bad=tenth + 30))
    return judge


def test_a_run_is_judged_by_its_own_time(bench: Bench, codec: Codec, seen: Seen) -> None:
    """0.1 s before the bump and 0.5 s after it are kept of this bench."""
    assert (bench.trigger.pre_s, bench.trigger.post_s) == (0.1, 0.5)
    measures: dict[str, RunMeasure] = {}
    fed(bench, codec, measures).verdict(STEP, BUMP_NS, RunLog())
    assert seen.window.bump_ns == BUMP_NS
    assert seen.window.channels["hub"][1].tolist() == [-0.1, 0.0, 0.1, 0.2, 0.3, 0.4]
    # All after the block at -0.2 s, and of the block at 0.5 s what it lost since 0.4 s.
    assert seen.window.losses.crc_bad == 7
    assert measures == {"baseline_roll_4": RunMeasure(peak_m=9.0)}


def test_samples_of_a_second_before_a_run_are_kept_no_longer(
    bench: Bench, codec: Codec, seen: Seen
) -> None:
    """0.1 s, 0.5 s and one second more, before the block that came last but one."""
    fed(bench, codec).verdict(STEP, BUMP_NS - S, RunLog())
    assert seen.window.channels["hub"][1].tolist() == [-0.8, -0.7, -0.6]


@pytest.mark.parametrize(("at_ns", "counts"), [(BUMP_NS - 1, False), (BUMP_NS, True)])
def test_a_sensor_at_its_end_counts_from_the_bump_on(
    bench: Bench, codec: Codec, seen: Seen, at_ns: int, counts: bool
) -> None:
    judge = fed(bench, codec)
    judge.saw_saturated(BUMP_NS - S, ["hub", "other"])
    judge.saw_saturated(at_ns, ["hub"])
    judge.verdict(STEP, BUMP_NS, RunLog())
    assert seen.window.saturated == ("hub",) * counts


def test_a_run_is_compared_with_those_of_its_kind_that_count(
    bench: Bench, codec: Codec, seen: Seen
) -> None:
    def run(label: str, *codes: str, by: str = "", kind: Excitation = Excitation.ROLL) -> LoggedRun:
        findings = tuple(Finding(code, Severity.ERROR, code) for code in codes)
        status = LoggedStatus.REJECTED if codes else LoggedStatus.ACCEPTED
        return LoggedRun(label, BASELINE, kind, 1, 0, status, findings, by)

    runs = (
        run("good"),
        run("unlike", "not_repeatable"),
        run("weak", "too_weak"),
        run("both", "not_repeatable", "too_weak"),
        run("decided", "not_repeatable", by="Ann"),
        run("bounce", kind=Excitation.BOUNCE),
        run("unmeasured"),
    )
    measures = {r.label: RunMeasure(peak_m=float(n)) for n, r in enumerate(runs[:-1])}
    fed(bench, codec, measures).verdict(STEP, BUMP_NS, RunLog(runs))
    assert [m.peak_m for m in seen.accepted] == [0.0]
    assert [m.peak_m for m in seen.unlike] == [1.0]


def test_what_is_left_of_the_motion_is_looked_at_three_times_a_second(
    bench: Bench, codec: Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int]] = []

    def left(channels: object, bump_ns: int, columns: SampleBlock, now_ns: int) -> float:
        asked.append((bump_ns - BUMP_NS, now_ns - BUMP_NS))
        return 1.0 / len(asked)

    monkeypatch.setattr(judging, "peak_left", left)
    judge = fed(bench, codec)
    now_ns = BUMP_NS + 10 * S
    assert judge.peak_left(BUMP_NS, now_ns) == 1.0
    assert judge.peak_left(BUMP_NS, now_ns) == 1.0
    assert judge.peak_left(BUMP_NS, now_ns + 299_999_999) == 1.0
    assert judge.peak_left(BUMP_NS, now_ns + 300_000_000) == 0.5
    assert judge.peak_left(BUMP_NS, now_ns + 299_999_999) == pytest.approx(1 / 3)  # set back
    assert judge.peak_left(BUMP_NS + 1, now_ns + 300_000_000) == 0.25
    assert [now - 10 * S for _, now in asked] == [0, 300_000_000, 299_999_999, 300_000_000]


# Frames and samples of the last seconds are kept --------------------------------------------------


def _times(samples: RecentSamples, start_s: int, stop_s: int) -> list[int]:
    found = samples.between(start_s * S, stop_s * S)
    return [int(t_ns) // S for t_ns in found["acc"][0]] if found else []


def test_a_run_is_whole_when_a_pause_of_the_bus_follows() -> None:
    samples = RecentSamples(kept_s=4.0)
    for second in (0, 1, 2, 3, 4, 20):
        samples.add(second * S, {"acc": (np.array([second * S]), np.ones(1))})
    assert _times(samples, 0, 5) == [0, 1, 2, 3, 4]  # the run ends at the first block after it
    samples.add(21 * S, {"acc": (np.array([21 * S]), np.ones(1))})
    assert _times(samples, 0, 30) == [20, 21]


def test_samples_of_a_clock_that_was_set_back_go() -> None:
    samples = RecentSamples(kept_s=4.0)
    for second in (100, 101, 50):
        samples.add(second * S, {"acc": (np.array([second * S]), np.ones(1))})
    assert _times(samples, 0, 200) == [50]


def _counted(*blocks: tuple[float, float, int]) -> RecentLosses:
    """Return losses of blocks: earliest and latest stamp, s, and frames missing so far."""
    losses = RecentLosses(kept_s=4.0)
    for first_s, last_s, missing in blocks:
        losses.add(round(first_s * S), round(last_s * S), Losses(counter_gaps=missing))
    return losses


def _missing(losses: RecentLosses, start_s: float, stop_s: float) -> int:
    return losses.between(round(start_s * S), round(stop_s * S)).counter_gaps


def test_a_span_has_the_losses_of_its_blocks() -> None:
    losses = _counted((0, 1, 5), (1, 2, 7), (2, 3, 10), (3, 4, 14), (4, 5, 19))
    assert [_missing(losses, a + 0.5, b + 0.5) for a, b in pairwise(range(5))] == [7, 5, 7, 9]
    assert _missing(losses, 1.5, 4.0) == 2 + 3 + 4


def test_what_a_pause_of_the_bus_cost_is_not_lost_from_the_run_before_it() -> None:
    losses = _counted((0, 1, 1), (1, 2, 3), (2, 3, 6), (63, 64, 60_006))
    assert _missing(losses, 1.5, 3.0) == 5
    assert _missing(losses, 1.5, 3.03) == 5 + 30  # half a thousandth of the pause is the run's
    assert _missing(losses, 1.5, 63.5) == 5 + 60_000
    again = _counted((0, 1, 1), (1, 2, 3), (2, 3.5, 6), (3.4, 3.6, 7), (63, 64, 60_007))
    assert _missing(again, 1.5, 3.0) == 5  # another bus goes on for a while


def test_losses_before_a_clock_was_set_back_are_not_those_of_a_run_after_it() -> None:
    """What the first block after it has lost may be from before it."""
    losses = _counted((99, 100, 5), (100, 101, 7), (49, 50, 9), (50, 51, 12))
    assert _missing(losses, 45.0, 60.0) == 12 - 9


@pytest.mark.parametrize(("last_s", "missing"), [(100.0, 9), (99.9, 9 - 7)])
def test_a_bus_that_is_a_second_behind_another_is_no_clock_that_was_set_back(
    last_s: float, missing: int
) -> None:
    losses = _counted((100, 101, 5), (101, 101.5, 7), (99, last_s, 9))
    assert _missing(losses, 90.0, 102.0) == missing


def test_losses_of_longer_ago_than_a_run_and_a_second_are_forgotten() -> None:
    """Four seconds and one, before the block that came last but one."""
    blocks = [(second, second + 1, second + 1) for second in range(9)]
    assert _missing(_counted(*blocks), 0.0, 20.0) == 9 - 2
    assert _missing(_counted(*blocks[:-1]), 0.0, 20.0) == 8 - 1


def test_of_a_bus_whose_stamps_stand_still_20_000_blocks_are_kept() -> None:
    """No block of them grows old; half an hour at ten a second."""
    samples, losses = RecentSamples(kept_s=4.0), RecentLosses(kept_s=4.0)
    t_ns = np.array([S])
    for k in range(20_001):
        samples.add(S, {"acc": (t_ns, np.array([k]))})
        losses.add(S, S, Losses(counter_gaps=k))
    assert samples.between(0, 2 * S)["acc"][1].tolist() == list(range(1, 20_001))
    assert losses.between(0, 2 * S).counter_gaps == 20_000 - 1


# A recorder that was restarted measures its runs again from the journal ---------------------------

BENCH = replace(
    load_bench(None),
    campaign=Campaign((Excitation.BOUNCE,), 2, (BASELINE,), accept_after_s=0.0),
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
