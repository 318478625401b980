"""Flat, stuck and too fine: closed-form records on either side of each limit, all callers alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import SI_UNITS, Channel, Quantity
from daq.runs import Losses
from daq.samples.clock import counter_steps
from daq.samples.converter import (
    HealthState,
    advance,
    flat_tops,
    is_fine,
    is_stuck,
    longest_hold,
)
from daq.vehicle import Corner
from dbc.frames import FrameBatch, FrameFlag

from ..small_campaign import START_NS, blocks, frames_at, small_codec

RATE_HZ = 1000.0
STEP = 0.01
T_S = np.arange(-1000, 2600) / RATE_HZ
HUB = Channel("hub_acc_fl", Quantity.HUB_ACCELERATION, "m/s2", "HUB.a", corner=Corner.FRONT_LEFT)
Array = NDArray[np.float64]


def decay(amplitude: float = 40.0, noise: float = 0.0, seed: int = 1) -> Array:
    """Return a wheel's free decay at 12 Hz from 0 s on, in steps of the converter."""
    swing = amplitude * np.exp(-8.0 * T_S) * np.sin(2 * np.pi * 12.0 * T_S)
    value = np.where(T_S > 0.0, swing, 0.0)
    value = value + noise * np.random.default_rng(seed).standard_normal(len(T_S))
    return np.asarray(STEP * np.rint(value / STEP))


def topped(samples: int, jump_steps: float, noise: float = 0.02) -> Array:
    """Return a decay with one plateau above all, entered and left by a jump."""
    value = decay(noise=noise)
    top = float(value.max()) + 1.0
    at = 1300
    value[at : at + samples] = top
    value[[at - 1, at + samples]] = top - jump_steps * STEP
    return value


def test_a_plateau_is_given_by_its_first_sample_and_the_one_behind_its_last() -> None:
    assert flat_tops(topped(12, 50.0)) == ((1300, 1312),)
    assert flat_tops(-topped(12, 50.0)) == ((1300, 1312),)


@pytest.mark.parametrize(
    ("noise", "samples", "flat"),
    [(50.0, 2, False), (50.0, 3, True), (0.5, 3, False), (0.5, 4, True), (0.02, 5, False),
     (0.02, 12, True)],
)  # fmt: skip
def test_how_many_equal_samples_are_no_chance(noise: float, samples: int, flat: bool) -> None:
    """Noise of s steps repeats a value with odds 0.28 / s: at most one in a million for a top."""
    assert bool(flat_tops(topped(samples, 5000.0, noise))) is flat


@pytest.mark.parametrize(("jump", "flat"), [(4.0, False), (5.0, True)])
def test_a_flat_top_has_steep_sides(jump: float, flat: bool) -> None:
    assert bool(flat_tops(topped(12, jump))) is flat
    for side in (1299, 1312):
        one_sided = topped(12, 50.0)
        one_sided[side] = one_sided[1300] - jump * STEP
        assert bool(flat_tops(one_sided)) is flat


@pytest.mark.parametrize("noise_steps", [0.0, 0.3, 1.0, 5.0, 20.0])
@pytest.mark.parametrize("seed", range(3))
def test_no_decay_has_a_top_by_chance(noise_steps: float, seed: int) -> None:
    assert flat_tops(decay(noise=noise_steps * STEP, seed=seed)) == ()


@pytest.mark.parametrize("noise_steps", [0.0, 0.3, 1.0, 5.0, 20.0])
def test_a_decay_cut_at_half_its_height_is_found_at_any_noise(noise_steps: float) -> None:
    tops = flat_tops(np.minimum(decay(noise=noise_steps * STEP), 15.0))
    assert tops
    assert all(1000 < first < stop for first, stop in tops)


def test_a_few_equal_samples_prove_nothing_where_values_repeat() -> None:
    """A coarse sensor stays on its value in one sample of three, so four in a row are chance."""
    value = np.tile([0.0, 6.0, 6.0, 0.0, 7.0, 0.0, 6.0, 6.0, 12.0, 6.0, 0.0], 100) * STEP
    value[500:504] = 20 * STEP
    value[[499, 504]] = 0.0
    assert flat_tops(value) == ()
    value[500:540] = 20 * STEP
    value[540] = 0.0
    assert flat_tops(value) == ((500, 540),)


