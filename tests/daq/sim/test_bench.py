"""The simulated bench as a bus: bumped as the recorder waits, one run spoilt on request."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import takewhile

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Method
from daq.bench.config import Bench, bench_codec, load_bench
from daq.bus.source import Now
from daq.check.propose import propose_sensors
from daq.control.messages import Due, Phase, Status
from daq.errors import BusError
from daq.recorder.recording import Recording
from daq.runlog import LoggedNote, LoggedStatus
from daq.runs import BASELINE, Excitation
from daq.samples.converter import HealthState, advance
from daq.sim.bench import PIECE_S, PUSHES_S, Fault, SimulatedBench, push_frames
from daq.sim.car import SimulatedCar
from daq.vehicle import Corner
from dbc import FrameBatch

from ..wild_bench import DATABASES, NODES, wild_bench
from .bench_campaign import START_NS, Kept, record


@cache
def short_bench() -> Bench:
    """Return the shipped bench with two bounces in one state."""
    return replace(
        load_bench(None),
        campaign=Campaign((Excitation.BOUNCE,), 2, (BASELINE,), bump_height_m=0.05),
    )


def _idle() -> Status:
    now = Now(START_NS, 0.0)
    return Recording(short_bench(), bench_codec(short_bench()), Kept()).status(now)


def _resting() -> SimulatedBench:
    bench, status = short_bench(), _idle()
    return SimulatedBench(
        bench,
        bench_codec(bench),
        SimulatedCar(),
        1,
        math.inf,
        lambda: status,
        start_ns=START_NS,
    )


def _read(source: SimulatedBench, seconds: float) -> FrameBatch:
    return FrameBatch.concatenate([source.read(0.0) for _ in range(round(seconds / PIECE_S))])


@pytest.mark.parametrize(
    ("fault", "code"),
    [
        (Fault.UNPLUG, "stale"),
        (Fault.FROZEN, "frozen"),
        pytest.param(Fault.OVERLOAD, "overload", marks=pytest.mark.long),
        pytest.param(Fault.LOST_FRAMES, "lost_frames", marks=pytest.mark.long),
        pytest.param(Fault.WEAK, "too_weak", marks=pytest.mark.long),
        pytest.param(Fault.WRONG_MODE, "wrong_mode", marks=pytest.mark.long),
    ],
)
def test_a_fault_spoils_the_second_run_and_no_other(fault: Fault, code: str) -> None:
    _, status = record(short_bench(), 5, fault)
    assert status.phase is Phase.COMPLETE
    accepted, rejected = LoggedStatus.ACCEPTED, LoggedStatus.REJECTED
    assert [run.status for run in status.runs] == [accepted, rejected, accepted]
    failed = [finding.code for finding in status.runs[1].findings if not finding.passed]
    assert failed[0] == code


@pytest.mark.parametrize(("method", "level"), [(Method.DROP, 3.0), (Method.PUSH, 0.4)])
def test_the_car_is_dropped_or_pushed_as_the_procedure_says(method: Method, level: float) -> None:
    bench = load_bench(None)
    bench = replace(
        bench,
        campaign=Campaign((Excitation.ROLL,), 1, (BASELINE,), method=method, bump_height_m=0.05),
        trigger=bench.trigger.model_copy(update={"level": level}),
    )
    _, status = record(bench, 5)
    assert [run.status for run in status.runs] == [LoggedStatus.ACCEPTED]
    assert status.phase is Phase.COMPLETE


def test_an_unplugged_bench_comes_back_when_it_is_opened_again() -> None:
    source = _resting()
    before = _read(source, 0.5)
    source._plugged_s = 3.5  # as the fault sets it in mid-run
    with pytest.raises(BusError, match="adapter is gone"):
        source.open()
    for _ in range(100):
        try:
            source.open()
        except BusError:
            continue
        break
    after = source.read(0.0)
    assert (int(after.t_ns[0]) - int(before.t_ns[-1])) * 1e-9 == pytest.approx(3.0, abs=PIECE_S)


def test_a_mark_of_the_bench_check_asks_for_a_push() -> None:
    reported = [_idle()]
    bench = short_bench()
    codec = bench_codec(bench)
    source = SimulatedBench(bench, codec, SimulatedCar(), 1, math.inf, lambda: reported[0])
    rest = codec.decode(_read(source, 1.0))["SUSP_Rear.travel_rr"].value
    reported[0] = replace(reported[0], notes=(LoggedNote(0, "a note"), LoggedNote(0, "push RR")))
    travel = codec.decode(_read(source, 4.0))["SUSP_Rear.travel_rr"]
    assert np.max(np.abs(rest)) < 3.0
    pushed_s = np.flatnonzero(travel.value > 5.0) * np.median(np.diff(travel.t_ns)) * 1e-9
    assert 0.2 < np.ptp(pushed_s) < 1.2  # once


def bumps_s(frames: FrameBatch) -> list[float]:
    """Return when a front wheel first moved after at least 2 s of calm."""
    samples = bench_codec(short_bench()).decode(frames)["HUB_Front.acc_fl"]
    time_s = (samples.t_ns[np.abs(samples.value - 1.0) > 0.3] - START_NS) * 1e-9
    return [float(t) for t in time_s[np.diff(time_s, prepend=-9.0) > 2.0]]


@pytest.mark.parametrize(
    ("fault", "after_s", "gap_s"), [(Fault.LOST_FRAMES, 0.3, 0.12), (Fault.UNPLUG, 0.5, 3.0)]
)
def test_frames_are_missing_after_the_second_bump(
    fault: Fault, after_s: float, gap_s: float
) -> None:
    bench = short_bench()
    status = replace(_idle(), phase=Phase.ARMED, due=Due(bench.campaign.steps[0], 0, 2, 0, ""))
    source = SimulatedBench(
        bench, bench_codec(bench), SimulatedCar(), 4, math.inf, lambda: status, fault, START_NS
    )
    read: list[FrameBatch] = []
    for _ in range(100):
        with suppress(BusError):
            read.append(source.read(0.0))
    source.dismantle()
    frames = FrameBatch.concatenate(read)
    first, second = bumps_s(frames)[:2]
    # Somebody bumps 1 to 1.6 s after arming, as soon as a piece of 0.2 s is over; rest of 0.1 s.
    assert 1.1 <= first <= 1.6 + PIECE_S + 0.15
    # No run is judged here: the next bump waits for 10 s.
    assert 10.0 + 1.0 <= second - first <= 10.0 + 1.6 + 2 * PIECE_S
    gap = int(np.argmax(np.diff(frames.t_ns)))
    start_s, stop_s = (frames.t_ns[gap : gap + 2] - START_NS) * 1e-9
    assert after_s - 0.02 <= start_s - second <= after_s + PIECE_S + 0.02
    assert stop_s - start_s == pytest.approx(gap_s, abs=0.01)


def test_a_bench_is_proposed_from_rest_and_pushes_as_it_is() -> None:
    """Each corner goes down once, in the printed order, for 11.2 s in all."""
    assert pytest.approx(4 * (1.2 + 1.6)) == PUSHES_S
    bench = wild_bench()
    blocks = push_frames(bench, bench_codec(bench), SimulatedCar(), 1, START_NS, 3.0)
    end_ns = START_NS + 16_000_000_000
    frames = FrameBatch.concatenate(list(takewhile(lambda b: int(b.t_ns[0]) < end_ns, blocks)))
    samples = bench_codec(bench).decode(frames).samples
    for node, corner in NODES.items():
        pot = samples[f"node_{node}.TPDO1.Position_Value"]
        since_s = (pot.t_ns - START_NS) * 1e-9 - 3.0
        mm = np.abs(pot.value - np.median(pot.value[since_s < 0.0]))
        down = [mm[(since_s > at) & (since_s < at + 1.2)].max() for at in 2.8 * np.arange(4)]
        assert tuple(Corner)[int(np.argmax(down))] == corner
        assert 10.0 < max(down) < 40.0
        assert mm[since_s > PUSHES_S].max() < 1.0
    early = frames.t_ns < START_NS + 2_500_000_000
    proposed = propose_sensors(DATABASES, bench.buses, frames.select(early), frames.select(~early))
    assert [q for q in proposed.questions if "yours" not in q] == []
    for node, corner in NODES.items():
        table = proposed.text.partition(f'signal = "pot_{node}.')[2].partition("[[")[0]
        assert f'corner = "{corner}"' in table
        assert "sign = -1" in table


def test_a_bench_that_nobody_waits_for_rests() -> None:
    bench = short_bench()
    frames = _read(_resting(), 3.0)
    acc = bench_codec(bench).decode(frames)["HUB_Front.acc_fl"].value
    assert len(acc) == pytest.approx(3000, abs=2)
    assert np.std(acc) * 9.80665 == pytest.approx(0.15, rel=0.1)
    assert np.mean(acc) == pytest.approx(1.0, abs=0.1)


def test_counters_and_stamps_run_on_through_all_pieces() -> None:
    codec = bench_codec(short_bench())
    frames = _read(_resting(), 2.0)
    assert np.all(np.diff(frames.t_ns) > 0)
    assert advance(codec.messages, HealthState(), codec.decode(frames)).losses.measured == 0


def test_a_push_on_a_corner_presses_its_suspension_together_first() -> None:
    source = _resting()
    source.push(Corner.REAR_LEFT)
    samples = bench_codec(short_bench()).decode(_read(source, 2.0))
    peaks = {
        name: float(np.max(samples[f"SUSP_{axle}.travel_{name}"].value))
        for axle, names in (("Front", ("fl", "fr")), ("Rear", ("rl", "rr")))
        for name in names
    }
    assert max(peaks, key=lambda name: peaks[name]) == "rl"
    assert peaks["rl"] > 5.0
