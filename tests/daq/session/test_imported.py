"""Runs are cut from logs and from columns of other tools, and decoded again; two like sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from daq.bench.campaign import Step, numbered
from daq.bench.channel_map import ChannelMap, load_channel_map
from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.sensors import stored_databases
from daq.bus.source import HopLosses
from daq.journal.reader import HopCounts
from daq.journal.segment import JournalHead
from daq.journal.writer import JournalWriter
from daq.runs import Event, Excitation, Losses, Run, RunStatus, SampleGroup
from daq.samples.mapping import Column, Columns
from daq.session import read_session, write_session
from daq.session.build import derive
from daq.session.from_columns import Recording, bumps_in, given_run, recording, session_from_columns
from daq.session.from_frames import (
    Intake,
    LogPart,
    labelled,
    parse_runs,
    redecoded,
    require_mass_states,
    session_from_parts,
)
from daq.sessions import Session
from daq.sim.car import SimulatedCar
from daq.sim.ecu import campaign_frames
from dbc import FrameBatch
from dbc.units import G_M_S2
from dbc.words import InputError

from ..sensor_bench import sensor_bench
from ..small_campaign import START_NS, blocks, bumps, small_bench, small_codec


def _kept(pieces: list[FrameBatch]) -> FrameBatch:
    intake = Intake(small_bench(), small_codec())
    for piece in pieces:
        intake.take(piece, HopLosses())
    part = intake.part()
    more = replace(part, events=(*part.events, Event(START_NS, "bus_lost")))
    assert more.bumps == part.bumps == [event.code for event in part.events].count("bump")
    return part.frames


@pytest.mark.parametrize("size", [100, 1650])
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


def _texts(parts: tuple[LogPart, ...]) -> str:
    return ", ".join(f"{event.code} {event.text}" for part in parts for event in part.events)


@pytest.mark.parametrize(
    ("skip", "texts"),
    [
        (
            0,
            "bump baseline_bounce_1, alarm as found, run_end baseline_bounce_1, "
            "bump baseline_roll_1, unplanned_bump , unplanned_run_end ",
        ),
        (
            1,
            "unplanned_bump , alarm as found, unplanned_run_end , "
            "bump baseline_bounce_1, bump baseline_roll_1, run_end baseline_roll_1",
        ),
    ],
)
def test_bumps_get_the_steps_in_their_order(skip: int, texts: str) -> None:
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


def test_a_step_is_of_a_mass_state_of_the_bench() -> None:
    require_mass_states(small_bench(), [R1, B2])
    with pytest.raises(InputError, match="'moon' is not on this bench"):
        require_mass_states(small_bench(), [Step("moon", Excitation.ROLL, 1)])


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
    assert found == replace(fresh, bus_dropped=1, bus_garbled=2, queue_dropped=3)
    assert fresh.counter_gaps < 40


def test_the_new_session_says_where_it_comes_from() -> None:
    old = replace(imported(), provenance={**imported().provenance, "uuid": "7", "place": "hall"})
    new = _again(old, software="new")
    assert new.provenance["redecoded"] == "7"
    assert new.provenance["place"] == "hall"
    assert new.provenance["software"] == "new"
    assert new.provenance["dbc"] == imported().provenance["dbc"]
    assert new.provenance["uuid"] not in ("", "7")
    assert new.runs[0].events == old.runs[0].events
    text = f"# x\n{old.provenance['bench_toml']}"
    commented = parse_bench(text, "bench.toml", Path("/nowhere"), old.provenance["dbc"])
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


# Columns to channels and runs: clocks, units, which samples belong toge ---------------------------


nan = float("nan")
S = 1_000_000_000
T0_S = 1_780_221_600


@cache
def _map(text: str = "", channels: tuple[str, ...] = ("fl",)) -> ChannelMap:
    """Return a map with an acceleration of each hub that is named."""
    parts = [text]
    for name in channels:
        parts.append(f'[[channel]]\nname = "{name}"\nsignal = "{name}"\n')
        parts.append(f'quantity = "hub_acceleration"\ncorner = "{name.upper()}"\n')
    with TemporaryDirectory() as folder:
        path = Path(folder) / "map.toml"
        path.write_text("".join(parts))
        return load_channel_map(path)


def _file(
    columns: Mapping[str, Any],
    *,
    times_s: Mapping[str, Any] | None = None,
    start_ns: int = 0,
    clocks: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> Columns:
    held = {
        name: Column(
            name,
            (units or {}).get(name, "" if name.startswith("t") else "m/s2"),
            (clocks or {}).get(name, "table"),
            np.asarray(values),
        )
        for name, values in columns.items()
    }
    own = {name: np.asarray(values, float) for name, values in (times_s or {}).items()}
    return Columns("a.csv", start_ns, held, own)


BY_COLUMN = '[time]\ncolumn = "t"\n'


def _times(values: Any, unit: str = "", stated: str = "") -> tuple[int, list[float]]:
    """Return the zero and the times of a channel whose times are these."""
    text = BY_COLUMN + (f'unit = "{stated}"\n' if stated else "")
    file = _file({"t": values, "fl": np.zeros(len(values))}, units={"t": unit, "fl": "m/s2"})
    found = recording(_map(text), file)
    return found.start_ns, found.groups[0].time_s.tolist()


def test_times_of_a_column_and_of_a_dated_file_count_from_one_zero() -> None:
    text = '[[channel]]\nname = "rl"\nsignal = "rl"\nquantity = "unused"\ntime_column = "t"\n'
    columns = {"fl": [0, 0], "rl": [0, 0], "t": [T0_S + 1.25, T0_S + 2]}
    file = _file(columns, times_s={"table": [0, 1]}, start_ns=T0_S * S + S // 2)
    groups = recording(_map(text), file).groups
    assert [group.time_s.tolist() for group in groups] == [[0.25, 1.0], [-0.5, 0.5]]


@pytest.mark.parametrize(
    ("values", "unit", "stated", "start_ns", "times_s"),
    [
        ([0.5, 1.5], "", "", 0, [0.5, 1.5]),
        ([500, 1500], "ms", "", 0, [0.5, 1.5]),
        ([500, 1500], "ms", "us", 0, [0.0005, 0.0015]),
        ([99_999_999.5, 99_999_999.75], "s", "", 0, [99_999_999.5, 99_999_999.75]),
        ([100_000_000.0, 100_000_000.5], "s", "", 100_000_000 * S, [0.0, 0.5]),
        ([T0_S + 0.25, T0_S + 1.5], "", "", T0_S * S, [0.25, 1.5]),
        ([nan, T0_S + 0.25], "", "", T0_S * S, [0.25]),
        (np.array([T0_S * S + 250, T0_S * S + S]), "ns", "", T0_S * S, [250e-9, 1.0]),
        (np.array([T0_S * 1000 + 250], "i8"), "", "ms", T0_S * S, [0.25]),
        ([nan, 0.5], "", "", 0, [0.5]),
    ],
)
def test_times_of_a_column(
    values: Any, unit: str, stated: str, start_ns: int, times_s: list[float]
) -> None:
    found_ns, found_s = _times(np.asarray(values), unit, stated)
    assert found_ns == start_ns
    assert_allclose(found_s, times_s, rtol=1e-15, atol=1e-12)


def _groups(fl: Any, fr: Any) -> list[SampleGroup]:
    file = _file({"fl": fl, "fr": fr}, times_s={"table": np.arange(len(fl))})
    return list(recording(_map("", ("fl", "fr")), file).groups)


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_channels_that_have_values_in_the_same_rows_are_one_group(missing: int) -> None:
    holed = np.where(np.arange(10) < missing, nan, 1.0)
    for pair in ((np.ones(10), holed), (holed, np.ones(10))):
        groups = _groups(*pair)
        names = [group.name for group in groups]
        assert names == (["table fl", "table fr"] if missing > 1 else ["table"])
        found = [v for group in groups for v in group.values.values()]
        assert [np.isfinite(v).sum() for v in found] == [np.isfinite(v).sum() for v in pair]
        assert {int(group.quality[0]) for group in groups} == {32 if missing == 1 else 0}
    (group,) = _groups(holed, holed)
    assert group.time_s.tolist() == list(range(missing, 10))


STEP = Step("baseline", Excitation.ROLL, 2)


def _found(rate_hz: float = 10.0, length_s: float = 10.0, start_ns: int = T0_S * S) -> Recording:
    time_s = np.arange(round(rate_hz * length_s)) / rate_hz
    file = _file({"fl": time_s * 2}, times_s={"table": time_s}, start_ns=start_ns)
    return recording(_map(), file)


@pytest.mark.parametrize(
    ("start_s", "stop_s", "good"),
    [
        (0.0, 10.0, True),
        (-0.99, 5.0, True),  # ten samples of 0.1 s
        (-1.01, 5.0, False),
        (5.0, 10.89, True),  # the last sample is at 9.9 s
        (5.0, 10.91, False),
    ],
)
def test_a_run_is_covered_by_its_samples(start_s: float, stop_s: float, good: bool) -> None:
    run = given_run(_map(), _found(), STEP, start_s, stop_s)
    assert run.status is (RunStatus.ACCEPTED if good else RunStatus.REJECTED)
    assert len(run.reasons) == (0 if good else 1)


@pytest.mark.parametrize("times_s", [[0.0, 1.0, 1.0], [0.0, 2.0, 1.0]])
def test_times_that_do_not_increase_are_refused(times_s: list[float]) -> None:
    with pytest.raises(InputError, match="do not increase"):
        recording(_map(), _file({"fl": [1.0] * 3}, times_s={"table": times_s}))
    # Rows in which nothing was sampled do not matter.
    holed = _file({"fl": [1.0, nan, 2.0]}, times_s={"table": [0.0, 9.0, 1.0]})
    assert recording(_map(), holed).groups[0].time_s.tolist() == [0.0, 1.0]


def test_a_run_is_the_window_that_is_given() -> None:
    run = given_run(_map(), _found(), STEP, 2.0, 4.0)
    assert (run.label, run.status, run.reasons) == ("baseline_roll_2", RunStatus.ACCEPTED, ())
    assert run.t0_ns == (T0_S + 2) * S
    (group,) = run.groups
    assert_allclose(group.time_s, np.arange(20) / 10, atol=1e-12)
    assert_allclose(group.values["fl"], 4.0 + np.arange(20) / 5)
    assert_array_equal(group.t_ns, (T0_S + 2) * S + np.arange(20) * 100_000_000)


def test_a_run_without_samples_is_rejected_and_says_of_what() -> None:
    none = given_run(_map(), _found(), STEP, 20.0, 21.0)
    assert (none.status, none.groups) == (RunStatus.REJECTED, ())
    assert none.reasons == ("table has 0 samples",)
    one = given_run(_map(), _found(), STEP, 2.0, 2.05)
    assert one.reasons == ("table has 1 sample",)
    two = given_run(_map(), _found(), STEP, 2.0, 2.15)
    assert two.status is RunStatus.ACCEPTED
    known = _map("", ("fl", "fr"))
    for n, reason in ((0, "fr has no value"), (18, "fr has 0 samples")):  # 18: one group with fl
        columns = {"fl": range(20), "fr": [*range(n), *[nan] * (20 - n)]}
        found = recording(known, _file(columns, times_s={"table": np.arange(20) / 10}))
        assert given_run(known, found, STEP, 1.8, 2.0).reasons == (reason,)


TRIGGER = (
    "[campaign]\nbump_s = 0.3\n[trigger]\nlevel = 3.0\npre_s = 0.5\npost_s = 1.5\nrest_s = 0.2\n"
)


def test_bumps_are_found_in_groups_that_begin_at_different_times() -> None:
    time_s = np.arange(4000) / 500.0
    value = np.where((time_s >= 3.0) & (time_s < 3.2), 20.0, 0.0)
    # The second channel begins five seconds later, after a second in which neither is sampled.
    file = _file(
        {"fl": value[:2000], "fr": value},
        times_s={"a": time_s[:2000], "b": time_s + 5.0},
        clocks={"fl": "a", "fr": "b"},
        start_ns=T0_S * S,
    )
    known = _map(TRIGGER, ("fl", "fr"))
    bumps = bumps_in(known, recording(known, file))
    assert [bump.t_ns for bump in bumps] == [(T0_S + 3) * S, (T0_S + 8) * S]


def test_the_same_files_give_a_session_of_the_same_name() -> None:
    known, found = _map(), _found()
    runs = [given_run(known, found, STEP, 2.0, 4.0)]
    one = session_from_columns(known, found.channels, runs, {"software": "x"}).provenance
    assert one == session_from_columns(known, found.channels, runs, {"software": "x"}).provenance
    assert one["created"] == "2026-05-31T10:00:02+00:00"
    assert (one["software"], one["channel_map"]) == ("x", known.text)
    group = replace(runs[0].groups[0], values={"fl": runs[0].groups[0].values["fl"] * 2})
    changed = [replace(runs[0], groups=(group,))]
    found_uuid = session_from_columns(known, found.channels, changed, {}).provenance["uuid"]
    assert found_uuid != one["uuid"]
    assert session_from_columns(known, (), [], {}).provenance["created"].startswith("1970-01-01")


# Two like IMUs on two buses, one of them upside down, through every way ---------------------------


@cache
def frames() -> FrameBatch:
    """Return the frames of one bounce, on both buses."""
    return next(
        campaign_frames(sensor_bench(), bench_codec(sensor_bench()), SimulatedCar(), 1, START_NS)
    )


@cache
def imported() -> Session:
    bench = sensor_bench()
    codec = bench_codec(bench)
    intake = Intake(bench, codec)
    intake.take(frames(), HopLosses())
    parts = labelled([intake.part()], bench.campaign.steps, 0)
    return session_from_parts(bench, codec, parts, {})


def level(session: Session, channel: str) -> float:
    """Return the mean of a channel before the bump, SI."""
    run = session.runs[0]
    (group,) = (group for group in run.groups if channel in group.values)
    return float(np.mean(group.values[channel][group.time_s < run.bump_s - 0.1]))


def test_a_session_has_each_sensor_for_itself(tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    write_session(path, imported())
    session = read_session(path)
    assert level(session, "acc_a") == pytest.approx(G_M_S2, abs=0.2)
    assert level(session, "acc_b") == pytest.approx(G_M_S2, abs=0.2)  # by its sign
    assert {group.name for group in session.runs[0].groups} == {
        "imu_a_Accel", "imu_a_Rate", "imu_b_Accel", "imu_b_Rate", "hubs_Accel",
        "pot_fl_TPDO1", "pot_fr_TPDO1", "pot_rl_TPDO1", "pot_rr_TPDO1",
    }  # fmt: skip
    assert len(stored_databases(session.provenance["dbc"])) == 3
    again = redecoded(session, _bench(session), str(path), {})
    assert level(again, "acc_b") == level(session, "acc_b")
    np.testing.assert_array_equal(again.runs[0].frames.bus, session.runs[0].frames.bus)


def test_a_journal_needs_nothing_else(tmp_path: Path) -> None:
    bench = sensor_bench()
    head = JournalHead(bench.text, bench.dbc_text, "test", START_NS, 5)
    with JournalWriter(tmp_path, head) as journal:
        journal.append(frames(), HopLosses())
        journal.append_events(list(imported().runs[0].events))
    derive(journal.paths, tmp_path / "session.h5")
    session = read_session(tmp_path / "session.h5")
    for name in ("acc_a", "acc_b", "pot_rr", "hub_fl"):
        assert level(session, name) == level(imported(), name)
