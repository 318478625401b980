"""The simulated bench as a bus: its frames, and bumps as the recorder waits for them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import takewhile

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Method, Step
from daq.bench.config import Bench, bench_codec, load_bench
from daq.bus.source import Now
from daq.check.propose import propose_sensors
from daq.control.messages import Due, Phase, Status
from daq.errors import BusError, InputError
from daq.recorder.recording import Recording
from daq.runlog import LoggedNote
from daq.runs import BASELINE, Excitation, RunStatus
from daq.samples.converter import HealthState, advance
from daq.sim.bench import PIECE_S, PUSHES_S, Fault, SimulatedBench, push_frames
from daq.sim.car import NOISE, SimulatedCar, Spread
from daq.sim.ecu import bench_senders, campaign_frames, frame_time_ns, priority, transmit
from daq.vehicle import AddedMass, BodyWeight, Corner
from dbc import Codec, DecodeCounts, Decoded, FrameBatch, parse_codec, shipped_dbc

from ..wild_bench import DATABASES, NODES, wild_bench
from .bench_campaign import Kept, record

START_NS = 1_700_000_000_123_456_789
SEED = 11
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)


def two_runs() -> Bench:
    campaign = Campaign((Excitation.BOUNCE, Excitation.ROLL), repeats=1, bump_height_m=0.05)
    return replace(load_bench(None), campaign=campaign)


CAR = SimulatedCar(lead_s=0.6, tail_s=1.2)
QUIET = replace(CAR, noise=SILENT, bias=SILENT, jitter_s=0.0)


@pytest.fixture(scope="module")
def codec() -> Codec:
    return parse_codec(shipped_dbc(), "shipped")


@pytest.fixture(scope="module")
def batches(codec: Codec) -> list[FrameBatch]:
    return list(campaign_frames(two_runs(), codec, CAR, SEED, START_NS))


@pytest.fixture(scope="module")
def decoded(batches: list[FrameBatch], codec: Codec) -> Decoded:
    return codec.decode(FrameBatch.concatenate(batches))


def test_the_next_bump_is_asked_for_when_the_run_before_it_was_used(codec: Codec) -> None:
    roll, bounce = (Step("baseline", kind, 1) for kind in (Excitation.ROLL, Excitation.BOUNCE))
    asked = []

    def due() -> Iterator[Step]:
        for step in (roll, bounce, roll):
            asked.append(step)
            yield step

    frames = campaign_frames(two_runs(), codec, CAR, SEED, START_NS, due())
    seen = []
    for number, batch in enumerate(frames, start=1):
        assert len(asked) == number
        samples = codec.decode(batch).samples
        seen.append(float(np.ptp(samples["IMU_Rate.rate_x"].value)))
    assert len(seen) == 3
    assert seen[1] < 0.1 * min(seen[0], seen[2])


def test_every_frame_decodes_and_counters_run_through_the_campaign(decoded: Decoded) -> None:
    assert decoded.counts == DecodeCounts(0, 0, 0, 0, 0)
    for name, samples in decoded.samples.items():
        assert not samples.quality.any(), name
        if name.endswith(".counter"):
            assert samples.value[0] == 0
            assert (np.diff(samples.value) % 256 == 1).all()
            assert samples.value.max() == 255


def test_messages_keep_their_cycle_times_to_the_clock_error(decoded: Decoded) -> None:
    drawn = CAR.draw(two_runs().channels, two_runs().mass_states, SEED)
    for name, cycle_s in (("IMU_Rate", 0.002), ("HUB_Front", 0.001), ("SUSP_Rear", 0.002)):
        t_ns = decoded[f"{name}.counter"].t_ns
        tick = np.arange(len(t_ns))
        clock = drawn.clocks[name]
        ideal_s = (clock.phase + tick * (1 + clock.error)) * cycle_s
        late_s = (t_ns - START_NS) * 1e-9 - ideal_s
        assert len(t_ns) == pytest.approx(4 * CAR.run_s / cycle_s, abs=2)
        assert late_s.min() > 100e-6  # the frame's own time on the wire
        assert late_s.max() < 0.0012  # half a cycle of jitter at most, and some arbitration
        assert np.median(late_s) < 0.0005


def test_a_seed_decides_everything(batches: list[FrameBatch], codec: Codec) -> None:
    again = next(campaign_frames(two_runs(), codec, CAR, SEED, START_NS))
    other = next(campaign_frames(two_runs(), codec, CAR, SEED + 1, START_NS))
    np.testing.assert_array_equal(again.t_ns, batches[0].t_ns)
    np.testing.assert_array_equal(again.data, batches[0].data)
    assert not np.array_equal(other.t_ns[:100], batches[0].t_ns[:100])


def test_a_frame_carries_the_value_of_its_true_delay_ago(codec: Codec) -> None:
    bench = replace(
        load_bench(None),
        campaign=Campaign((Excitation.BOUNCE,), 1, ("baseline",), bump_height_m=0.05),
    )
    hub = [c for c in bench.channels if c.signal.startswith("HUB_Front")]
    late = [replace(c, delay_s=0.05, delay_sigma_s=0.0) for c in hub]
    prompt = [replace(c, delay_s=0.0, delay_sigma_s=0.0) for c in hub]
    seen = []
    for channels in (late, prompt):
        (batch,) = campaign_frames(
            replace(bench, channels=tuple(channels)), codec, QUIET, SEED, START_NS
        )
        seen.append(codec.decode(batch)["HUB_Front.acc_fl"].value)
    # The clock is off by some ppm, so 50 ticks are 50 ms to 1 us.
    assert np.abs(seen[0][50:] - seen[1][:-50]).max() <= 0.001
    assert np.abs(seen[0] - seen[1]).max() > 1.0


def refused(bench: Bench, codec: Codec) -> str:
    with pytest.raises(InputError) as caught:
        next(campaign_frames(bench, codec, CAR, SEED, START_NS))
    return str(caught.value)


def test_weights_that_tip_the_car_over_are_refused(codec: Codec) -> None:
    bench = load_bench(None)
    heavy = AddedMass((BodyWeight(3000.0, 2.0, 0.0),))
    states = (bench.mass_states[0], replace(bench.mass_states[1], added=heavy))
    frames = campaign_frames(replace(two_runs(), mass_states=states), codec, CAR, SEED, START_NS)
    with pytest.raises(InputError, match="mass state added: a wheel is off the ground"):
        next(frames)


def test_the_wire_carries_one_frame_at_a_time_by_priority() -> None:
    """Lengths are the published worst cases with stuffing, plus the gap of 3 bits."""
    imu = parse_codec(shipped_dbc(), "shipped").message("IMU_Accel")
    for length, is_extended, bits in (
        (0, False, 55),
        (8, False, 135),
        (0, True, 80),
        (8, True, 160),
    ):
        message = replace(imu, length=length, is_extended=is_extended)
        assert frame_time_ns(message, 1_000_000) == 1000 * bits
        assert frame_time_ns(message, 500_000) == 2000 * bits
    ids = [(0x100, False), (0x100 << 18, True), ((0x100 << 18) + 1, True), (0x101, False)]
    rising = [replace(imu, can_id=can_id, is_extended=wide) for can_id, wide in ids]
    assert [priority(message) for message in rising] == sorted(map(priority, rising))
    rng = np.random.default_rng(3)
    release, rank = rng.integers(0, 100_000, 900), rng.integers(0, 6, 900)
    duration = rng.integers(80, 130, 900)
    end = transmit(release, rank, duration, free_ns=1000)
    begin, order = end - duration, np.argsort(end)
    assert begin.min() >= 1000
    assert (begin >= release).all()
    assert (begin[order][1:] >= end[order][:-1]).all()
    for i in order[:200]:  # a message that was ready when this one began had no higher priority
        waiting = (release <= begin[i]) & (begin > begin[i])
        assert (rank[waiting] >= rank[i]).all()


def test_no_two_frames_are_on_the_wire_at_once(batches: list[FrameBatch], codec: Codec) -> None:
    joined = FrameBatch.concatenate(batches)
    takes = {m.can_id: frame_time_ns(m, 1_000_000) for m in codec.messages}
    duration = np.array([takes[can_id] for can_id in joined.can_id.tolist()])
    assert (joined.t_ns[1:] - duration[1:] >= joined.t_ns[:-1]).all()


def test_an_overloaded_bus_stays_late_into_the_next_run(codec: Codec) -> None:
    bench = replace(two_runs(), buses=(replace(two_runs().bus, bitrate=250_000),))
    joined = FrameBatch.concatenate(list(campaign_frames(bench, codec, CAR, SEED, START_NS)))
    takes = {m.can_id: frame_time_ns(m, 250_000) for m in codec.messages}
    duration = np.array([takes[can_id] for can_id in joined.can_id.tolist()])
    assert (np.diff(joined.t_ns) >= duration[1:]).all()
    assert joined.t_ns[-1] - START_NS > 1.5 * 4 * CAR.run_s * 1e9


def test_repeats_differ_by_their_noise_only(codec: Codec) -> None:
    bench = replace(
        load_bench(None),
        campaign=Campaign((Excitation.PITCH,), 2, ("baseline",), bump_height_m=0.05),
    )
    first, second = (
        codec.decode(batch)["HUB_Front.acc_fl"].value
        for batch in campaign_frames(bench, codec, CAR, SEED, START_NS)
    )
    n = min(len(first), len(second))
    difference = first[:n] - second[:n]
    assert difference.std() == pytest.approx(
        np.sqrt(2) * NOISE.hub_acceleration_m_s2 / 9.80665, 0.1
    )


def test_a_channel_that_is_not_in_the_dbc_is_named(codec: Codec) -> None:
    bench = load_bench(None)
    for signal in ("HUB_Front.acc_xx", "Nobody.acc_fl"):
        wrong = replace(bench, channels=(replace(bench.channels[6], signal=signal),))
        assert f"signal {signal} is not in" in refused(wrong, codec)


def test_a_message_without_a_cycle_time_cannot_be_sent() -> None:
    text = shipped_dbc().replace('BA_ "GenMsgCycleTime" BO_ 272 1;\n', "")
    assert "HUB_Front has no cycle time" in refused(load_bench(None), parse_codec(text, "x"))


def test_only_messages_with_channels_are_sent(codec: Codec) -> None:
    bench = load_bench(None)
    hubs = tuple(c for c in bench.channels if c.signal.startswith("HUB_"))
    drawn = CAR.draw(hubs, bench.mass_states, SEED)
    senders = bench_senders(replace(bench, channels=hubs), codec, drawn)
    assert [sender.message.name for sender in senders] == ["HUB_Front", "HUB_Rear"]
    assert [len(sender.channels) for sender in senders] == [2, 2]


# The simulated bench as a bus: bumped as the recorder waits, one run sp ---------------------------


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
    accepted, rejected = RunStatus.ACCEPTED, RunStatus.REJECTED
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
    assert [run.status for run in status.runs] == [RunStatus.ACCEPTED]
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
