"""What pushes on the corners show of an IMU and of a travel, and what they leave to be asked."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import Quantity
from daq.check.guess_map import Asked, Guess
from daq.check.guess_sensor import guess_bench
from daq.check.propose_message import Seen
from daq.check.pushes import Push, Trace
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.samples import DecodeCounts, Decoded, Samples

from .test_propose_rules import arrivals
from .test_push_limits import pushes, trace

TEXT = (
    'VERSION ""\n\nBU_: A\n\nBO_ 256 Imu: 8 A\n'
    + "".join(
        f' SG_ Acc{a} : {16 * n}|16@1- (1,0) [0|0] "g" A\n' for n, a in enumerate("XYZ")
    )
    + "\nBO_ 257 Rate: 8 A\n"
    + "".join(
        f' SG_ Gyr{a} : {16 * n}|16@1- (1,0) [0|0] "rad/s" A\n' for n, a in enumerate("XYZ")
    )
    + '\nBO_ 258 Pot: 8 A\n SG_ pot_fl : 0|16@1- (1,0) [0|0] "mm" A\n'
)  # fmt: skip
MESSAGES = parse_codec(TEXT, "m.dbc").messages
PUSHED = pushes(trace([1.0, 1.0, 1.0, 1.0]))
QUIET = trace([0.0, 0.0, 0.0, 0.0])


def seen(gravity: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Seen:
    levels = {f"Imu.Acc{a}": g for a, g in zip("XYZ", gravity, strict=True)}
    levels |= {f"Rate.Gyr{a}": 0.0 for a in "XYZ"} | {"Pot.pot_fl": 12.0}
    n = 40
    samples = {
        name: Samples(name, np.arange(n), np.full(n, level), np.zeros(n, np.uint8))
        for name, level in levels.items()
    }
    known = {m.name: arrivals(n, 0.01) for m in MESSAGES}
    return Seen(known, Decoded(samples, DecodeCounts(0, 0, 0, 0, 0)))


def guesses(traces: dict[str, Trace] | None, forward: str = "") -> dict[str, Guess]:
    """Return what is guessed; with pushes if there are traces, of which others are quiet."""
    push = None
    if traces is not None:
        names = [f"{m.name}.{s.name}" for m in MESSAGES for s in m.signals]
        push = Push(PUSHED, {name: traces.get(name, QUIET) for name in names})
    return guess_bench(MESSAGES, {}, seen(), push, {"": forward} if forward else {})


def test_without_pushes_forward_is_asked_and_with_pushes_that_show_nothing_so_is_said() -> None:
    for traces, said in ((None, False), ({}, True)):
        found = guesses(traces)
        roll, pitch, yaw = (found[f"Rate.Gyr{a}"] for a in "XYZ")
        assert (roll.quantity, pitch.quantity, yaw.quantity) == (
            Quantity.ROLL_RATE, Quantity.PITCH_RATE, Quantity.UNUSED,
        )  # fmt: skip
        assert (roll.asked, roll.is_proven) == (Asked.FORWARD, False)
        assert "+x axis" in roll.ask
        assert ("pushes did not show it" in roll.ask) is said
        assert (found["Imu.AccZ"].quantity, found["Imu.AccZ"].ask) == (
            Quantity.BODY_ACCELERATION, "",
        )  # fmt: skip


def test_pushes_show_how_an_imu_is_turned() -> None:
    """Its y axis points forward: it turns about x as the nose goes down, backwards."""
    traces = {
        "Rate.GyrY": trace([-1.0, 1.0, -1.0, 1.0]),  # roll: down on the left is negative
        "Rate.GyrX": trace([-1.0, -1.0, 1.0, 1.0]),  # pitch about -x: nose down is positive
    }
    found = guesses(traces)
    roll, pitch = found["Rate.GyrY"], found["Rate.GyrX"]
    assert (roll.quantity, roll.sign, roll.ask) == (Quantity.ROLL_RATE, 1, "")
    assert (pitch.quantity, pitch.sign, pitch.ask) == (Quantity.PITCH_RATE, -1, "")
    assert roll.is_proven
    assert pitch.is_proven


@pytest.mark.parametrize(("tilt_deg", "ask"), [(4.9, ""), (5.6, "mounted 6 degrees off")])
def test_a_mounting_that_is_tilted_by_more_than_five_degrees_is_asked_about(
    tilt_deg: float, ask: str
) -> None:
    tilt = np.radians(tilt_deg)
    gravity = (0.0, float(np.sin(tilt)), float(np.cos(tilt)))
    vertical = guess_bench(MESSAGES, {}, seen(gravity), None, {})["Imu.AccZ"]
    assert vertical.ask.startswith(ask)
    assert bool(vertical.ask) is bool(ask)


@pytest.mark.parametrize(("forward", "sign"), [("+x", 1), ("-x", -1)])
def test_the_axis_that_a_user_states_needs_no_question(forward: str, sign: int) -> None:
    found = guesses(None, forward)
    roll, pitch = found["Rate.GyrX"], found["Rate.GyrY"]
    assert (roll.sign, pitch.sign, roll.ask, pitch.ask) == (sign, sign, "", "")


@pytest.mark.parametrize(
    ("heights", "corner", "sign", "ask"),
    [
        ([10.0, 1.0, 1.0, 1.0], Corner.FRONT_LEFT, 1, ""),
        ([-10.0, 1.0, 1.0, 1.0], Corner.FRONT_LEFT, -1, ""),
        ([1.0, 1.0, 1.0, 10.0], Corner.REAR_RIGHT, 1, "its name says FL: are plugs swapped?"),
    ],
)
def test_a_travel_is_where_a_push_moves_it_most(
    heights: list[float], corner: Corner, sign: int, ask: str
) -> None:
    found = guesses({"Pot.pot_fl": trace(heights)})["Pot.pot_fl"]
    assert (found.quantity, found.corner, found.sign) == (
        Quantity.SUSPENSION_TRAVEL, corner, sign,
    )  # fmt: skip
    assert (found.ask, found.is_proven) == (ask, True)
    assert found.tare == pytest.approx(sign * 0.012)
    if ask:
        assert found.asked is Asked.WHEEL


def test_a_travel_that_no_push_shows_keeps_the_corner_of_its_name() -> None:
    found = guesses({})["Pot.pot_fl"]
    assert (found.corner, found.is_proven, found.ask) == (Corner.FRONT_LEFT, False, "")


def test_axes_that_are_not_vertical_are_listed_as_unused_in_the_unit_of_gravity() -> None:
    """No unit is stated, and the vertical axis reads 1: all three are in g."""
    text = 'VERSION ""\n\nBU_: A\n\nBO_ 256 Imu: 8 A\n' + "".join(
        f' SG_ Acc{a} : {16 * n}|16@1- (1,0) [0|0] "" A\n' for n, a in enumerate("XYZ")
    )
    found = guess_bench(parse_codec(text, "m.dbc").messages, {}, seen((0.0, 0.0, -1.0)), None, {})
    why = "reads +0.00 g at rest: not vertical"
    assert found["Imu.AccX"] == found["Imu.AccY"] == Guess(Quantity.UNUSED, None, 1, why, unit="g")
    vertical = found["Imu.AccZ"]
    assert (vertical.quantity, vertical.sign, vertical.unit) == (
        Quantity.BODY_ACCELERATION, -1, "g",
    )  # fmt: skip
