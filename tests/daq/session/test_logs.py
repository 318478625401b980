"""Sessions of logs: what an import keeps, the labels of its bumps, and other databases."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Step
from daq.bench.config import Bench, parse_bench
from daq.bus.source import HopLosses
from daq.errors import InputError
from daq.journal.reader import HopCounts
from daq.runs import Event, Excitation, Losses, Run, RunStatus
from daq.session.from_frames import (
    Intake,
    LogPart,
    labelled,
    numbered,
    parse_runs,
    redecoded,
    with_steps,
)
from daq.sessions import Session
from dbc import FrameBatch

from ..small_campaign import START_NS, blocks, bumps, small_bench, small_codec
from .test_sensors_on_buses import imported


def _kept(pieces: list[FrameBatch]) -> FrameBatch:
    intake = Intake(small_bench(), small_codec())
    for piece in pieces:
        intake.take(piece, HopLosses())
    part = intake.part()
    more = replace(part, events=(*part.events, Event(START_NS, "bus_lost")))
    assert more.bumps == part.bumps == [event.code for event in part.events].count("bump")
    return part.frames


@pytest.mark.parametrize("size", [100, 450, 1650, 12_000])
def test_every_frame_around_a_bump_is_kept_whatever_the_blocks(size: int) -> None:
    # Bumps at 0.5, 1.7, 2.9 s...; blocks of 1,650 hold what one needs before it and the next.
    frames = bumps(small_codec(), 8)
    t_s = (frames.t_ns - START_NS) * 1e-9
    kept_s = (_kept(blocks(frames, size)).t_ns - START_NS) * 1e-9
    for bump_s in 0.5 + 1.2 * np.arange(8):
        near = (t_s > bump_s - 0.09) & (t_s < bump_s + 0.49)
        assert np.isin(t_s[near], kept_s).all()


def test_a_block_that_reaches_far_beyond_its_bump_loses_nothing_before_it() -> None:
    frames = bumps(small_codec(), 4)
    cut = 450  # between the pre-trigger of the first bump, from 0.4 s, and the bump at 0.5 s
    pieces = [frames.select(slice(0, cut)), frames.select(slice(cut, len(frames)))]
    kept = _kept(pieces)
    assert (kept.t_ns - START_NS).min() <= 0.41e9
    np.testing.assert_array_equal(kept.t_ns, _kept(blocks(frames)).t_ns)


# Labels of bumps ----------------------------------------------------------------------------------

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


# Sessions that are decoded again ------------------------------------------------------------------


def _bench(session: Session) -> Bench:
    said = session.provenance
    return parse_bench(said["bench_toml"], "bench.toml", Path("/nowhere"), said["dbc"])


def _with(**changes: Any) -> Session:
    return replace(imported(), runs=(replace(imported().runs[0], **changes),))


def _again(session: Session, **provenance: str) -> Session:
    return redecoded(session, _bench(imported()), "old.h5", provenance)


def _verdict(run: Run) -> tuple[str, tuple[str, ...]]:
    return run.status.value, run.reasons


def test_what_the_operator_decided_stays() -> None:
    was = _verdict(_again(imported()).runs[0])
    assert was == ("accepted", ())
    leaned = _with(status=RunStatus.REJECTED, reasons=("somebody leaned on the car",))
    assert _verdict(_again(leaned).runs[0]) == ("rejected", ("somebody leaned on the car",))
    silent = _with(status=RunStatus.REJECTED, reasons=())
    assert _verdict(_again(silent).runs[0]) == ("rejected", ())


def test_losses_before_the_session_are_kept_and_the_rest_is_counted_anew() -> None:
    lost = Losses(
        bus_dropped=1, bus_garbled=2, queue_dropped=3, counter_gaps=40, crc_bad=50, wrong_length=60
    )
    found = _again(_with(losses=lost)).runs[0].losses
    fresh = _again(imported()).runs[0].losses
    assert (found.bus_dropped, found.bus_garbled, found.queue_dropped) == (1, 2, 3)
    assert (found.counter_gaps, found.crc_bad, found.wrong_length) == (
        fresh.counter_gaps,
        fresh.crc_bad,
        fresh.wrong_length,
    )
    assert fresh.counter_gaps < 40


def test_the_new_session_says_where_it_comes_from() -> None:
    old = replace(imported(), provenance={**imported().provenance, "uuid": "7", "place": "hall"})
    new = _again(old, software="new")
    assert new.provenance["redecoded"] == "7"
    assert new.provenance["place"] == "hall"
    assert new.provenance["software"] == "new"
    assert new.provenance["dbc"] == imported().provenance["dbc"]
    assert new.provenance["uuid"] not in ("", "7")
    assert new.provenance["uuid"] == _again(old).provenance["uuid"]
    assert new.runs[0].events == old.runs[0].events
    other = replace(old, provenance={**old.provenance, "uuid": "8"})
    assert _again(other).provenance["uuid"] != new.provenance["uuid"]
    commented = parse_bench(
        f"# x\n{old.provenance['bench_toml']}",
        "bench.toml",
        Path("/nowhere"),
        old.provenance["dbc"],
    )
    again = redecoded(old, commented, "old.h5", {}).provenance
    assert again["uuid"] != new.provenance["uuid"]
    assert again["bench_toml"].startswith("# x")


def test_a_run_without_raw_frames_is_refused_and_named() -> None:
    label = imported().runs[0].label
    with pytest.raises(InputError, match=f"{label} has no raw frames") as refused:
        _again(_with(frames=FrameBatch.empty()))
    assert refused.value.where == "old.h5"


def test_a_run_that_does_not_state_when_its_bump_was_is_refused() -> None:
    run = imported().runs[0]
    bump = next(event for event in run.events if event.text == run.label)
    others = (Event(bump.t_ns, "note", 1.0, run.label), replace(bump, text="baseline_roll_9"))
    with pytest.raises(InputError, match=run.label):
        _again(_with(events=others))
    assert _again(_with(events=(*others, bump))).runs[0].t0_ns == run.t0_ns
