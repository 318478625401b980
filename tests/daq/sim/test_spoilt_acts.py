"""Bumps that are spoilt on request, and the times at which somebody bumps the car."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Campaign, Step
from daq.bench.config import Bench, BusConfig, bench_codec, load_bench
from daq.clocks import Now
from daq.control.messages import Due, Phase, Status
from daq.errors import BusError, InputError
from daq.recorder.recording import Recording
from daq.runs import BASELINE, Excitation
from daq.samples.health import HealthState, advance
from daq.sim.acts import Act, Acts, Push
from daq.sim.bench_source import Fault, SimulatedBench
from daq.sim.car import SimulatedCar
from daq.sim.ecu import Burst, on_the_buses, rig_of
from dbc import FrameBatch, parse_codec

from .bench_campaign import HOST, START_NS, Kept

BOUNCE = Step(BASELINE, Excitation.BOUNCE, 1)
PIECE_S = 0.2


@pytest.fixture(scope="module")
def bench() -> Bench:
    return replace(load_bench(None), campaign=Campaign((Excitation.BOUNCE,), 2, (BASELINE,)))


@pytest.fixture(scope="module")
def acts(bench: Bench) -> Iterator[Acts]:
    acts = Acts(bench, rig_of(bench, bench_codec(bench), SimulatedCar(), 3))
    yield acts
    acts.close()


def hubs(act: Act) -> NDArray[np.float64]:
    """Return what the wheels accelerate by in the first 1.1 s, m/s2."""
    return np.asarray(act.scene.motion.at(np.arange(0.0, 1.1, 1e-3)).acceleration[3:])


def test_a_weak_bump_reaches_1_4_times_the_level_of_the_trigger(acts: Acts) -> None:
    """The level of the shipped bench is 3 m/s2."""
    weak = np.abs(hubs(acts.prepare(BOUNCE, Fault.WEAK).result()))
    assert weak.max() == pytest.approx(4.2, rel=0.05)


def test_an_overloaded_sensor_ends_at_half_of_its_free_motion(acts: Acts) -> None:
    act = acts.prepare(BOUNCE, Fault.OVERLOAD).result()
    ((name, limit),) = act.limits.items()
    corner = ("hub_acc_fl", "hub_acc_fr", "hub_acc_rl", "hub_acc_rr").index(name)
    free = hubs(act)[:, 310:].max(axis=1)  # 0.1 s of rest, 0.2 s of bump and 10 ms
    assert free[corner] == pytest.approx(free.max(), rel=0.02)
    assert limit - 9.80665 == pytest.approx(free.max() / 2, rel=0.05)
    assert acts.prepare(BOUNCE, None).result().limits == {}


def test_another_kind_of_bump_moves_another_axle(acts: Acts) -> None:
    wrong = np.abs(hubs(acts.prepare(BOUNCE, Fault.WRONG_MODE).result())).max(axis=1)
    assert wrong[:2].min() > 4 * wrong[2:].max()


def test_a_bump_is_computed_once(acts: Acts) -> None:
    assert acts.prepare(BOUNCE, None) is acts.prepare(replace(BOUNCE, repeat=2), None)
    assert acts.prepare(BOUNCE, None) is not acts.prepare(BOUNCE, Fault.WEAK)


def test_a_hand_presses_as_one_cosine() -> None:
    push = Push(np.full((7, 1), 2.0), np.arange(7.0)[:, None], 0.5)
    t_s = np.array([-0.1, 0.0, 0.125, 0.25, 0.375, 0.5, 0.6])
    found = push.at(t_s)
    turn = 2 * np.pi / 0.5
    assert found.pose[6] - 2.0 == pytest.approx(6.0 * np.array([0, 0, 0.5, 1, 0.5, 0, 0]))
    assert found.velocity[6] == pytest.approx(6 * turn / 2 * np.array([0, 0, 1, 0, -1, 0, 0]))
    curve = 6 * turn**2 / 2 * np.array([0, 0, 0, -1, 0, 0, 0])
    assert found.acceleration[6] == pytest.approx(curve, abs=1e-9)


def armed(bench: Bench) -> Status:
    codec = bench_codec(bench)
    idle = Recording(bench, codec, Kept()).status(Now(START_NS, 0.0), HOST)
    return replace(idle, phase=Phase.ARMED, due=Due(BOUNCE, 0, 2, 0, ""))


def source_of(bench: Bench, fault: Fault) -> SimulatedBench:
    status = armed(bench)
    return SimulatedBench(
        bench, bench_codec(bench), SimulatedCar(), 4, math.inf, lambda: status, fault, START_NS
    )


def bumps_s(bench: Bench, frames: FrameBatch) -> list[float]:
    """Return when a front wheel first moved after at least 2 s of calm."""
    samples = bench_codec(bench).decode(frames)["HUB_Front.acc_fl"]
    time_s = (samples.t_ns[np.abs(samples.value - 1.0) > 0.3] - START_NS) * 1e-9
    return [float(t) for t in time_s[np.diff(time_s, prepend=-9.0) > 2.0]]


def test_frames_are_lost_from_0_3_to_0_42_s_after_the_second_bump(bench: Bench) -> None:
    source = source_of(bench, Fault.LOST_FRAMES)
    frames = FrameBatch.concatenate([source.read(0.0) for _ in range(53)])
    source.dismantle()
    first, second = bumps_s(bench, frames)
    # Somebody bumps 1 to 1.6 s after arming, as soon as a piece of 0.2 s is over; rest of 0.1 s.
    assert 1.1 <= first <= 1.6 + PIECE_S + 0.15
    assert 6.1 + 1.0 <= second - first <= 6.1 + 1.6 + 2 * PIECE_S
    gap = int(np.argmax(np.diff(frames.t_ns)))
    start_s, stop_s = (frames.t_ns[gap : gap + 2] - START_NS) * 1e-9
    assert start_s - second == pytest.approx(0.3, abs=0.02)
    assert stop_s - start_s == pytest.approx(0.12, abs=0.002)
    lost = advance(bench_codec(bench).messages, HealthState(), bench_codec(bench).decode(frames))
    per_s = sum(1 / m.cycle_s for m in bench_codec(bench).messages if m.cycle_s)
    assert lost.losses.measured == pytest.approx(0.12 * per_s, abs=8)


def test_an_adapter_is_gone_for_three_seconds_half_a_second_after_the_bump(bench: Bench) -> None:
    source = source_of(bench, Fault.UNPLUG)
    read: list[FrameBatch] = []
    for _ in range(68):
        with suppress(BusError):
            read.append(source.read(0.0))
    source.dismantle()
    frames = FrameBatch.concatenate(read)
    _, second = bumps_s(bench, frames)
    before = int(np.argmax(np.diff(frames.t_ns)))
    start_s, stop_s = (frames.t_ns[before : before + 2] - START_NS) * 1e-9
    assert 0.5 <= start_s - second <= 0.5 + PIECE_S + 0.02
    assert stop_s - start_s == pytest.approx(3.0, abs=0.01)


def message_text(length: int) -> str:
    return (
        f'VERSION ""\n\nBU_: A\n\nBO_ 256 HUB: {length} A\n'
        ' SG_ a : 0|16@1- (0.001,0) [0|0] "g" A\n'
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\nBA_DEF_DEF_ "GenMsgCycleTime" 10;\n'
        'BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","x","x","x","x","x","x","x","x","x","x",'
        '"x","x","x","StandardCAN_FD";\nBA_DEF_DEF_ "VFrameFormat" "StandardCAN_FD";\n'
    )


@pytest.mark.parametrize(("length", "sent"), [(8, True), (12, False)])
def test_the_simulated_bench_sends_classic_frames(length: int, sent: bool) -> None:
    codec = parse_codec(message_text(length), "fd.dbc")
    shipped = load_bench(None)
    channel = next(c for c in shipped.channels if c.name == "hub_acc_fl")
    bench = replace(shipped, channels=(replace(channel, signal="HUB.a"),))
    if sent:
        assert len(rig_of(bench, codec, SimulatedCar(), 1).senders) == 1
    else:
        with pytest.raises(InputError, match="HUB has 12 bytes"):
            rig_of(bench, codec, SimulatedCar(), 1)


def test_a_bus_without_a_message_carries_nothing() -> None:
    (message,) = parse_codec(message_text(8), "x.dbc").messages
    second = replace(message, bus=1)
    times = np.array([0.5, 0.25])
    burst = Burst(second, times, np.array([[1] * 8, [2] * 8], np.uint8))
    buses = (BusConfig("virtual", "a", 500_000), BusConfig("virtual", "b", 500_000))
    free_ns = [7, 7]
    batch = on_the_buses([burst], buses, START_NS, free_ns)
    assert batch.bus.tolist() == [1, 1]
    assert batch.data[:, 0].tolist() == [2, 1]
    # 8 bytes take 111 bits and at most 24 stuffed ones: 0.22 to 0.27 ms at 500 kbit/s.
    late_ns = batch.t_ns - START_NS - np.array([250_000_000, 500_000_000])
    assert np.all((late_ns > 215_000) & (late_ns < 275_000))
    assert free_ns == [7, int(batch.t_ns[-1])]
