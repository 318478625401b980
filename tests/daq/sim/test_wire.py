"""The simulated wire: frame lengths by the standard, arbitration, no two frames at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daq.sim.wire import frame_time_ns, priority, transmit
from dbc import MessageLayout, parse_codec, shipped_dbc

IMU = parse_codec(shipped_dbc(), "shipped").message("IMU_Accel")


def sized(length: int, is_extended: bool = False) -> MessageLayout:
    return replace(IMU, length=length, is_extended=is_extended)


@pytest.mark.parametrize(
    ("length", "is_extended", "bits"),
    # Published worst cases with stuffing, plus the gap of 3 bits.
    [(0, False, 52 + 3), (8, False, 132 + 3), (0, True, 77 + 3), (8, True, 157 + 3)],
)
def test_frame_times_are_the_worst_case_of_classic_can(
    length: int, is_extended: bool, bits: int
) -> None:
    assert frame_time_ns(sized(length, is_extended), 1_000_000) == 1000 * bits
    assert frame_time_ns(sized(length, is_extended), 500_000) == 2000 * bits


def test_a_waiting_frame_of_higher_priority_goes_first_but_never_interrupts() -> None:
    release = np.array([0, 10, 20, 500])
    rank = np.array([9, 7, 3, 1])
    duration = np.array([100, 100, 100, 50])
    end = transmit(release, rank, duration, free_ns=0)
    assert end.tolist() == [100, 300, 200, 550]


def test_frames_wait_for_a_busy_bus_and_keep_their_order_within_a_message() -> None:
    end = transmit(np.array([5, 0]), np.array([1, 1]), np.array([10, 10]), free_ns=1000)
    assert end.tolist() == [1020, 1010]


def test_arbitration_compares_identifiers_bit_by_bit() -> None:
    low = replace(IMU, can_id=0x100)
    high = replace(IMU, can_id=0x101)
    long_form = replace(IMU, can_id=0x100 << 18, is_extended=True)
    higher_long_form = replace(IMU, can_id=(0x100 << 18) + 1, is_extended=True)
    expected = [low, long_form, higher_long_form, high]
    assert sorted([high, higher_long_form, low, long_form], key=priority) == expected


def test_a_crowded_bus_carries_every_frame_once_and_one_at_a_time() -> None:
    rng = np.random.default_rng(3)
    release = rng.integers(0, 100_000, 900)
    rank = rng.integers(0, 6, 900)
    duration = rng.integers(80, 130, 900)
    end = transmit(release, rank, duration, free_ns=0)
    begin = end - duration
    assert (begin >= release).all()
    order = np.argsort(end)
    assert (begin[order][1:] >= end[order][:-1]).all()
    for i in order[:200]:  # a message that was ready when this one began had no higher priority
        waiting = (release <= begin[i]) & (begin > begin[i])
        assert (rank[waiting] >= rank[i]).all()
