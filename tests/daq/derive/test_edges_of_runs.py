"""Limits of a run: how much of it may be missing, its events, when it is measured again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from daq.derive.build_samples import build_session, frames_digest
from daq.derive.grown import (
    Grown,
    GrownRun,
    forget_grown,
    forget_others,
    growing_path,
    inputs_digest,
    load_grown,
    note_grown,
)
from daq.journal.scan import SegmentInfo
from daq.runlog.fold import fold
from daq.runlog.runlog import Code, LoggedRun
from daq.runs import Event, Excitation, Losses, RunOutline, RunStatus

from ..small_campaign import START_NS
from .test_build import (
    ACC_FL,
    BUMP,
    CODEC,
    NO_HOPS,
    PITCH,
    RUN_END,
    _bench,
    _frames,
    _merge,
    _run,
)

MS = 1_000_000
BEGAN, ENDED = BUMP.t_ns - 100 * MS, BUMP.t_ns + 500 * MS


@pytest.mark.parametrize(("n", "good"), [(1452, True), (1449, False)])
def test_a_recording_may_end_50_ms_before_the_run(n: int, good: bool) -> None:
    run = _run(_bench(ACC_FL), _frames(CODEC, "HUB_Front", n))
    assert run.status is (RunStatus.ACCEPTED if good else RunStatus.REJECTED)
    assert [reason.split(" before")[0] for reason in run.reasons] == (
        [] if good else ["the recording ended 0.05 s"]
    )


@pytest.mark.parametrize(
    ("first", "stop", "good"),
    [
        (476, 2000, True),  # from 0.052 s on: 50 ms and two periods of 2 ms are allowed
        (478, 2000, False),
        (0, 725, True),  # to 0.548 s of 0.6 s
        (0, 723, False),
    ],
)
def test_a_message_may_begin_and_end_50_ms_and_two_periods_within_the_run(
    first: int, stop: int, good: bool
) -> None:
    rate = _frames(CODEC, "IMU_Rate").select(slice(first, stop))
    run = _run(_bench(ACC_FL, PITCH), _merge(_frames(CODEC, "HUB_Front"), rate))
    assert run.status is (RunStatus.ACCEPTED if good else RunStatus.REJECTED)
    assert len(run.reasons) == (0 if good else 1)


def test_a_run_reaches_from_before_its_bump_to_after_it() -> None:
    bench = _bench(ACC_FL)
    (logged,) = fold((BUMP, RUN_END)).runs
    assert bench.trigger.window_ns(logged.t_ns) == (BEGAN, ENDED)


def test_events_within_a_run_are_kept_and_long_texts_cut() -> None:
    kept = [
        Event(BEGAN, "alarm", 1.0, "first"),
        Event(BUMP.t_ns, "alarm", 2.0, "ä" * 80),
        Event(ENDED, "alarm", 3.0, "last"),
    ]
    long = Event(BUMP.t_ns + 1, "alarm", 4.0, "ä" * 80 + "b")
    others = [
        Event(BEGAN - 1, "alarm", 5.0, "before"),
        Event(ENDED + 1, "alarm", 6.0, "after"),
    ]
    frames = _frames(CODEC, "HUB_Front")
    events = (BUMP, RUN_END, *kept, long, *others)
    run = build_session(_bench(ACC_FL), CODEC, frames, events, NO_HOPS, {}).runs[0]
    short = replace(long, text="ä" * 78 + "...")
    assert sorted(run.events, key=lambda event: event.value) == (
        sorted((RUN_END, *kept, short, BUMP), key=lambda event: event.value)
    )


def test_the_digest_of_a_run_is_that_of_its_frames() -> None:
    run = _run(_bench(ACC_FL), _frames(CODEC, "HUB_Front"))
    later = replace(run, frames=replace(run.frames, t_ns=run.frames.t_ns + 1))
    data = run.frames.data.copy()
    data[3, 3] ^= 1
    changed = replace(run, frames=replace(run.frames, data=data))
    assert len({frames_digest(each) for each in (run, later, changed)}) == 3
    assert frames_digest(replace(run, repeat=9)) == frames_digest(run)


ROW = GrownRun(
    BUMP.t_ns,
    "digest",
    RunOutline("baseline_bounce_1", RunStatus.ACCEPTED, (), {"g": 3}, 1.5, 7, Losses(crc_bad=2)),
)
RUN = LoggedRun("baseline_bounce_1", "baseline", Excitation.BOUNCE, 1, BUMP.t_ns)
NEXT = LoggedRun("baseline_bounce_2", "baseline", Excitation.BOUNCE, 2, BUMP.t_ns + 10**9)


def _info(stop: int, first_ns: int, frames: int = 5, *events: tuple[int, Event]) -> SegmentInfo:
    last_ns = first_ns + 1000
    path = Path("journal_0001.mcap")
    return SegmentInfo(
        path, "r", 1, 1, 100, 0, stop, frames, first_ns, last_ns, tuple(events), sealed=True
    )


def _grown(folder: Path) -> Path:
    target = folder / "session_0001.h5"
    growing_path(target).write_bytes(b"12345")
    note_grown(target, Grown("inputs", (ROW,), 10, ENDED))
    return target


def test_a_growing_file_is_used_as_it_was_left(tmp_path: Path) -> None:
    target = _grown(tmp_path)
    found = load_grown(target, "inputs", [RUN, NEXT], [_info(10, START_NS)])
    assert (found.runs, found.stop, found.stop_ns, found.bytes) == ((ROW,), 10, ENDED, 5)


@pytest.mark.parametrize(
    ("runs", "info", "used"),
    [
        ([RUN], _info(10, START_NS), True),
        ([], _info(10, START_NS), False),
        ([replace(RUN, t_ns=RUN.t_ns + 1)], _info(10, START_NS), False),
        ([replace(RUN, label="baseline_bounce_9")], _info(10, START_NS), False),
        # Frames that came since: in the time of the runs, or after it, or none at all.
        ([RUN], _info(11, ENDED - 1), False),
        ([RUN], _info(11, ENDED), True),
        ([RUN], _info(11, ENDED - 1, 0), True),
        ([RUN], _info(10, ENDED - 1), True),
        # Events that came since.
        ([RUN], _info(10, START_NS, 5, (10, Event(ENDED, "alarm"))), False),
        ([RUN], _info(10, START_NS, 5, (10, Event(ENDED + 1, "alarm"))), True),
        ([RUN], _info(10, START_NS, 5, (9, Event(ENDED, "alarm"))), True),
        ([RUN], _info(10, START_NS, 5, (10, Event(ENDED, Code.NOTE))), True),
        ([RUN], _info(10, START_NS, 5, (10, Event(ENDED, Code.VERDICT))), True),
    ],
)
def test_runs_are_measured_again_if_anything_of_them_came_since(
    tmp_path: Path, runs: list[LoggedRun], info: SegmentInfo, used: bool
) -> None:
    found = load_grown(_grown(tmp_path), "inputs", runs, [info])
    assert found.runs == ((ROW,) if used else ())
    assert found.inputs == "inputs"


def test_a_growing_file_of_another_bench_or_size_is_not_used(tmp_path: Path) -> None:
    target = _grown(tmp_path)
    assert not load_grown(target, "others", [RUN], []).runs
    assert load_grown(target, "inputs", [RUN], []).runs
    growing_path(target).write_bytes(b"123456")
    assert not load_grown(target, "inputs", [RUN], []).runs
    assert inputs_digest("a", "b") != inputs_digest("ab", "")
    assert inputs_digest("a", "b") == inputs_digest("a", "b")
    assert len(inputs_digest("\udce9", "")) == 64


def test_growing_files_are_forgotten(tmp_path: Path) -> None:
    target = _grown(tmp_path)
    other = tmp_path / ".session_0002.h5.growing"
    other.write_bytes(b"")
    forget_others(tmp_path, [target])
    assert not other.exists()
    assert load_grown(target, "inputs", [RUN], []).runs
    forget_grown(target)
    assert growing_path(target).exists()
    assert not load_grown(target, "inputs", [RUN], []).runs
    forget_grown(target, file=True)
    assert not list(tmp_path.iterdir())
