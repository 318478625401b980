"""The simulated bench as a bus: its frames, and bumps as the recorder waits for them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from daq.bench.campaign import Campaign, Method
from daq.bench.config import Bench, WeightTable, bench_codec, load_bench
from daq.bus.source import BusError, HopLosses, Now
from daq.control.messages import Arm, DiskStatus, Due, Phase, Status, StorageStatus, Until
from daq.journal.writer import JournalWriter
from daq.recorder.recording import Recording
from daq.runlog import LoggedNote
from daq.runs import BASELINE, Event, Excitation, RunStatus
from daq.samples.converter import HealthState, advance
from daq.sim.bench import PIECE_S, Fault, SimulatedBench
from daq.sim.car import SimulatedCar, Spread
from daq.sim.ecu import campaign_frames, frame_time_ns, priority, transmit
from dbc import Codec, DecodeCounts, FrameBatch, parse_codec, shipped_dbc
from dbc.words import InputError

START_NS = 1_700_000_000_123_456_789
SEED = 11
SILENT = Spread(0.0, 0.0, 0.0, 0.0, 0.0)
CAR = SimulatedCar(lead_s=0.6, tail_s=1.2)
QUIET = replace(CAR, noise=SILENT, bias=SILENT, jitter_s=0.0)
CODEC = parse_codec(shipped_dbc(), "shipped")
HUB = "HUB_Front.acc_fl"


def bench_of(kinds: tuple[Excitation, ...], repeats: int = 1, messages: str = "") -> Bench:
    """Return the shipped bench with a short campaign; `messages`: beginning of those it keeps."""
    bench = load_bench(None)
    channels = tuple(c for c in bench.channels if c.signal.startswith(messages))
    campaign = Campaign(kinds, repeats, (BASELINE,), bump_height_m=0.05)
    return replace(bench, campaign=campaign, channels=channels)


TWO_RUNS = bench_of((Excitation.BOUNCE, Excitation.ROLL))
FRONT_HUBS = bench_of((Excitation.BOUNCE,), 2, "HUB_Front")
TWO_BOUNCES = bench_of((Excitation.BOUNCE,), 2)


@pytest.fixture(scope="module")
def frames() -> FrameBatch:
    return FrameBatch.concatenate(list(campaign_frames(TWO_RUNS, CODEC, CAR, SEED, START_NS)))


def test_every_frame_decodes_on_its_clock_and_counters_run_through(frames: FrameBatch) -> None:
    decoded = CODEC.decode(frames)
    assert decoded.counts == DecodeCounts(0, 0, 0, 0, 0)
    drawn = CAR.draw(TWO_RUNS.channels, TWO_RUNS.mass_states, SEED)
    for name, samples in decoded.samples.items():
        assert not samples.quality.any(), name
        message, _, signal = name.partition(".")
        if signal != "counter":
            continue
        assert samples.value[0] == 0
        assert (np.diff(samples.value) % 256 == 1).all()
        assert samples.value.max() == 255
        clock, cycle_s = drawn.clocks[message], CODEC.message(message).cycle_s
        assert cycle_s is not None
        ticks = clock.phase + np.arange(len(samples.t_ns)) * (1 + clock.error)
        late_s = (samples.t_ns - START_NS) * 1e-9 - ticks * cycle_s
        assert len(ticks) == pytest.approx(2 * CAR.run_s / cycle_s, abs=2)
        assert late_s.min() > 100e-6  # the frame's own time on the wire
        assert late_s.max() < 0.0012  # half a cycle of jitter at most, and some arbitration
        assert np.median(late_s) < 0.0005


def test_a_seed_decides_everything(frames: FrameBatch) -> None:
    again = next(campaign_frames(TWO_RUNS, CODEC, CAR, SEED, START_NS))
    other = next(campaign_frames(FRONT_HUBS, CODEC, CAR, SEED + 1, START_NS))
    first = frames.select(slice(len(again)))
    np.testing.assert_array_equal(again.t_ns, first.t_ns)
    np.testing.assert_array_equal(again.data, first.data)
    hubs = frames.select(frames.can_id == CODEC.message("HUB_Front").can_id)
    assert not np.array_equal(other.t_ns[:100], hubs.t_ns[:100])


def test_a_frame_carries_the_value_of_its_true_delay_ago() -> None:
    bench = bench_of((Excitation.BOUNCE,), messages="HUB_Front")
    late, prompt = (
        CODEC.decode(
            next(campaign_frames(replace(bench, channels=hubs), CODEC, QUIET, 1, START_NS))
        )
        for hubs in (
            tuple(replace(c, delay_s=delay_s, delay_sigma_s=0.0) for c in bench.channels)
            for delay_s in (0.05, 0.0)
        )
    )
    # The clock is off by some ppm, so 50 ticks are 50 ms to 1 us.
    assert np.abs(late[HUB].value[50:] - prompt[HUB].value[:-50]).max() <= 0.001
    assert np.abs(late[HUB].value - prompt[HUB].value).max() > 1.0


def refused(bench: Bench, codec: Codec = CODEC) -> str:
    with pytest.raises(InputError) as caught:
        next(campaign_frames(bench, codec, CAR, SEED, START_NS))
    return str(caught.value)


def test_a_bench_that_cannot_be_simulated_is_refused_in_a_line() -> None:
    bench = load_bench(None)
    for signal in ("HUB_Front.acc_xx", "Nobody.acc_fl"):
        wrong = replace(bench, channels=(replace(bench.channels[6], signal=signal),))
        assert f"has no signal {signal!r}" in refused(wrong)
    text = shipped_dbc().replace('BA_ "GenMsgCycleTime" BO_ 272 1;\n', "")
    assert "HUB_Front has no cycle time" in refused(bench, parse_codec(text, "x"))
    heavy = replace(bench, weights=(WeightTable(mass_kg=3000.0, x_m=2.0, y_m=0.0),))
    assert "mass state added: a wheel is off the ground" in refused(heavy)


def test_the_wire_carries_one_frame_at_a_time_by_priority() -> None:
    """Lengths are the published worst cases with stuffing, plus the gap of 3 bits."""
    imu = CODEC.message("IMU_Accel")
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


@pytest.mark.parametrize(("bitrate", "late"), [(1_000_000, False), (250_000, True)])
def test_an_overloaded_bus_stays_late_into_the_next_run(bitrate: int, late: bool) -> None:
    bench = replace(TWO_RUNS, buses=(replace(TWO_RUNS.buses[0], bitrate=bitrate),))
    car = replace(CAR, lead_s=0.1, tail_s=0.4)
    sent = FrameBatch.concatenate(list(campaign_frames(bench, CODEC, car, SEED, START_NS)))
    takes = {m.can_id: frame_time_ns(m, bitrate) for m in CODEC.messages}
    duration = np.array([takes[can_id] for can_id in sent.can_id.tolist()])
    assert (np.diff(sent.t_ns) >= duration[1:]).all()  # no two frames are on the wire at once
    assert bool(sent.t_ns[-1] - START_NS > 1.5 * 2 * car.run_s * 1e9) is late


# The simulated bench as a bus: bumped as the recorder waits ---------------------------------------


DISK = DiskStatus(10**12, 0, 0, 0.0)
NO_LOSSES = HopLosses()


class Kept(JournalWriter):
    """Keeps in memory what a recorder stores."""

    def __init__(self) -> None:
        self.frames: list[FrameBatch] = []
        self.events: list[Event] = []

    def append(self, frames: FrameBatch, losses: HopLosses) -> None:
        self.frames.append(frames)

    def append_events(self, events: Sequence[Event]) -> None:
        self.events += events


def record(
    bench: Bench, seed: int, fault: Fault | None = None, speed: float = math.inf, turns: int = 6000
) -> tuple[Kept, Status]:
    """Record until the campaign is complete; return what was stored and the last status."""
    codec, kept = bench_codec(bench), Kept()
    recorder = Recording(bench, codec, kept)
    statuses: list[Status] = []
    source = SimulatedBench(
        bench, codec, SimulatedCar(), seed, speed, lambda: statuses[-1], fault, START_NS
    )
    now = Now(START_NS, 0.0)
    statuses.append(recorder.status(now))
    armed = False
    for _ in range(turns):
        try:
            batch = source.read(0.02)
        except BusError:
            batch = FrameBatch.concatenate([])
        if len(batch):
            now = Now(int(batch.t_ns[-1]), (int(batch.t_ns[-1]) - START_NS) * 1e-9)
        recorder.store(batch, NO_LOSSES)
        recorder.look(now, (), DISK, StorageStatus())
        if not armed and len(batch):
            recorder.carry_out(Arm(Until.COMPLETE), "test", now)
            armed = True
        statuses[:] = [recorder.status(now)]
        if statuses[-1].phase is Phase.COMPLETE:
            break
    return kept, statuses[-1]


def idle(bench: Bench) -> Status:
    return Recording(bench, bench_codec(bench), Kept()).status(Now(START_NS, 0.0))


def read(source: SimulatedBench, seconds: float) -> FrameBatch:
    return FrameBatch.concatenate([source.read(0.0) for _ in range(round(seconds / PIECE_S))])


def test_a_bench_that_nobody_waits_for_rests_and_counts_through_all_pieces() -> None:
    source = SimulatedBench(TWO_BOUNCES, CODEC, SimulatedCar(), 1, math.inf, start_ns=START_NS)
    frames = read(source, 2.0)
    assert np.all(np.diff(frames.t_ns) > 0)
    decoded = CODEC.decode(frames)
    assert advance(CODEC.messages, HealthState(), decoded).losses.measured == 0
    acc = decoded[HUB].value
    assert len(acc) == pytest.approx(2000, abs=2)
    assert np.std(acc) * 9.80665 == pytest.approx(0.15, rel=0.1)
    assert np.mean(acc) == pytest.approx(1.0, abs=0.1)


def test_a_mark_of_the_bench_check_asks_for_a_push() -> None:
    """It presses the suspension of that corner together, once."""
    bench = bench_of((Excitation.BOUNCE,), messages="SUSP_")
    status = [idle(TWO_BOUNCES)]
    source = SimulatedBench(bench, CODEC, SimulatedCar(), 1, math.inf, lambda: status[0])
    rest = CODEC.decode(read(source, 1.0))["SUSP_Rear.travel_rr"].value
    status[0] = replace(status[0], notes=(LoggedNote(0, "a note"), LoggedNote(0, "push RR")))
    samples = CODEC.decode(read(source, 4.0)).samples
    assert np.max(np.abs(rest)) < 3.0
    peaks = {n: float(s.value.max()) for n, s in samples.items() if "travel" in n}
    assert max(peaks, key=lambda name: peaks[name]) == "SUSP_Rear.travel_rr"
    travel = samples["SUSP_Rear.travel_rr"]
    pushed_s = np.flatnonzero(travel.value > 5.0) * np.median(np.diff(travel.t_ns)) * 1e-9
    assert 0.2 < np.ptp(pushed_s) < 1.2


def bumps_s(frames: FrameBatch, calm_s: float = 2.0) -> list[float]:
    """Return when a front wheel first moved after some calm."""
    samples = CODEC.decode(frames)[HUB]
    time_s = (samples.t_ns[np.abs(samples.value - 1.0) > 0.3] - START_NS) * 1e-9
    return [float(t) for t in time_s[np.diff(time_s, prepend=-9.0) > calm_s]]


@pytest.mark.parametrize(
    ("fault", "after_s", "gap_s"),
    [
        (Fault.DOUBLE_BUMP, 0.0, 0.0),
        (Fault.LOST_FRAMES, 0.3, 0.12),
        (Fault.UNPLUG, 0.5, 3.0),
    ],
)
def test_a_fault_spoils_the_second_bump(fault: Fault, after_s: float, gap_s: float) -> None:
    due = Due(FRONT_HUBS.campaign.steps[0], 0, 2, 0, "")
    status = replace(idle(FRONT_HUBS), phase=Phase.ARMED, due=due)
    source = SimulatedBench(
        FRONT_HUBS, CODEC, SimulatedCar(), 4, math.inf, lambda: status, fault, START_NS
    )
    blocks: list[FrameBatch] = []
    for _ in range(90):
        with suppress(BusError):
            blocks.append(source.open().read(0.0))
    frames = FrameBatch.concatenate(blocks)
    first, second = bumps_s(frames)[:2]
    # Somebody bumps 1 to 1.6 s after arming, as soon as a piece of 0.2 s is over; rest of 0.1 s.
    assert 1.1 <= first <= 1.6 + PIECE_S + 0.15
    # No run is judged here: the next bump waits for 10 s.
    assert 10.0 + 1.0 <= second - first <= 10.0 + 1.6 + 2 * PIECE_S
    gap = int(np.argmax(np.diff(frames.t_ns)))
    start_s, stop_s = (frames.t_ns[gap : gap + 2] - START_NS) * 1e-9
    if fault is Fault.DOUBLE_BUMP:
        assert stop_s - start_s < 0.005
        struck_s = np.array(bumps_s(frames, calm_s=0.3))
        assert struck_s - first == pytest.approx(
            [0.0, second - first, second - first + 0.84], abs=0.02
        )
        return
    assert after_s - 0.02 <= start_s - second <= after_s + PIECE_S + 0.02
    assert stop_s - start_s == pytest.approx(gap_s, abs=0.01)


@pytest.mark.parametrize(("method", "level"), [(Method.DROP, 3.0), (Method.PUSH, 0.4)])
def test_the_car_is_dropped_or_pushed_as_the_procedure_says(method: Method, level: float) -> None:
    bench = bench_of((Excitation.ROLL,))
    trigger = bench.trigger.model_copy(update={"level": level})
    bench = replace(bench, campaign=replace(bench.campaign, method=method), trigger=trigger)
    _, status = record(bench, 5)
    assert [run.status for run in status.runs] == [RunStatus.ACCEPTED]
    assert status.phase is Phase.COMPLETE
