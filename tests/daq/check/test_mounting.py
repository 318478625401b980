"""How sensors are mounted, from gravity and from pushes on the corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.check.pushes import ORDER, Pushes, Trace, axis_of, find_pushes, mounting, pushed_corner
from daq.vehicle import Corner

FL, FR, RL, RR = Corner
UP = {"x": 0.0, "y": 0.0, "z": 1.0}
START_NS = 1_800_000_000_000_000_000


@pytest.mark.parametrize(
    ("gravity", "up"),
    [
        ((0.0, 0.0, 1.0), ("z", 1)),
        ((0.0, 0.1, -0.98), ("z", -1)),
        ((1.02, 0.0, 0.0), ("x", 1)),
        ((0.43, 0.0, 0.903), ("z", 1)),  # 25 degrees
        ((0.45, 0.0, 0.893), None),  # 27 degrees
        ((0.0, 0.0, 1.11), None),
        ((0.0, 0.0, 1.09), ("z", 1)),
        ((0.0, 0.0, 0.0), None),
    ],
)
def test_up_is_where_gravity_is(
    gravity: tuple[float, float, float], up: tuple[str, int] | None
) -> None:
    found = mounting(dict(zip("xyz", gravity, strict=True)), None)
    assert (axis_of(found.up) if found else None) == up


def test_the_pushes_show_every_way_to_mount_an_imu() -> None:
    # Pitch is positive nose down, roll positive lifts the left side.
    car = {FL: (1.0, -0.7), FR: (1.0, 0.7), RL: (-1.0, -0.7), RR: (-1.0, 0.7)}
    eye = np.eye(3)
    tried = 0
    for up in (*eye, *-eye):
        for forward in (*eye, *-eye):
            if up @ forward:
                continue
            left = np.cross(up, forward)
            turns = {c: pitch * left + roll * forward for c, (pitch, roll) in car.items()}
            seen = {c: dict(zip("xyz", turn.tolist(), strict=True)) for c, turn in turns.items()}
            found = mounting(dict(zip("xyz", up.tolist(), strict=True)), seen)
            assert found is not None
            assert found.surely_forward
            np.testing.assert_array_equal(found.up, up)
            np.testing.assert_array_equal(found.forward, forward)
            np.testing.assert_array_equal(found.left, left)
            tried += 1
    assert tried == 24


@pytest.mark.parametrize(("roll", "sure"), [(-0.35, True), (-0.3, False)])
def test_forward_explains_the_pushes_twice_as_well_as_the_next_best(
    roll: float, sure: bool
) -> None:
    """A push at the front left turns by 1 about y: forward fits by 1 - roll, right by 1 + roll."""
    for size in (1.0, 100.0):
        found = mounting(UP, {FL: {"x": roll * size, "y": size}})
        assert found is not None
        assert found.surely_forward is sure
        assert axis_of(found.forward) == ("x", 1)


def test_the_axis_that_is_stated_is_taken_unless_it_is_vertical() -> None:
    turns = {FL: {"x": -1.0, "y": 1.0}}
    for stated, axis in (("-y", ("y", -1)), ("+y", ("y", 1)), ("-x", ("x", -1)), ("+z", ("x", 1))):
        found = mounting(UP, turns, stated)
        assert found is not None
        assert (axis_of(found.forward), found.surely_forward) == (axis, True)


@pytest.mark.parametrize(
    ("up", "forward"),
    [((0, 0, 1), ("x", 1)), ((0, 0, -1), ("x", 1)), ((0, 1, 0), ("x", 1)), ((1, 0, 0), ("z", -1)),
     ((-1, 0, 0), ("z", 1))],
)  # fmt: skip
@pytest.mark.parametrize("turns", [None, {corner: dict.fromkeys("xyz", 0.0) for corner in Corner}])
def test_without_pushes_x_is_forward_or_else_z(
    up: tuple[int, int, int],
    forward: tuple[str, int],
    turns: dict[Corner, dict[str, float]] | None,
) -> None:
    found = mounting(dict(zip("xyz", map(float, up), strict=True)), turns)
    assert found is not None
    assert (axis_of(found.forward), found.surely_forward) == (forward, False)


@pytest.mark.parametrize(
    ("peaks", "other", "place"),
    [
        ((0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), None),  # a dead one
        ((10.0, -4.9, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0), (FL, 1)),
        ((10.0, -5.1, 1.0, 0.0), (0.0, 0.0, 0.0, 0.0), None),
        ((1.0, 0.0, 0.0, -2.0), (-1.9, 9.0, 0.0, -1.9), (RR, -1)),
        ((2.0, 1.0, 0.0, 0.0), (-2.1, 0.0, 0.0, 0.0), None),
    ],
)
def test_a_travel_is_where_its_own_push_moves_it_most(
    peaks: tuple[float, ...], other: tuple[float, ...], place: tuple[Corner, int] | None
) -> None:
    one, two = (dict(zip(Corner, each, strict=True)) for each in (peaks, other))
    assert pushed_corner(one, [two]) == place


# Pushes in a recording ----------------------------------------------------------------------------


def trace(
    heights: Sequence[float], length_s: float = 0.2, apart_s: float = 3.0, noise: float = 0.0
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return pushes at 1 s, 4 s and so on, 200 samples a second, about a level of 5."""
    time_s = np.arange(round(200 * (1.0 + apart_s * (len(heights) - 1) + length_s + 2.0))) / 200
    value = np.zeros(len(time_s))
    value[:100] = noise * np.resize([1.0, -1.0], 100)
    for k, height in enumerate(heights):
        begin = 1.0 + k * apart_s - 1e-4
        value[(time_s >= begin) & (time_s < begin + length_s)] = height
    # A little after the edges of bins of 0.05 s.
    return START_NS + np.rint(time_s * 1e9).astype(np.int64) + 1_000_000, 5.0 + value


