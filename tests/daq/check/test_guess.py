"""Guesses from names, units, gravity and pushes, on signals made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from daq.channels import Quantity
from daq.check.guess import Candidate, Guess, Question, candidate, guess_channels
from daq.check.pushes import Pushes, Trace
from daq.vehicle import Corner
from dbc.layout import SignalLayout

from .test_pushes import pushes, trace

PUSHED = pushes(trace([1.0, 1.0, 1.0, 1.0]))
QUIET = trace([0.0, 0.0, 0.0, 0.0])
IMU = {"Imu.AccX": "g", "Imu.AccY": "g", "Imu.AccZ": "g"}
RATES = {"Rate.GyrX": "rad/s", "Rate.GyrY": "rad/s", "Rate.GyrZ": "rad/s"}


def layout(full: str, unit: str, span: float | None = None, bits: int = 16) -> SignalLayout:
    """Return a signal whose range, if it is stated, begins at 0."""
    low = None if span is None else 0.0
    name = full.rpartition(".")[2]
    plain = False, True, False, 1, 0  # little-endian, signed, no float, factor and offset
    return SignalLayout(name, unit, 0, bits, *plain, low, span, None, (), ())


def signal(
    full: str, unit: str, level: float | None, span: float | None = None
) -> Candidate | None:
    """Return a signal that reads a level, or was not measured."""
    values = np.full(0 if level is None else 20, level or 0.0)
    return candidate(full, layout(full, unit, span), values)


def alone(full: str, unit: str, level: float | None = None) -> Guess | None:
    one = signal(full, unit, level)
    return guess_channels([one], None).get(full) if one is not None else None


@pytest.mark.parametrize(
    ("name", "corner"),
    [
        ("acc_FL", Corner.FRONT_LEFT),
        ("AccRR", Corner.REAR_RIGHT),
        ("wheel_front_right_z", Corner.FRONT_RIGHT),
        ("accHinterachseHL", Corner.REAR_LEFT),
        ("accfederwegvr", Corner.FRONT_RIGHT),
        ("LF_hub", Corner.FRONT_LEFT),
        ("HubAcc_FL2 vert-up", Corner.FRONT_LEFT),
        ("acc_z", None),
        ("front_rear_z", None),
    ],
)
def test_an_acceleration_is_at_the_corner_of_its_name(name: str, corner: Corner | None) -> None:
    guess = alone(f"M.{name}", "g")
    assert guess is not None
    assert guess.corner == corner
    kind = Quantity.HUB_ACCELERATION if corner else Quantity.BODY_ACCELERATION
    assert guess.quantity is kind


@pytest.mark.parametrize(
    ("name", "level", "quantity", "sign"),
    [
        ("acc_fl", 1.09, Quantity.HUB_ACCELERATION, 1),
        ("acc_fl", -0.91, Quantity.HUB_ACCELERATION, -1),
        ("acc_fl", 1.11, Quantity.UNUSED, 1),
        ("acc_fl", -0.89, Quantity.UNUSED, 1),
        ("body_fl", 1.0, Quantity.BODY_ACCELERATION, 1),
        ("acc_z", None, Quantity.BODY_ACCELERATION, 1),
        ("acc_x", None, Quantity.UNUSED, 1),
        ("acc_x_fl", None, Quantity.UNUSED, 1),
        ("acc_fl", None, Quantity.HUB_ACCELERATION, 1),
        # An AC-coupled sensor at a wheel reads no gravity.
        ("acc_fl", 0.09, Quantity.HUB_ACCELERATION, 1),
        ("acc_fl", 0.11, Quantity.UNUSED, 1),
        ("acc_z", 0.09, Quantity.UNUSED, 1),
    ],
)
def test_an_acceleration_is_vertical_by_gravity_or_by_its_name(
    name: str, level: float | None, quantity: Quantity, sign: int
) -> None:
    guess = alone(f"M.{name}", "g", level)
    assert guess is not None
    assert (guess.quantity, guess.sign) == (quantity, sign)
    assert ("is it AC-coupled" in guess.ask) is (level == 0.09 and name == "acc_fl")


@pytest.mark.parametrize(
    ("full", "quantity"),
    [
        ("M.Nick_rate", Quantity.PITCH_RATE),
        ("M.gierrate", Quantity.UNUSED),
        ("M.rateX", Quantity.ROLL_RATE),
        ("M.gyroy", Quantity.PITCH_RATE),  # no word of its own, but the last letter
        ("M.gyrob", Quantity.UNUSED),
        ("Wank.w", Quantity.ROLL_RATE),
    ],
)
def test_a_rate_is_named_by_a_word_or_an_axis(full: str, quantity: Quantity) -> None:
    guess = alone(full, "deg/s")
    assert guess is not None
    assert guess.quantity is quantity
    assert alone(full, "lux") is None


@pytest.mark.parametrize(
    ("size", "unit"),
    [(0.91, "g"), (1.09, "g"), (0.89, "m/s2"), (8.9, "m/s2"), (910, "mg"), (1090, "mg"),
     (9000, "mm/s2"), (0.0, "m/s2")],
)  # fmt: skip
def test_gravity_shows_the_unit_within_a_tenth(size: float, unit: str) -> None:
    for name, level in (("M.acc_z", size), ("M.acc_z", -size)):
        guess = alone(name, "", level)
        assert guess is not None
        assert (guess.unit, guess.ask) == (unit, f"no unit is stated: is it {unit}?")


@pytest.mark.parametrize(
    ("name", "unit", "level", "is_travel"),
    [
        ("Travel_FL", "mm", 999.0, True),
        ("Travel_FL", "mm", -1001.0, False),
        ("Radar_FL", "mm", 100.0, False),
        ("Distance_FL", "mm", 100.0, False),
        ("Damper_RR", "mm", None, True),
        ("pot_fl", "", 120.0, True),
        ("pot_1", "", 120.0, False),
        ("door_pos_fl", "", 120.0, False),
        ("damper_dist_fl", "", 120.0, False),
        ("pot_fl_status", "", 120.0, False),
    ],
)
def test_a_travel_reads_a_metre_at_most_and_has_the_name_of_one(
    name: str, unit: str, level: float | None, is_travel: bool
) -> None:
    guess = alone(f"M.{name}", unit, level)
    assert (guess is not None and guess.quantity is Quantity.SUSPENSION_TRAVEL) == is_travel
    assert alone(f"Radar.{name}", unit, level) is None


@pytest.mark.parametrize(("span", "is_travel"), [(2000.0, True), (2001.0, False)])
def test_without_traffic_the_range_of_a_travel_is_two_metres(span: float, is_travel: bool) -> None:
    one = signal("M.pot_fl", "mm", None, span=span)
    assert one is not None
    assert bool(guess_channels([one], None)) is is_travel


@pytest.mark.parametrize(
    ("peak", "unit"),
    [(0.004, "mm"), (0.006, "m"), (0.9, "m"), (1.1, "mm"), (120, "mm")],
)
def test_travels_without_a_unit_have_that_of_their_largest_motion(peak: float, unit: str) -> None:
    lengths = [signal("M.pot_fl", "", peak), signal("M.pot_fr", "", 0.0)]
    guesses = guess_channels([one for one in lengths if one], None)
    assert {guess.unit for guess in guesses.values()} == {unit}
    factor = 1.0 if unit == "m" else 1e-3
    guess = guesses["M.pot_fl"]
    assert guess.tare == pytest.approx(peak * factor)


# A device with three axes -------------------------------------------------------------------------


def device(
    traces: dict[str, Trace] | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, 1.0),
    unit: str = "g",
) -> dict[str, Guess]:
    """Return the guesses for an IMU and a pot; `traces`: of pushes, in which others are quiet."""
    levels = dict(zip(IMU, gravity, strict=True)) | dict.fromkeys(RATES, 0.0)
    units = dict.fromkeys(IMU, unit) | RATES
    signals = [signal(full, units[full], level) for full, level in levels.items()]
    signals.append(signal("Pot.pot_fl", "mm", 12.0))
    found = None
    if traces is not None:
        names = [*levels, "Pot.pot_fl"]
        found = Pushes(PUSHED.spans, {name: traces.get(name, QUIET) for name in names})
    return guess_channels([one for one in signals if one is not None], found)


def test_without_pushes_forward_is_asked_and_with_pushes_that_show_nothing_so_is_said() -> None:
    for traces, said in ((None, False), ({}, True)):
        found = device(traces)
        roll, pitch, yaw = (found[name] for name in RATES)
        assert (roll.quantity, pitch.quantity, yaw.quantity) == (
            Quantity.ROLL_RATE, Quantity.PITCH_RATE, Quantity.UNUSED,
        )  # fmt: skip
        assert (roll.of_device, roll.is_proven) == (True, False)
        assert "+x axis" in roll.ask
        assert ("pushes did not show it" in roll.ask) is said
        vertical, pot = found["Imu.AccZ"], found["Pot.pot_fl"]
        assert (vertical.quantity, vertical.ask) == (Quantity.BODY_ACCELERATION, "")
        assert (pot.corner, pot.is_proven, pot.ask) == (Corner.FRONT_LEFT, False, "")


def test_pushes_show_how_an_imu_is_turned() -> None:
    """Its y axis points forward: it turns about x as the nose goes down, backwards."""
    traces = {
        "Rate.GyrY": trace([-1.0, 1.0, -1.0, 1.0]),  # roll: down on the left is negative
        "Rate.GyrX": trace([-1.0, -1.0, 1.0, 1.0]),  # pitch about -x: nose down is positive
    }
    found = device(traces)
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
    vertical = device(gravity=(0.0, float(np.sin(tilt)), float(np.cos(tilt))))["Imu.AccZ"]
    assert vertical.ask.startswith(ask)
    assert bool(vertical.ask) is bool(ask)


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
    found = device({"Pot.pot_fl": trace(heights)})["Pot.pot_fl"]
    assert (found.quantity, found.corner, found.sign) == (
        Quantity.SUSPENSION_TRAVEL, corner, sign,
    )  # fmt: skip
    assert (found.ask, found.is_proven) == (ask, True)
    assert found.tare == pytest.approx(sign * 0.012)


# Answers ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answers", "typed", "answer"),
    [
        ("y", " Yes ", True),
        ("y", "no", None),
        ("y or n", "n", False),
        ("y or n", "maybe", None),
        ("", "y", None),
    ],
)
def test_answers_that_are_understood(answers: str, typed: str, answer: bool | None) -> None:
    assert Question("?", answers).understood(typed) is answer