@pytest.mark.parametrize(
    ("held", "changes", "stuck"),
    [(19, 1.0, False), (20, 1.0, True), (39, 0.5, False), (40, 0.5, True), (500, np.nan, False)],
)
def test_a_value_is_stuck_after_twenty_changes_that_did_not_come(
    held: int, changes: float, stuck: bool
) -> None:
    assert is_stuck(held, changes) is stuck


@pytest.mark.parametrize(
    ("quantity", "coarse", "fine"),
    [
        (Quantity.HUB_ACCELERATION, 0.051, 0.049),
        (Quantity.BODY_ACCELERATION, 0.051, 0.049),
        (Quantity.PITCH_RATE, 0.011, 0.009),
        (Quantity.ROLL_ACCELERATION, 0.051, 0.049),
    ],
)
def test_steps_below_the_noise_are_fine(quantity: Quantity, coarse: float, fine: float) -> None:
    assert is_fine(quantity, SI_UNITS[quantity], fine)
    assert not is_fine(quantity, SI_UNITS[quantity], coarse)
    # A displacement is never fine.
    assert not is_fine(Quantity.SUSPENSION_TRAVEL, "m", 1e-9)


#  -------------------------------------------------------------------------------------------------


def _ns(t_ms: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.rint(t_ms * 1e6).astype(np.int64)


@pytest.mark.parametrize("modulus", [16, 256])
def test_lost_frames_are_counted_over_whole_turns(modulus: int) -> None:
    rng = np.random.default_rng(1)
    k = np.flatnonzero(rng.random(20_000) > 0.3)
    k = k[(k < 5000) | (k > 9000)]
    steps = counter_steps(k % modulus, modulus, _ns(k + 0.3 * rng.random(len(k))), 1e-3)
    np.testing.assert_array_equal(steps.step, np.diff(k))
    assert steps.missing == k[-1] - k[0] + 1 - len(k)


@pytest.mark.parametrize("stall_ms", [20, 300, 900])
def test_a_backlog_that_arrives_at_once_is_no_loss(stall_ms: int) -> None:
    k = np.arange(3000)
    arrival = np.where((k > 1000) & (k < 1000 + stall_ms), 1000.0 + stall_ms, k)
    steps = counter_steps(k % 256, 256, _ns(arrival), 1e-3)
    assert steps.missing == 0
    assert not steps.restarted.any()
    assert steps.last_delay_s < 1e-3


@pytest.mark.parametrize("pause_s", [2.6, 3.3, 11.0, 128.0, 256.0, 257.0])
def test_a_sender_that_paused_has_lost_nothing(pause_s: float) -> None:
    """By the time alone it were 256 frames after 2.6 s, and 25,600 after 256 s."""
    arrival = np.arange(200.0) * 10
    arrival[100:] += pause_s * 1e3
    steps = counter_steps(np.arange(200) % 256, 256, _ns(arrival), 0.01)
    assert steps.missing == 0
    np.testing.assert_array_equal(np.flatnonzero(steps.restarted), [99])
    assert steps.last_delay_s < 1e-9


@pytest.mark.parametrize(("cycles", "missing"), [(97, 96), (113, 0)])
def test_a_silence_of_a_second_is_a_pause(cycles: int, missing: int) -> None:
    """At 100 Hz, with a counter of four bits: 0.97 s and 1.13 s are whole turns and one frame."""
    arrival = np.arange(40.0) * 10
    arrival[20:] += (cycles - 1) * 10
    assert counter_steps(np.arange(40) % 16, 16, _ns(arrival), 0.01).missing == missing


def test_without_a_cycle_the_counter_is_taken_at_its_word() -> None:
    steps = counter_steps(np.array([250, 255, 3]), 256, _ns(np.array([0.0, 1, 9000])), None)
    np.testing.assert_array_equal(steps.step, [5, 4])
    assert steps.missing == 7


@pytest.mark.parametrize(
    ("counter", "late_s"),
    [
        (np.arange(21), 0.02),
        (np.delete(np.arange(22), 5), 0.0195),
        (np.concatenate([np.arange(11), np.arange(10)]), 0.02),
    ],
    ids=["whole", "one lost", "a restart"],
)
def test_a_delay_is_carried_over_and_forgotten_by_a_twentieth(
    counter: NDArray[np.int64], late_s: float
) -> None:
    """The first of the frames is 3 cycles late; 20 (21) cycles later one of them is forgotten."""
    sent = np.arange(21) + (np.arange(21) >= 5) * (counter[5] == 6)
    steps = counter_steps(counter, 256, _ns(sent * 10.0), 0.01, 0.03)
    assert steps.last_delay_s == pytest.approx(late_s)


#  -------------------------------------------------------------------------------------------------

CODEC = small_codec()


def _frames(n: int) -> FrameBatch:
    """Two messages in turn, 1 ms each; what else a bus carries is added by the tests."""
    front, rear = CODEC.message("HUB_Front"), CODEC.message("HUB_Rear")
    data = np.empty((2 * n, 8), np.uint8)
    zeros = np.zeros(n)
    data[0::2] = CODEC.encode("HUB_Front", {"acc_fl": zeros}, counter_start=200)
    data[1::2] = CODEC.encode("HUB_Rear", {"acc_rl": zeros})
    can_id = np.tile([front.can_id, rear.can_id], n)
    return frames_at(START_NS + np.arange(2 * n) * 500_000, data, can_id, 6)


def _health(frames: FrameBatch, size: int) -> HealthState:
    state = HealthState()
    for block in blocks(frames, size):
        state = advance(CODEC.messages, state, CODEC.decode(block))
    return state


@pytest.mark.parametrize("size", [7, 200, 10_000])
def test_lost_frames_are_counted_whatever_the_blocks(size: int) -> None:
    frames = _frames(1500)
    lost = np.zeros(len(frames), bool)
    lost[[100, 101, 102, 777]] = True
    lost[1200:1400] = True
    state = _health(frames.select(~lost), size)
    assert state.losses == Losses(counter_gaps=204)
    assert state.counters["HUB_Front"].missing == 2 + 100
    assert state.counters["HUB_Rear"].missing == 2 + 100
    received = sum(counter.received for counter in state.counters.values())
    assert received == len(frames) - 204


@pytest.mark.parametrize("size", [50, 10_000])
def test_garbled_frames_are_counted_once(size: int) -> None:
    frames = _frames(500)
    data = frames.data.copy()
    data[[0, 1, 300, 302, 304, 999], 0] ^= 0x10
    garbled = replace(frames, data=data)
    assert _health(garbled, size).losses == Losses(crc_bad=6)
    lost = np.arange(len(frames)) == 306
    assert _health(garbled.select(~lost), size).losses == Losses(crc_bad=6, counter_gaps=1)


def test_what_is_not_decoded_is_counted_by_kind() -> None:
    frames = _frames(100)
    flags, ids, length = frames.flags.copy(), frames.can_id.copy(), frames.length.copy()
    flags[[0, 2]] = FrameFlag.ERROR
    flags[4] = FrameFlag.REMOTE
    ids[[1, 3, 5]] = 0x7AB
    length[195] = 2
    found = _health(replace(frames, can_id=ids, flags=flags, length=length), 10).losses
    assert (found.error_frames, found.remote_frames, found.unknown_id) == (2, 1, 3)
    assert found.wrong_length == 1


def test_a_restart_of_a_sensor_is_reported_and_not_taken_for_loss() -> None:
    first = _frames(300)
    later = replace(first, t_ns=first.t_ns + 300_000_000)
    state = _health(FrameBatch.concatenate([first, later]), 100)
    assert state.losses.counter_gaps == 0
    assert [counter.restarts for counter in state.counters.values()] == [1, 1]


# The longest hold of a value in a run, and when it is too long to be chance -----------------------

T_S_OF_HOLD = np.arange(2000) / 1000.0
"""A run of 2 s at 1 kHz: at rest until 0.3 s, the decay from 0.5 s on."""


def test_rates_are_those_of_the_rest_and_of_the_decay_and_not_of_the_bump() -> None:
    value = np.zeros(2000)
    value[:300:3] = 1.0  # 200 of 299 differences
    value[300:500] = np.arange(200)
    value[500:] = np.arange(1500) // 10  # one of ten
    found = longest_hold(T_S_OF_HOLD, value, 0.3, 0.5)
    assert found.rest_rate == pytest.approx(2 / 3, abs=0.01)
    assert found.decay_rate == pytest.approx(0.1, abs=0.001)
    assert (found.n_equal, found.constant) == (10, False)