def found_pushes(traces: Mapping[str, Trace]) -> tuple[Pushes | None, int]:
    return find_pushes(traces, list(traces))


def pushes(*traces: Trace) -> Pushes:
    found, number = found_pushes({str(k): each for k, each in enumerate(traces)})
    assert found is not None
    assert number == 4
    return found


def test_four_pushes_are_one_on_each_corner_with_a_quarter_second_around() -> None:
    found = pushes(trace([1.0, 1.0, 1.0, 1.0]))
    begins = [START_NS + 1_000_000 + (3 * k + 1) * 10**9 - 250_000_000 for k in range(4)]
    assert found.spans == {
        corner: (begin, begin + 700_000_000) for corner, begin in zip(ORDER, begins, strict=True)
    }


@pytest.mark.parametrize(
    ("length_s", "apart_s", "number"),
    [
        (0.15, 3.0, 4), (0.1, 3.0, 0),
        (0.2, 0.7, 4), (0.2, 0.65, 1),  # bins with 0.5 s and 0.45 s of rest between them
    ],
)  # fmt: skip
def test_a_push_lasts_long_enough_and_rest_parts_two(
    length_s: float, apart_s: float, number: int
) -> None:
    assert found_pushes({"a": trace([1.0] * 4, length_s, apart_s)})[1] == number


@pytest.mark.parametrize(("small", "number"), [(0.19, 3), (0.21, 4)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_push_reaches_a_fifth_of_the_largest(small: float, number: int, sign: float) -> None:
    found, seen = found_pushes({"a": trace([1.0, sign * small, -1.0, 0.5])})
    assert seen == number
    assert (found is None) is (number != 4)


@pytest.mark.parametrize(("height", "number"), [(8.05, 0), (8.1, 4)])
def test_a_push_is_eight_times_the_noise_and_a_thousandth_of_the_span(
    height: float, number: int
) -> None:
    """Noise of 1 and a span of h + 1: h is 8 (1 + (h + 1) / 1000) at 8.0726."""
    assert found_pushes({"a": trace([height] * 4, noise=1.0)})[1] == number


def test_signals_add_up_and_those_without_rest_do_not_count() -> None:
    one, two = trace([1.0, 0.0, 1.0, 0.0]), trace([0.0, 1.0, 0.0, 1.0])
    assert found_pushes({"a": one})[1] == 2
    assert list(pushes(one, two).spans) == list(ORDER)
    for first, number in ((97, 4), (98, 2)):  # three samples within half a second, or two
        late = two[0][first:], two[1][first:]
        assert found_pushes({"a": one, "b": late})[1] == number
    assert found_pushes({}) == (None, 0)
    assert found_pushes({"a": (one[0][:1], one[1][:1])}) == (None, 0)


def test_peaks_and_turns_of_each_push() -> None:
    t_ns, value = trace([1.0, -2.0, 3.0, -4.0])
    found = pushes((t_ns, value))
    expected = dict(zip(ORDER, (1.0, -2.0, 3.0, -4.0), strict=True))
    assert found.peaks("0") == pytest.approx(expected)
    # 0.2 s at a rate of r: an angle of 0.2 r, which stays.
    turned = {corner: 0.2 * peak for corner, peak in expected.items()}
    assert found.turns("0") == pytest.approx(turned)
    before = t_ns < found.spans[FL][0]
    early = Pushes(found.spans, {"a": (t_ns[before], value[before])})
    assert early.peaks("a") == early.turns("a") == dict.fromkeys(ORDER, 0.0)
