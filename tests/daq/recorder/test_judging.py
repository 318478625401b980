"""Which frames, samples, losses and earlier runs a run is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Step
from daq.bench.config import Bench
from daq.recorder import recording as judging
from daq.recorder.recording import Judge, LiveRing, Recent
from daq.runlog import LoggedRun, RunLog
from daq.runs import BASELINE, Excitation, Losses, RunStatus
from daq.verdict.window import RunMeasure, RunWindow
from dbc import Codec, FrameBatch
from dbc.words import Finding, Severity

from ..crash_frames import block

S = 1_000_000_000
BUMP_NS = 1_800_000_000 * S
STEP = Step(BASELINE, Excitation.ROLL, 4)


def at(*times_s: float) -> FrameBatch:
    return replace(block(0, len(times_s)), t_ns=np.rint(np.array(times_s) * S).astype(np.int64))


def add(recent: Recent, *times_s: float, missing: int = 0) -> None:
    frames = at(*times_s)
    recent.add(frames, {"acc": (frames.t_ns, frames.t_ns / S)}, Losses(counter_gaps=missing))


def held(recent: Recent) -> list[float]:
    """Return the times of all samples that are kept, s."""
    samples = recent.samples(-(10**18), 10**18)
    return samples["acc"][1].tolist() if samples else []


def missing(recent: Recent, start_s: float, stop_s: float) -> int:
    return recent.losses(round(start_s * S), round(stop_s * S)).counter_gaps


def test_blocks_are_kept_for_a_second_longer_than_a_run_or_a_check() -> None:
    for kept_s, longest_s in ((4.0, 10.0), (20.0, 20.0)):
        recent = Recent(kept_s)
        assert len(recent.frames(10.0)) == 0
        for t_s in (100.0, 101.0 + longest_s, 101.1 + longest_s):
            add(recent, t_s)
        assert held(recent)[0] == 100.0  # by the block that came last but one
        add(recent, 101.2 + longest_s)
        assert held(recent)[0] == 101.0 + longest_s
        assert len(recent.frames(0.1)) == 2
        assert len(recent.frames(10.0)) == 3


def test_a_run_is_whole_when_a_pause_of_the_bus_follows() -> None:
    recent = Recent(4.0)
    for t_s in (0.0, 1.0, 2.0, 40.0):
        add(recent, t_s)
    assert held(recent) == [0.0, 1.0, 2.0, 40.0]  # the run ends at the first block after it
    add(recent, 41.0)
    assert held(recent) == [40.0, 41.0]


@pytest.mark.parametrize(("back_s", "kept"), [(1.0, 3), (1.1, 1)])
def test_blocks_go_if_a_clock_was_set_back_by_more_than_a_second(back_s: float, kept: int) -> None:
    recent = Recent(4.0)
    for t_s in (50.0, 51.0, 51.0 - back_s):
        add(recent, t_s)
    assert len(held(recent)) == kept


def test_of_a_bus_whose_stamps_stand_still_the_memory_is_bounded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(judging, "BLOCKS_PER_S", 1)
    recent = Recent(4.0)
    for _ in range(20):
        add(recent, 1.0)
    assert len(held(recent)) == 10


def test_a_span_has_the_losses_of_the_blocks_in_it() -> None:
    recent = Recent(4.0)
    for second, lost in enumerate((5, 7, 10, 14, 19)):
        add(recent, second + 0.1, second + 0.9, missing=lost)
    assert [missing(recent, k + 0.5, k + 1.5) for k in range(1, 4)] == [2 + 3, 3 + 4, 4 + 5]
    assert missing(recent, 0.0, 9.0) == 19
    assert missing(recent, 20.0, 30.0) == 0


def test_what_a_pause_of_the_bus_cost_is_not_lost_from_the_run_before_it() -> None:
    recent = Recent(4.0)
    for second, lost in ((0, 1), (1, 3), (2, 6), (63, 60_006)):
        add(recent, second, second + 0.9, missing=lost)
    assert missing(recent, 1.0, 3.5) == 5
    assert missing(recent, 1.0, 63.5) == 60_005


# The judge ----------------------------------------------------------------------------------------


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
        return (), RunMeasure(peaks={"hub": 9.0})


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> Seen:
    seen = Seen()
    monkeypatch.setattr(judging, "judge", seen.judge)
    return seen


def fed(bench: Bench, codec: Codec, measures: dict[str, RunMeasure] | None = None) -> Judge:
    """Return a judge that has seen 3 s of samples, ten a second, and a loss in each."""
    recent = Recent(1.0)
    for tenth in range(-20, 10):
        frames = replace(block(0, 1), t_ns=np.array([BUMP_NS + tenth * S // 10]))
        samples = {"hub": (frames.t_ns, np.array([tenth / 10]))}
        recent.add(frames, samples, Losses(crc_bad=tenth + 30))
    return Judge(bench, codec, recent, measures if measures is not None else {})


def test_a_run_is_judged_by_its_own_time(bench: Bench, codec: Codec, seen: Seen) -> None:
    """0.1 s before the bump and 0.5 s after it are kept of this bench."""
    assert (bench.trigger.pre_s, bench.trigger.post_s) == (0.1, 0.5)
    measures: dict[str, RunMeasure] = {}
    fed(bench, codec, measures).verdict(STEP, BUMP_NS, RunLog())
    assert seen.window.bump_ns == BUMP_NS
    assert seen.window.channels["hub"][1].tolist() == [-0.1, 0.0, 0.1, 0.2, 0.3, 0.4]
    assert seen.window.losses.crc_bad == 6  # all after the block at -0.2 s
    assert measures == {"baseline_roll_4": RunMeasure(peaks={"hub": 9.0})}


@pytest.mark.parametrize(("at_ns", "counts"), [(BUMP_NS - 1, False), (BUMP_NS, True)])
def test_a_sensor_at_its_end_counts_from_the_bump_on(
    bench: Bench, codec: Codec, seen: Seen, at_ns: int, counts: bool
) -> None:
    judge = fed(bench, codec)
    judge.saturated |= {"hub": BUMP_NS - S, "other": BUMP_NS - S}
    judge.saturated |= {"hub": at_ns}
    judge.verdict(STEP, BUMP_NS, RunLog())
    assert seen.window.saturated == ("hub",) * counts


def test_a_run_is_compared_with_those_of_its_kind_that_count(
    bench: Bench, codec: Codec, seen: Seen
) -> None:
    def run(label: str, *codes: str, by: str = "", kind: Excitation = Excitation.ROLL) -> LoggedRun:
        findings = tuple(Finding(code, Severity.ERROR, code) for code in codes)
        status = RunStatus.REJECTED if codes else RunStatus.ACCEPTED
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
    measures = {r.label: RunMeasure(peaks={"hub": float(n)}) for n, r in enumerate(runs[:-1])}
    fed(bench, codec, measures).verdict(STEP, BUMP_NS, RunLog(runs))
    assert [m.peaks["hub"] for m in seen.accepted] == [0.0]
    assert [m.peaks["hub"] for m in seen.unlike] == [1.0]


# The envelope of the newest samples ---------------------------------------------------------------


def ring_of(*blocks: tuple[Sequence[float], Sequence[float]]) -> LiveRing:
    ring = LiveRing(["acc"])
    for times_s, values in blocks:
        t_ns = np.rint(np.array(times_s) * S).astype(np.int64)
        ring.add({"acc": (t_ns, np.array(values, float))})
    return ring


def test_a_bin_has_lowest_and_highest_value_of_20_ms() -> None:
    live = ring_of(([0.0, 0.019, 0.02, 0.2], [1.0, 3.0, 5.0, 0.0])).fresh()
    assert live is not None
    assert (live.first_bin, live.bin_s) == (0, 0.02)
    assert live.lanes[0].low[:3] == (1.0, 5.0, None)
    assert live.lanes[0].high[:3] == (3.0, 5.0, None)


def test_a_bin_is_published_once_when_100_ms_older_than_the_newest() -> None:
    assert ring_of(([0.0, 0.09], [1.0, 2.0])).fresh() is None  # the newest bin is 4
    ring = ring_of(([0.0, 0.11], [1.0, 2.0]))  # 5: bin 0 is complete
    live = ring.fresh()
    assert live is not None
    assert live.lanes[0].low == (1.0,)
    assert ring.fresh() is None


def test_at_most_ten_seconds_are_published_at_once() -> None:
    live = ring_of(([0.0, 30.0, 59.99], [1.0, 2.0, 3.0])).fresh()
    assert live is not None
    assert (live.first_bin, len(live.lanes[0].low)) == (2500, 495)


def test_values_are_rounded_to_four_digits_and_those_that_are_not_finite_left_out() -> None:
    values = [1.23456, np.nan, np.inf, -0.000123456, 0.0]
    live = ring_of(([0.0, 0.02, 0.04, 0.06, 0.3], values)).fresh()
    assert live is not None
    assert live.lanes[0].low[:4] == (1.235, None, None, -0.0001235)


def test_a_clock_set_by_more_than_ten_seconds_restarts_the_ring() -> None:
    for first_s, later_s in ((100.0, 200.0), (200.0, 100.0)):
        ring = ring_of(([first_s], [1.0]), ([later_s, later_s + 0.2], [2.0, 3.0]))
        live = ring.fresh()
        assert live is not None
        assert live.first_bin == later_s / 0.02
        assert live.lanes[0].low[:2] == (2.0, None)
