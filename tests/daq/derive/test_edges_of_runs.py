"""Limits of a run: how much of it may be missing, and its events."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.derive.build_samples import build_session
from daq.runs import Event, RunStatus

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
