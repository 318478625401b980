"""Simulates the sensors' controllers: each message has its own clock, those of a bus share it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from dbc import Codec, FrameBatch, FrameFlag, MessageLayout
from dbc.words import InputError

from ..bench.config import Bench
from ..channels import Channel, signal_of
from ..runs import BASELINE
from ..samples.mapping import mapped_channels
from .car import ClockTruth, SimulatedCar, Truth, low_passed, signal_values, true_reading
from .motion import Array, Bump, Kinematics, Moving, Plant


@dataclass(frozen=True, slots=True)
class Sender:
    """A message of the bench, the channels in it, and the clock that samples them."""

    message: MessageLayout
    cycle_s: float
    """Its cycle time as stated in the DBC, s."""
    clock: ClockTruth
    channels: tuple[Channel, ...]

    def ticks(self, start_s: float, end_s: float) -> tuple[int, NDArray[np.float64]]:
        """Return number of the first tick in start_s <= t < end_s, and times of all there, (n,)."""
        period_s = self.cycle_s * (1.0 + self.clock.error)
        phase_s = self.clock.phase * self.cycle_s
        begin, end = np.ceil((np.array([start_s, end_s]) - phase_s) / period_s).astype(int)
        return int(begin), phase_s + period_s * np.arange(begin, end)


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """One motion of the car with its duration; its time begins at 0."""

    motion: Moving
    length_s: float
    """Time after which the car is at rest, s."""
    bump_s: float
    """Time at which the bump begins, s; infinite if it is not asked for."""
    low_passed: Mapping[str, tuple[Array, Array]]
    """Outputs of the sensors with a low-pass, on the motion's time (`car.low_passed`)."""


@dataclass(frozen=True, slots=True)
class Rig:
    """The parts of a bench that do not change during a campaign."""

    bench: Bench
    codec: Codec
    car: SimulatedCar
    drawn: Truth
    senders: tuple[Sender, ...]
    plants: Mapping[str, Plant]
    """The car in each state of loading."""

    def manoeuvre(
        self, motion: Moving, sampled_s: float, length_s: float, bump_s: float = np.inf
    ) -> Manoeuvre:
        """Return a motion that can be sampled from 0 to `sampled_s`, as a manoeuvre."""
        outputs = {}  # of the low-passes
        for channel in (channel for sender in self.senders for channel in sender.channels):
            sensor = self.drawn.sensors[channel.name]
            if sensor.low_pass_hz:
                span_s = (-sensor.delay_s, sampled_s - sensor.delay_s)
                unloaded = self.plants[BASELINE]
                outputs[channel.name] = low_passed(channel, sensor, unloaded, motion, span_s)
        return Manoeuvre(motion, length_s, bump_s, outputs)

    def frames(
        self,
        manoeuvre: Manoeuvre,
        begun_s: float,
        span_s: tuple[float, float],
        rng: np.random.Generator,
        start_ns: int,
        free_ns: list[int],
    ) -> FrameBatch:
        """Return the frames of a span of time, in the order in which the buses carry them.

        `begun_s`, `span_s`: begin of the manoeuvre, and begin and end of the span, s since the
        start of the campaign; adjacent spans lose and repeat nothing.  `start_ns`: time stamp of
        that start.  `free_ns`: time at which each bus is free again; updated here.
        """
        batches = [
            self._released(sender, manoeuvre, begun_s, span_s, rng, start_ns)
            for sender in self.senders
        ]
        released, counts = FrameBatch.concatenate(batches), [len(batch) for batch in batches]
        messages = [sender.message for sender in self.senders]
        rank = np.repeat([priority(message) for message in messages], counts)
        received_ns = released.t_ns.copy()
        for number, bus in enumerate(self.bench.buses):
            duration_ns = np.repeat([frame_time_ns(m, bus.bitrate) for m in messages], counts)
            rows = np.flatnonzero(released.bus == number)
            if len(rows):
                received_ns[rows] = transmit(
                    released.t_ns[rows], rank[rows], duration_ns[rows], free_ns[number]
                )
                free_ns[number] = int(received_ns[rows].max())
        return replace(released, t_ns=received_ns).by_time()

    def _released(
        self,
        sender: Sender,
        manoeuvre: Manoeuvre,
        begun_s: float,
        span_s: tuple[float, float],
        rng: np.random.Generator,
        start_ns: int,
    ) -> FrameBatch:
        """Return the frames of one message at the times at which its controller releases them.

        Arguments as for `frames`.
        """
        first_tick, tick_s = sender.ticks(*span_s)
        motion_by_delay: dict[float, Kinematics] = {}  # sensors of equal delay show the same motion
        values = {}
        for channel in sender.channels:
            sensor = self.drawn.sensors[channel.name]
            motion_s = tick_s - begun_s - sensor.delay_s  # of the motion that the sensor shows
            if channel.name in manoeuvre.low_passed:
                reading = np.interp(motion_s, *manoeuvre.low_passed[channel.name])
            else:
                if sensor.delay_s not in motion_by_delay:
                    motion_by_delay[sensor.delay_s] = manoeuvre.motion.at(motion_s)
                motion = motion_by_delay[sensor.delay_s]
                reading = true_reading(channel, sensor, self.plants[BASELINE], motion)
            signal, noise = sender.message.signal(signal_of(channel.signal)), self.car.noise
            values[signal.name] = signal_values(channel, signal, sensor, noise, reading, rng)
        # At most half a cycle, because frames of one message must not overtake each other.
        jitter_s = np.minimum(rng.exponential(self.car.jitter_s, len(tick_s)), sender.cycle_s / 2)
        message, n = sender.message, len(tick_s)
        return FrameBatch(
            t_ns=start_ns + np.rint((tick_s + jitter_s) * 1e9).astype(np.int64),
            can_id=np.full(n, message.can_id, np.uint32),
            flags=np.full(n, FrameFlag.EXTENDED if message.is_extended else 0, np.uint16),
            bus=np.full(n, message.bus or 0, np.uint8),
            length=np.full(n, message.length, np.uint8),
            data=self.codec.encode(message.name, values, first_tick),
        )


