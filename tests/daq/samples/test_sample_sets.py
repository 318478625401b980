"""Which frames belong to one sample, on arrivals that are written down here."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from daq.samples.groups import bind, bind_counted, group_names
from dbc.samples import Samples

MS = 1_000_000


def bound(
    numbers: Sequence[int], carriers_ms: Sequence[float], frames_ms: Sequence[float]
) -> dict[int, int]:
    """Return the sample number of each frame that belongs to one."""
    rows, found = bind(
        np.array(numbers),
        np.rint(np.array(carriers_ms) * MS).astype(np.int64),
        np.arange(len(frames_ms)),
        np.rint(np.array(frames_ms) * MS).astype(np.int64),
    )
    assert np.all(np.diff(found) > 0)
    return dict(zip(rows.tolist(), found.tolist(), strict=True))


@pytest.mark.parametrize(
    ("numbers", "carriers_ms", "frames_ms", "expected"),
    [
        ((5, 6, 7), (0, 10, 20), (1, 11, 21), {0: 5, 1: 6, 2: 7}),
        ((5, 6, 7), (0, 10, 20), (4.9, 14.9, 24.9), {0: 5, 1: 6, 2: 7}),
        ((5, 6, 7), (0, 10, 20), (-4.9, 5.1, 15.1), {0: 5, 1: 6, 2: 7}),  # ahead of the carrier
        ((5, 6, 7), (0, 10, 20), (-9, 1, 11), {1: 5, 2: 6}),  # before the first
        ((5, 6, 7), (0, 10, 20), (0, 10, 20), {0: 5, 1: 6, 2: 7}),  # at one instant
        ((5, 6), (0, 10), (1, 2, 11), {0: 5, 2: 6}),  # one came twice
        ((5, 8, 9), (0, 30, 40), (1, 11, 21, 31), {0: 5, 1: 6, 2: 7, 3: 8}),  # by their count
        ((5, 8, 9), (0, 30, 40), (1, 21, 31), {0: 5, 1: 7, 2: 8}),  # by their time
        ((5, 8, 9), (0, 30, 40), (1, 17.4, 31), {0: 5, 1: 6, 2: 8}),
        ((5, 8, 9), (0, 30, 40), (1, 17.6, 31), {0: 5, 1: 7, 2: 8}),
        ((5, 8, 9), (0, 30, 40), (1, 29.9, 31), {0: 5, 1: 7, 2: 8}),  # never beyond the next one
        ((5, 8, 9), (0, 30, 40), (-1, 29, 39), {0: 5, 1: 8, 2: 9}),
        ((5,), (0,), (1,), {0: 5}),
        ((5,), (0,), (-1,), {}),
        ((5, 6), (0, 10), (), {}),
    ],
)
def test_frames_belong_to_the_carrier_they_are_sent_with(
    numbers: Sequence[int],
    carriers_ms: Sequence[float],
    frames_ms: Sequence[float],
    expected: dict[int, int],
) -> None:
    assert bound(numbers, carriers_ms, frames_ms) == expected


def counted(
    numbers: Sequence[int],
    carriers_ms: Sequence[float],
    frames: Sequence[tuple[float, int]],
    modulus: int,
) -> dict[int, int]:
    """Return the sample number of each frame, which is at a time and has a counter."""
    t_ns = np.array([round(t * MS) for t, _ in frames], np.int64)
    values = np.array([value for _, value in frames], np.float64)
    own = Samples("M.counter", t_ns, values, np.zeros(len(frames), np.uint8))
    rows, found = bind_counted(
        np.array(numbers),
        np.array(numbers, np.float64) % modulus,
        np.rint(np.array(carriers_ms) * MS).astype(np.int64),
        np.arange(len(frames)),
        own,
        modulus,
    )
    return dict(zip(rows.tolist(), found.tolist(), strict=True))


@pytest.mark.parametrize(
    ("numbers", "carriers_ms", "frames", "modulus", "expected"),
    [
        ((100, 101, 102), (0, 10, 20), ((2, 4), (12, 5), (22, 6)), 16, {0: 100, 1: 101, 2: 102}),
        ((100, 101, 102), (0, 10, 20), ((2, 4), (18, 5), (19, 6)), 16, {0: 100, 1: 101, 2: 102}),
        ((15, 16, 17), (0, 10, 20), ((9, 15), (11, 1)), 16, {0: 15, 1: 17}),  # over the wrap
        ((100, 101), (0, 10), ((0, 3), (1, 4), (10, 6)), 16, {1: 100}),  # of no carrier that came
        ((100, 101), (0, 10), ((1, 4), (2, 4)), 16, {0: 100}),  # one came twice
        ((7,), (0,), ((-90, 7), (90, 8)), 16, {0: 7}),
        # A counter of two values: the nearest carrier decides.
        ((0, 1, 2, 3), (0, 10, 20, 30), ((9, 1), (14.9, 1), (15.1, 0)), 2, {0: 1, 2: 2}),
        ((0, 1, 2, 3), (0, 10, 20, 30), ((5, 1), (25, 1)), 2, {0: 1, 1: 3}),
        ((0, 1, 2, 3), (0, 10, 20, 30), ((-9, 0), (39, 1)), 2, {0: 0, 1: 3}),
    ],
)
def test_frames_with_a_counter_belong_to_the_sample_of_that_number(
    numbers: Sequence[int],
    carriers_ms: Sequence[float],
    frames: Sequence[tuple[float, int]],
    modulus: int,
    expected: dict[int, int],
) -> None:
    assert counted(numbers, carriers_ms, frames, modulus) == expected


def test_groups_have_names_that_a_session_file_can_hold() -> None:
    assert group_names(["IMU", "HUB.a", "IMU"]) == {"IMU": "IMU", "HUB.a": "HUB_a"}
    long = "m" * 80
    found = group_names(["m" * 64, long, long + "x", "a.b", "a_b"])
    assert found["m" * 64] == "m" * 64
    assert all(len(name) <= 64 for name in found.values())
    assert len(set(found.values())) == 5
    assert found["a.b"] == "a_b"
