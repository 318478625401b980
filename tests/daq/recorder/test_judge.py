"""Which samples, losses and earlier runs a run is judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Step
from daq.bench.config import Bench
from daq.recorder import judging
from daq.recorder.judging import Judge
from daq.runlog.run_log import LoggedRun, LoggedStatus, RunLog
from daq.runs import BASELINE, Excitation, Losses
from daq.samples.mapping import SampleBlock
from daq.verdict import RunMeasure, RunWindow
from dbc import Codec
from dbc.finding import Finding, Severity

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