def campaign_frames(
    bench: Bench, codec: Codec, car: SimulatedCar, seed: int, start_ns: int
) -> Iterator[FrameBatch]:
    """Yield the frames of a campaign, a block a run: rest (`car.lead_s`), a board, free decay.

    `seed`: determines every draw (`SimulatedCar.draw`) and all noise.  `start_ns`: time stamp of
    the start, ns.  Time and counters continue from run to run.  Messages without channels are not
    sent.  Raises InputError if a channel's signal is not in the DBC, its message has no cycle time
    or is too long for classic CAN, its unit does not fit, or the weights would tip the car over.
    """
    rig = rig_of(bench, codec, car, seed)
    free_ns = [start_ns] * len(bench.buses)
    for number, step in enumerate(bench.campaign.steps):
        rng = np.random.default_rng([seed, 1, number])
        start_s = number * car.run_s
        height_m, bump_s = bench.campaign.bump_height_m, bench.campaign.bump_s
        bump = Bump(step.excitation, height_m, car.lead_s, bump_s)
        motion = rig.plants[step.mass_state].drive(bump, car.run_s)
        manoeuvre = rig.manoeuvre(motion, car.run_s, car.run_s)
        span_s = (start_s, start_s + car.run_s)
        yield rig.frames(manoeuvre, start_s, span_s, rng, start_ns, free_ns)


def bench_senders(bench: Bench, codec: Codec, drawn: Truth) -> tuple[Sender, ...]:
    """Return the messages that carry the bench's channels.

    Raises InputError if a channel does not fit the DBC, or its message cannot be sent in cycles.
    """
    channels_of: dict[str, list[Channel]] = {}
    for mapped in mapped_channels(bench, codec):
        channels_of.setdefault(mapped.message.name, []).append(mapped.channel)
    senders = []
    for name, channels in channels_of.items():
        message = codec.message(name)
        if message.cycle_s is None:
            reason = f"message {name} has no cycle time"
            advice = "state cycle_ms for it in a [[message]] of bench.toml"
            raise InputError(bench.dbc_name, reason, advice)
        if message.length > 8:
            reason = f"message {name} has {message.length} bytes"
            advice = "the simulated bench sends classic CAN, at most 8 bytes"
            raise InputError(bench.dbc_name, reason, advice)
        senders.append(Sender(message, message.cycle_s, drawn.clocks[name], tuple(channels)))
    return tuple(senders)


def rig_of(bench: Bench, codec: Codec, car: SimulatedCar, seed: int) -> Rig:
    """Return a bench with a car whose true values are drawn; raises as `campaign_frames`."""
    drawn = car.draw(bench.channels, bench.mass_states, seed)
    plants = {}
    for name, added in drawn.mass_states.items():
        try:
            plants[name] = car.plant(added)
            _ = plants[name].rest  # raises where it does not stand
        except ValueError as error:
            reason = f"mass state {name}: {error}"
            raise InputError("bench.toml", reason, "move the weights inwards") from error
    senders = bench_senders(bench, codec, drawn)
    return Rig(bench, codec, car, drawn, senders, plants)


def frame_time_ns(message: MessageLayout, bitrate: int) -> int:
    """Return the time that a frame occupies the bus, ns.

    With the most stuff bits that can occur, and the gap between frames: no real frame is longer.
    """
    # From start of frame to the end of the checksum bits may be stuffed: one in four after the
    # first.  The last 13 bits (delimiters, acknowledge, end, gap) never are.
    stuffable = (54 if message.is_extended else 34) + 8 * message.length
    return round((stuffable + (stuffable - 1) // 4 + 13) * 1_000_000_000 / bitrate)


def priority(message: MessageLayout) -> int:
    """Return the message's rank in arbitration; the lowest rank wins."""
    # Identifiers are compared from their leading bit: 11 bits rank as 29 with 18 zeros behind.  The
    # last bit of the rank lets the 29-bit identifier lose against the 11-bit one that begins alike.
    return 2 * message.can_id + 1 if message.is_extended else 2 * (message.can_id << 18)


def transmit(
    release_ns: NDArray[np.int64],
    rank: NDArray[np.int64],
    duration_ns: NDArray[np.int64],
    free_ns: int,
) -> NDArray[np.int64]:
    """Return when each frame, (n,), has been received over a bus that carries one at a time.

    Whenever the bus is free, the waiting frame of the lowest rank is sent; equal ranks are sent in
    order of release.  `release_ns`, `rank`, `duration_ns`: of each frame, (n,), in any order.
    `free_ns`: time until which the bus is busy.
    """
    n = len(release_ns)
    order = np.argsort(release_ns, kind="stable")  # the lists below are in order of release
    releases_ns, ranks = release_ns[order].tolist(), rank[order].tolist()
    durations_ns = duration_ns[order].tolist()
    ends_ns = [0] * n
    waiting: list[tuple[int, int]] = []  # heap of ranks and indices of the lists
    now_ns, released = free_ns, 0
    for _ in range(n):
        if not waiting:
            now_ns = max(now_ns, releases_ns[released])
        while released < n and releases_ns[released] <= now_ns:
            heappush(waiting, (ranks[released], released))
            released += 1
        _, frame = heappop(waiting)
        now_ns += durations_ns[frame]
        ends_ns[frame] = now_ns
    received_ns = np.empty(n, np.int64)
    received_ns[order] = ends_ns
    return received_ns
