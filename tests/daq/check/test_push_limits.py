"""When a push by hand counts, is over, and went the right way, on deviations made by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.channels import Channel, Quantity
from daq.check.push_test import ORDER, PushResult, judge_push
from daq.check.pushes import Pushes, Trace, find_pushes
from daq.vehicle import Corner

Array = NDArray[np.float64]
FL, FR, RL, RR = Corner
START_NS = 1_800_000_000_000_000_000


def channel(quantity: Quantity, name: str = "c", **facts: Any) -> Channel:
    if quantity is Quantity.SUSPENSION_TRAVEL:
        facts = {"corner": FL, **facts}
    return Channel(name, quantity, signal=f"M.{name}", **facts)


def lane(values: Sequence[float] | Array, at: int = 50, n: int = 100) -> Array:
    """Return a channel at rest in bins of 0.1 s, that shows these values from one bin on."""
    shown = np.zeros(n)
    shown[at : at + len(values)] = values
    return shown


def judged(
    corner: Corner, lanes: Mapping[Channel, Array], begin: int = 0, bin_s: float = 0.1
) -> PushResult:
    pairs = {c.name: (value - 1e-6, value + 1e-6) for c, value in lanes.items()}
    return judge_push(corner, tuple(lanes), pairs, begin, bin_s)


@pytest.mark.parametrize(
    ("quantity", "least"),
    [
        (Quantity.SUSPENSION_TRAVEL, 3e-3),
        (Quantity.BODY_DISPLACEMENT, 3e-3),
        (Quantity.PITCH_RATE, 0.01),
        (Quantity.ROLL_RATE, 0.01),
    ],
)
def test_a_push_moves_each_kind_of_channel_by_so_much(quantity: Quantity, least: float) -> None:
    for share, done in ((0.99, False), (1.01, True)):
        result = judged(FL, {channel(quantity): lane([share * least, -share * least])})
        assert result.done is done
        assert result.text.startswith("push DOWN at the front LEFT") is not done
    assert not judged(FL, {channel(Quantity.PITCH_ACCELERATION): lane([9.0])}).done


@pytest.mark.parametrize(("size", "done"), [(8.8e-3, False), (8.95e-3, True)])
def test_a_push_is_six_times_the_noise(size: float, done: bool) -> None:
    """Of three bins two lie 1 mm from the middle one: the noise is 1.48 mm, and the limit 8.88."""
    noise = np.resize([-1e-3, 0.0, 1e-3], 100)
    noise[50:60] = lane([size], 0, 10)
    for level in (0.0, 0.5):
        result = judged(FL, {channel(Quantity.SUSPENSION_TRAVEL): noise + level})
        assert result.done is done


@pytest.mark.parametrize(("share", "first"), [(0.39, 1), (0.41, -1)])
def test_the_first_way_is_that_of_four_tenths_of_the_peak(share: float, first: int) -> None:
    rate = channel(Quantity.PITCH_RATE)
    result = judged(FL, {rate: lane([0.001, -0.05 * share, 0.05, -0.02])})
    assert result.done
    assert result.passed is (first > 0)
    assert result.inverted == (() if first > 0 else ("c",))


@pytest.mark.parametrize(
    ("moving", "after", "done"),
    [(1, 5, False), (1, 6, True), (45, 5, False), (46, 5, True), (50, 1, True), (49, 1, False)],
)
def test_a_push_is_over_after_rest_or_after_five_seconds(
    moving: int, after: int, done: bool
) -> None:
    """0.6 s of rest, or 5 s since the movement began."""
    value = lane([0.02] * moving, 120 - after - moving, 120)
    result = judged(FL, {channel(Quantity.SUSPENSION_TRAVEL): value})
    assert result.done is done
    assert result.text.startswith("moving") is not done


def test_the_last_channel_to_come_to_rest_counts_and_the_first_that_moved() -> None:
    travel, rate = channel(Quantity.SUSPENSION_TRAVEL), channel(Quantity.PITCH_RATE, "p")
    lanes = {travel: lane([0.02], 50), rate: lane([0.05], 96)}
    assert not judged(FL, lanes).done
    assert judged(FL, {travel: lane([0.02], 40), rate: lane([0.05], 98)}).done


def test_what_moved_before_does_not_count() -> None:
    lanes = {channel(Quantity.SUSPENSION_TRAVEL): lane([0.02], 50)}
    assert judged(FL, lanes, begin=50).done
    assert not judged(FL, lanes, begin=51).done


@pytest.mark.parametrize("corner", Corner)
def test_each_corner_turns_the_body_its_own_way(corner: Corner) -> None:
    """Down at the front is nose down (+); positive roll lifts the left side."""
    pitch = 1 if corner in (FL, FR) else -1
    roll = -1 if corner in (FL, RL) else 1
    for quantity, way in ((Quantity.PITCH_RATE, pitch), (Quantity.ROLL_RATE, roll)):
        for turned in (1, -1):
            result = judged(corner, {channel(quantity): lane([0.05 * way * turned])})
            assert result.passed is (turned > 0)
            assert result.done


@pytest.mark.parametrize(
    ("corner", "x_m", "y_m", "sinks"),
    [
        # Half a wheelbase is 1.4 m and half a track 0.75 m: 1 + u u' + v v' is 0.41 or 0.39.
        (FL, -2.226, 0.0, True),
        (FL, -2.254, 0.0, False),
        (FR, -2.226, 0.0, True),
        (RL, -0.574, 0.0, True),
        (RR, -0.546, 0.0, False),
        (FL, -1.4, -0.4425, True),
        (RL, -1.4, -0.4575, False),
        (FR, -1.4, 0.4425, True),
        (RR, -1.4, 0.4575, False),
        (FL, 0.0, 0.75, True),
    ],
)
def test_a_point_of_the_body_sinks_with_the_corner_it_is_near(
    corner: Corner, x_m: float, y_m: float, sinks: bool
) -> None:
    point = channel(Quantity.BODY_DISPLACEMENT, x_m=x_m, y_m=y_m)
    assert judged(corner, {point: lane([-0.01])}).passed
    assert judged(corner, {point: lane([0.01])}).passed is not sinks


def test_the_cg_sinks_with_every_corner() -> None:
    for corner in Corner:
        point = channel(Quantity.BODY_DISPLACEMENT, x_m=-9.0, at_cg=True)
        assert not judged(corner, {point: lane([0.01])}).passed


def test_what_was_seen_is_said_in_millimetres_or_in_the_unit() -> None:
    travel, rate = channel(Quantity.SUSPENSION_TRAVEL), channel(Quantity.PITCH_RATE, "p")
    both = {rate: lane([0.05]), travel: lane([0.0124, -0.005])}
    assert judged(FL, both).text.startswith("c moved +12 mm")
    assert judged(FL, {rate: lane([0.053])}).text.startswith("p moved +0.053 rad/s")
    one = {travel: lane([0.012]), channel(Quantity.SUSPENSION_TRAVEL, "d", corner=RR): lane([0.02])}
    assert judged(FL, one).text == "RR moved: c and d are swapped"


def trace(
    heights: Sequence[float], length_s: float = 0.2, apart_s: float = 3.0, noise: float = 0.0
) -> tuple[NDArray[np.int64], Array]:
    """Return pushes at 1 s, 4 s and so on, 200 samples a second, about a level of 5."""
    time_s = np.arange(round(200 * (1.0 + apart_s * (len(heights) - 1) + length_s + 2.0))) / 200
    value = np.zeros(len(time_s))
    value[:100] = noise * np.resize([1.0, -1.0], 100)
    for k, height in enumerate(heights):
        begin = 1.0 + k * apart_s - 1e-4
        value[(time_s >= begin) & (time_s < begin + length_s)] = height
    # A little after the edges of bins of 0.05 s.
    return START_NS + np.rint(time_s * 1e9).astype(np.int64) + 1_000_000, 5.0 + value


def pushes(*traces: Trace) -> Pushes:
    found, number = find_pushes({str(k): each for k, each in enumerate(traces)})
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
    assert find_pushes({"a": trace([1.0] * 4, length_s, apart_s)})[1] == number


@pytest.mark.parametrize(("small", "number"), [(0.19, 3), (0.21, 4)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_push_reaches_a_fifth_of_the_largest(small: float, number: int, sign: float) -> None:
    found, seen = find_pushes({"a": trace([1.0, sign * small, -1.0, 0.5])})
    assert seen == number
    assert (found is None) is (number != 4)


@pytest.mark.parametrize(("height", "number"), [(8.05, 0), (8.1, 4)])
def test_a_push_is_eight_times_the_noise_and_a_thousandth_of_the_span(
    height: float, number: int
) -> None:
    """Noise of 1 and a span of h + 1: h is 8 (1 + (h + 1) / 1000) at 8.0726."""
    assert find_pushes({"a": trace([height] * 4, noise=1.0)})[1] == number


def test_signals_add_up_and_those_without_rest_do_not_count() -> None:
    one, two = trace([1.0, 0.0, 1.0, 0.0]), trace([0.0, 1.0, 0.0, 1.0])
    assert find_pushes({"a": one})[1] == 2
    assert list(pushes(one, two).spans) == list(ORDER)
    for first, number in ((97, 4), (98, 2)):  # three samples within half a second, or two
        late = two[0][first:], two[1][first:]
        assert find_pushes({"a": one, "b": late})[1] == number
    assert find_pushes({}) == (None, 0)
    assert find_pushes({"a": (one[0][:1], one[1][:1])}) == (None, 0)


def test_peaks_and_turns_of_each_push() -> None:
    t_ns, value = trace([1.0, -2.0, 3.0, -4.0])
    found = pushes((t_ns, value))
    expected = dict(zip(ORDER, (1.0, -2.0, 3.0, -4.0), strict=True))
    assert found.peaks((t_ns, value)) == pytest.approx(expected)
    # 0.2 s at a rate of r: an angle of 0.2 r, which stays.
    turned = {corner: 0.2 * peak for corner, peak in expected.items()}
    assert found.turns((t_ns, value)) == pytest.approx(turned)
    before = t_ns < found.spans[FL][0]
    assert found.peaks((t_ns[before], value[before])) == dict.fromkeys(ORDER, 0.0)
    assert found.turns((t_ns[before], value[before])) == dict.fromkeys(ORDER, 0.0)


@pytest.mark.parametrize(("begin", "passed"), [(48, True), (53, False)])
def test_a_push_that_is_under_way_at_the_key_press_is_not_judged(begin: int, passed: bool) -> None:
    """Its rebound alone would tell to invert a sign that is right."""
    travel = channel(Quantity.SUSPENSION_TRAVEL)
    pushed = [0.005, 0.02, 0.02, 0.005, -0.012, -0.008, 0.004]
    result = judged(FL, {travel: lane(pushed)}, begin)
    assert (result.done, result.passed, result.inverted) == (passed, passed, ())
    again = lane(pushed)
    again[80:87] = pushed
    assert judged(FL, {travel: again}, begin).passed


def test_a_body_that_rests_elsewhere_after_a_push_can_be_pushed_again() -> None:
    travel = channel(Quantity.SUSPENSION_TRAVEL)
    stuck = lane([0.02, 0.01], 150, 400)
    stuck[152:] = 0.006
    stuck[300:302] = [0.03, 0.0]
    assert judged(FL, {travel: stuck}, 250).passed
