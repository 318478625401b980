"""Labels of the runs of a log, the frames an import keeps, and the place where a log goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Step
from daq.bus.source import HopLosses
from daq.derive.from_logs import (
    Intake,
    LogPart,
    labelled,
    numbered,
    parse_runs,
    with_steps,
)
from daq.errors import InputError
from daq.journal.contents import HopCounts
from daq.runs import Event, Excitation
from dbc import FrameBatch

from ..small_campaign import START_NS, bumps, small_bench, small_codec

B1 = Step("baseline", Excitation.BOUNCE, 1)
R1 = Step("baseline", Excitation.ROLL, 1)
NO_HOPS = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))


def _part(*codes: str) -> LogPart:
    events = tuple(Event(n, code, 1.0, "as found") for n, code in enumerate(codes))
    return LogPart(FrameBatch.empty(), events, NO_HOPS, 0)


def _texts(parts: tuple[LogPart, ...]) -> list[str]:
    return [f"{event.code} {event.text}" for part in parts for event in part.events]


@pytest.mark.parametrize(
    ("skip", "texts"),
    [
        (
            0,
            [
                "bump baseline_bounce_1",
                "alarm as found",
                "run_end baseline_bounce_1",
                "bump baseline_roll_1",
                "unplanned_bump ",
                "unplanned_run_end ",
            ],
        ),
        (
            1,
            [
                "unplanned_bump ",
                "alarm as found",
                "unplanned_run_end ",
                "bump baseline_bounce_1",
                "bump baseline_roll_1",
                "run_end baseline_roll_1",
            ],
        ),
    ],
)
def test_bumps_get_the_steps_in_their_order(skip: int, texts: list[str]) -> None:
    parts = [_part("bump", "alarm", "run_end", "bump"), _part("bump", "run_end")]
    assert _texts(labelled(parts, [B1, R1], skip)) == texts
    assert [part.bumps for part in parts] == [2, 1]


def _frame(t_ns: int) -> FrameBatch:
    whole = bumps(small_codec(), 1).select(slice(0, 1))
    return replace(whole, t_ns=np.array([t_ns]))


@pytest.mark.parametrize(
    ("gap_ns", "goes_on"),
    [(0, True), (1, True), (999_999_999, True), (1_000_000_000, False), (-1, False)],
)
def test_a_log_goes_on_with_the_one_before_within_a_second(gap_ns: int, goes_on: bool) -> None:
    intake = Intake(small_bench(), small_codec())
    assert intake.goes_on_with(_frame(START_NS))
    intake.take(_frame(START_NS), HopLosses())
    assert intake.goes_on_with(_frame(START_NS + gap_ns)) is goes_on


B2 = Step("baseline", Excitation.BOUNCE, 2)


@pytest.mark.parametrize("text", ["", "baseline", "baseline:jump", "baseline:bounce:1", "a:roll,"])
def test_what_is_no_run(text: str) -> None:
    with pytest.raises(InputError, match="is not a run"):
        parse_runs(text)


def test_a_bench_gets_the_campaign_of_the_steps_if_its_own_lacks_one() -> None:
    bench = replace(small_bench(), campaign=Campaign((Excitation.BOUNCE,), 2, ("baseline",)))
    assert with_steps(bench, [B2, B1]) is bench
    wider = with_steps(bench, [R1, B2])
    assert wider.campaign.excitations == (Excitation.ROLL, Excitation.BOUNCE)
    assert (wider.campaign.repeats, wider.campaign.mass_states) == (2, ("baseline",))
    with pytest.raises(InputError, match="'moon' is not on this bench"):
        with_steps(bench, [Step("moon", Excitation.ROLL, 1)])


def test_repeats_are_counted_in_the_order_of_the_list() -> None:
    assert parse_runs("baseline:bounce, baseline:roll,baseline:bounce") == (B1, R1, B2)
    added = Step("added", Excitation.BOUNCE, 1)
    assert parse_runs("baseline:bounce,added:bounce") == (B1, added)
    assert numbered([]) == ()
