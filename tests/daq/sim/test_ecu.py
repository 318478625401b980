"""The simulated campaign on the bus, read back through the codec."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.campaign import Campaign, Step
from daq.bench.config import Bench, load_bench
from daq.errors import InputError
from daq.runs import Excitation
from daq.sim.car import NOISE, SimulatedCar, Spread
from daq.sim.ecu import bench_senders, campaign_frames, frame_time_ns, priority, transmit
from daq.vehicle import AddedMass, BodyWeight
from dbc import Codec, DecodeCounts, Decoded, FrameBatch, parse_codec, shipped_dbc

START_NS = 1_700_000_000_123_456_789
SEED = 11
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)


def short_bench() -> Bench:
    campaign = Campaign((Excitation.BOUNCE, Excitation.ROLL), repeats=1, bump_height_m=0.05)
    return replace(load_bench(None), campaign=campaign)


CAR = SimulatedCar(lead_s=0.6, tail_s=1.2)
QUIET = replace(CAR, noise=SILENT, bias=SILENT, jitter_s=0.0)


@pytest.fixture(scope="module")
def codec() -> Codec:
    return parse_codec(shipped_dbc(), "shipped")


@pytest.fixture(scope="module")
def batches(codec: Codec) -> list[FrameBatch]:
    return list(campaign_frames(short_bench(), codec, CAR, SEED, START_NS))


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

    frames = campaign_frames(short_bench(), codec, CAR, SEED, START_NS, due())
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
    drawn = CAR.draw(short_bench().channels, short_bench().mass_states, SEED)
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
    again = next(campaign_frames(short_bench(), codec, CAR, SEED, START_NS))
    other = next(campaign_frames(short_bench(), codec, CAR, SEED + 1, START_NS))
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
    frames = campaign_frames(replace(short_bench(), mass_states=states), codec, CAR, SEED, START_NS)
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


def quiet_run(
    codec: Codec, excitation: Excitation, height_m: float = 0.05
) -> dict[str, NDArray[np.float64]]:
    shipped = load_bench(None)
    exact = tuple(replace(channel, gain_sigma=0.0) for channel in shipped.channels)
    campaign = Campaign((excitation,), 1, ("baseline",), bump_height_m=height_m)
    bench = replace(shipped, channels=exact, campaign=campaign)
    (batch,) = campaign_frames(bench, codec, QUIET, SEED, START_NS)
    return {name: samples.value for name, samples in codec.decode(batch).samples.items()}


def test_no_two_frames_are_on_the_wire_at_once(batches: list[FrameBatch], codec: Codec) -> None:
    joined = FrameBatch.concatenate(batches)
    takes = {m.can_id: frame_time_ns(m, 1_000_000) for m in codec.messages}
    duration = np.array([takes[can_id] for can_id in joined.can_id.tolist()])
    assert (joined.t_ns[1:] - duration[1:] >= joined.t_ns[:-1]).all()


def test_an_overloaded_bus_stays_late_into_the_next_run(codec: Codec) -> None:
    bench = replace(short_bench(), buses=(replace(short_bench().bus, bitrate=250_000),))
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


def test_bounce_lifts_all_wheels_alike_and_roll_only_the_left(codec: Codec) -> None:
    bounce, roll = (quiet_run(codec, e) for e in (Excitation.BOUNCE, Excitation.ROLL))
    for front in ("travel_fl", "travel_fr"):
        assert bounce[f"SUSP_Front.{front}"].max() > 20.0
    np.testing.assert_array_equal(bounce["SUSP_Front.travel_fl"], bounce["SUSP_Front.travel_fr"])
    assert roll["SUSP_Front.travel_fl"].max() > 20.0
    assert roll["SUSP_Front.travel_fl"].max() > 2 * roll["SUSP_Front.travel_fr"].max()
    assert np.abs(bounce["IMU_Rate.rate_x"]).max() == 0.0
    # The left side goes up first: positive roll rate.
    rate = roll["IMU_Rate.rate_x"]
    assert rate[np.flatnonzero(np.abs(rate) > 1.0)[0]] > 0


def test_messages_with_29_bit_identifiers_are_sent_as_such(codec: Codec) -> None:
    wide = Codec(tuple(replace(m, can_id=m.can_id << 18, is_extended=True) for m in codec.messages))
    batch = next(campaign_frames(short_bench(), wide, CAR, SEED, START_NS))
    assert wide.decode(batch).counts == DecodeCounts(0, 0, 0, 0, 0)
    assert codec.decode(batch).counts.unknown_id == len(batch)


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
