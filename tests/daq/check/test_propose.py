"""Guesses from names, units, gravity and pushes; proposals from databases and traffic."""

from __future__ import annotations

import struct
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.channels import Quantity
from daq.check.frame_checks import Arrivals
from daq.check.guess import Candidate, Guess, candidate, guess_channels
from daq.check.propose import find_sensors, message_rule, propose_sensors
from daq.check.pushes import Pushes
from daq.samples.mapping import Trace
from daq.vehicle import Corner
from dbc import FrameBatch, parse_codec
from dbc.codec import CRC_RULES, DecodeCounts, Decoded, MessageLayout, Samples, SignalLayout

from ..sensor_bench import Row, frame_batch
from .test_frame_limits import sent
from .test_pushes import FL, FR, RL, RR, pushes, trace

Numbers = Sequence[float] | NDArray[Any]

DBC = """VERSION ""
BU_: A B
BO_ 16 Chassis: 8 A
 SG_ ch1 : 0|16@1- (0.001,0) [0|0] "g" B
 SG_ ch2 : 16|16@1- (0.001,0) [0|0] "g" B
 SG_ ch3 : 32|16@1- (0.001,0) [0|0] "g" B
 SG_ MsgCnt : 48|8@1+ (1,0) [0|0] "" B
 SG_ Checksum : 56|8@1+ (1,0) [0|0] "" B
BO_ 17 Wheels: 8 A
 SG_ AccVL : 0|16@1- (0.01,0) [0|0] "m/s^2" B
 SG_ AccHR : 16|16@1- (0.01,0) [0|0] "m/s^2" B
 SG_ StrokeVL : 32|16@1- (0.1,0) [0|0] "mm" B
 SG_ Odd : 48|16@1- (0.1,0) [0|0] "mm" B
BO_ 18 Gyro: 8 A
 SG_ Nick_w1 : 0|16@1- (0.01,0) [0|0] "deg/s" B
 SG_ Gier_w2 : 16|16@1- (0.01,0) [0|0] "deg/s" B
 SG_ TimeStamp : 32|32@1+ (1,0) [0|0] "us" B
BO_ 19 Absent: 8 A
 SG_ pitch_rate : 0|16@1- (0.01,0) [0|0] "deg/s" B
"""


def _traffic() -> list[Row]:
    rng = np.random.default_rng(2)
    rule = CRC_RULES["crc8_8h2f"]
    rows: list[Row] = []
    for k in range(400):
        a = rng.normal(0, 4, 5).round().astype(int)
        head = struct.pack("<hhhB", a[0], -1000 + a[1], a[2], k % 15)
        crc = rule(np.frombuffer(head, np.uint8)[None, :]).tobytes()
        rows += [
            (0.01 * k, 16, head + crc),
            (0.01 * k + 0.001, 17, struct.pack("<4h", 981 + a[3], 980, 3, 4)),
            (0.01 * k + 0.002, 18, struct.pack("<hhI", a[4], 1, 10_000 * k)),
        ]
    return rows


def _proposed(traffic: list[Row] | None) -> tuple[str, Bench]:
    frames = None if traffic is None else frame_batch(traffic)
    text = propose_sensors({"car.dbc": DBC}, (), frames, None).text
    bench = parse_bench(text, "proposed", Path(), DBC)
    bench_codec(bench)  # fits its DBC
    return text, bench


def test_names_and_units_alone_tell_much() -> None:
    text, bench = _proposed(None)
    found = {c.name: (c.quantity, c.corner) for c in bench.channels}
    assert found == {
        "ch1": (Quantity.UNUSED, None),
        "ch2": (Quantity.UNUSED, None),
        "ch3": (Quantity.UNUSED, None),
        "AccVL": (Quantity.HUB_ACCELERATION, Corner.FRONT_LEFT),
        "AccHR": (Quantity.HUB_ACCELERATION, Corner.REAR_RIGHT),
        "StrokeVL": (Quantity.SUSPENSION_TRAVEL, Corner.FRONT_LEFT),
        "Nick_w1": (Quantity.PITCH_RATE, None),
        "Gier_w2": (Quantity.UNUSED, None),
        "pitch_rate": (Quantity.PITCH_RATE, None),
    }
    assert tomllib.loads(text)["dbc"] == "car.dbc"
    vertical, pot = alone("M.acc_z", "g"), alone("M.Travel", "mm")
    assert vertical is not None
    assert vertical.ask == "is it on the body, or on which hub?"
    assert pot is not None
    assert (pot.quantity, pot.ask) == (Quantity.UNUSED, "at which corner?")


def test_traffic_tells_the_axis_the_sign_the_counter_the_checksum_and_the_clock() -> None:
    text, bench = _proposed(_traffic())
    found = {c.name: (c.quantity, c.sign) for c in bench.channels}
    assert found["ch2"] == (Quantity.BODY_ACCELERATION, -1.0)  # it reads -1 g
    assert found["ch1"] == found["ch3"] == (Quantity.UNUSED, 1.0)
    assert "pitch_rate" not in found
    assert "# Not on the bus: Absent" in text
    messages = {m.name: m for m in bench_codec(bench).messages}
    chassis = messages["Chassis"]
    assert chassis.cycle_s == pytest.approx(0.01)
    assert chassis.counter is not None
    assert (chassis.counter.signal, chassis.counter.modulus) == ("MsgCnt", 15)
    assert (chassis.crc, chassis.crc_rule) == ("Checksum", "crc8_8h2f")
    assert text.count("FILL IN") >= 6


@pytest.mark.parametrize("name", ['a"b\n.dbc', "\N{GRINNING FACE}\x7f.dbc"])
def test_hostile_names_stay_inside_their_quotes(name: str) -> None:
    proposal = propose_sensors({name: DBC}, (), None, None).text
    assert tomllib.loads(proposal)["dbc"] == name
    assert tomllib.loads(proposal)["bus"]["channel"] == "can0"


def test_pushes_show_travels_in_other_units_and_beside_values_that_are_none() -> None:
    database, rows = 'VERSION ""\n\nBU_: A\n\n', []
    pots = ("mm", 1.0, [9.0, 3.0, 3.0, 3.0]), ("m", 1e-3, [3.0, 3.0, 3.0, 9.0])
    for n, (unit, size, heights) in enumerate(pots, start=16):
        database += f'BO_ {n} M{n}: 4 A\n SG_ Travel : 0|32@1- (1,0) [0|0] "{unit}" A\n\n'
        t_ns, value = trace(heights)
        value[700] = np.nan
        times_s = ((t_ns - t_ns[0]) * 1e-9).tolist()
        rows += [(s, n, struct.pack("<f", size * v)) for s, v in zip(times_s, value, strict=True)]
    databases = {"car.dbc": database + "".join(f"SIG_VALTYPE_ {n} Travel : 1;\n" for n in (16, 17))}
    text = propose_sensors(databases, (), None, frame_batch(rows)).text
    bench = parse_bench(text, "proposed", Path(), databases["car.dbc"])
    assert [c.corner for c in bench.channels] == [Corner.FRONT_LEFT, Corner.REAR_RIGHT]


# Rules of messages --------------------------------------------------------------------------------


def layout(signal: str, message: str = "M", cycle_ms: int = 10) -> MessageLayout:
    text = (
        f'VERSION ""\n\nBU_: A\n\nBO_ 256 {message}: 8 A\n SG_ {signal} A\n'
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\n'
        f'BA_DEF_DEF_ "GenMsgCycleTime" {cycle_ms};\n'
    )
    return parse_codec(text, "m.dbc").messages[0]


def arrivals(n: int, period_s: float) -> Arrivals:
    t_ns = np.rint(np.arange(n) * period_s * 1e9).astype(np.int64)
    rows = [(t, 256, 0, 0, 8, bytes(8)) for t in t_ns.tolist()]
    return Arrivals(256, False, FrameBatch.from_rows(rows))


def rules(signal: str, values: Numbers) -> list[str]:
    """Return the lines after the name of the message, whose signal has these values."""
    array, full = np.asarray(values, np.float64), f"M.{signal.partition(' ')[0]}"
    came = arrivals(len(array), 0.01)
    samples = Samples(full, came.frames.t_ns, array, np.zeros(len(array), np.uint8))
    decoded = Decoded({full: samples}, DecodeCounts(0, 0, 0, 0, 0))
    return message_rule(layout(signal), came, decoded, is_used=True)[2:]


COUNTER = 'cnt : 0|8@1+ (1,0) [0|0] ""'


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (np.arange(20), ['counter = "cnt"  # counts by one']),
        (np.arange(19), []),
        (np.arange(300) % 256, ['counter = "cnt"  # counts by one']),
        (
            np.arange(300) % 200,
            [
                'counter = "cnt"  # counts by one',
                "counter_modulus = 200  # starts again after 199",
            ],
        ),
        (np.arange(21) + (np.arange(21) > 10) + (np.arange(21) > 15), ["counter"]),  # 18 of 20
        (np.arange(21) + (np.arange(21) > 10) * 2 + (np.arange(21) > 5) + (np.arange(21) > 15), []),
        (np.full(30, 7), []),
        (np.arange(30) * 2, []),
    ],
)
def test_a_counter_counts_by_one_in_nine_steps_of_ten(values: Numbers, expected: list[str]) -> None:
    lines = rules(COUNTER, values)
    assert [line.split(" ")[0] for line in lines] == [line.split(" ")[0] for line in expected]
    if expected and " " in expected[0]:
        assert lines == expected


@pytest.mark.parametrize(
    ("cycle_ms", "n", "lines"),
    [(10, 20, []), (20, 20, ["cycle_ms = 10"]), (20, 19, []), (0, 20, ["cycle_ms = 10"]),
     (0, 19, [])],
)  # fmt: skip
def test_a_cycle_is_measured_over_twenty_frames(cycle_ms: int, n: int, lines: list[str]) -> None:
    described = layout('v : 0|8@1+ (1,0) [0|0] "mm"', cycle_ms=cycle_ms)
    came, decoded = arrivals(n, 0.01), Decoded({}, DecodeCounts(0, 0, 0, 0, 0))
    found = message_rule(described, came, decoded, is_used=True)
    assert [line.split("  #")[0] for line in found[2:]] == lines
    if cycle_ms:
        assert message_rule(described, came, decoded, is_used=False) == []


# Sensors on buses ---------------------------------------------------------------------------------


def pot(cycle: str = "") -> dict[str, str]:
    text = 'VERSION ""\n\nBU_: A\n\nBO_ 385 TPDO1: 8 A\n SG_ pos : 0|32@1- (1,0) [0|0] "mm" A\n'
    return {"pot.dbc": text + cycle}


CYCLE = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\nBA_DEF_DEF_ "GenMsgCycleTime" 10;\n'


@pytest.mark.parametrize(
    ("cycle", "can_id", "period_s", "length", "n", "found"),
    [
        (CYCLE, 386, 0.01, 8, 10, True),
        (CYCLE, 386, 0.01, 8, 9, False),
        (CYCLE, 386, 0.01, 7, 10, False),
        (CYCLE, 386, 0.0092, 8, 50, True),
        (CYCLE, 386, 0.0090, 8, 50, False),
        (CYCLE, 386, 0.0110, 8, 50, True),
        (CYCLE, 386, 0.0112, 8, 50, False),
        (CYCLE, 385 + 127, 0.01, 8, 50, True),
        (CYCLE, 385 + 128, 0.01, 8, 50, False),
        (CYCLE, 385 - 127, 0.01, 8, 50, True),
        (CYCLE, 385 - 128, 0.01, 8, 50, False),
        ("", 386, 0.7, 8, 10, True),  # no rate is known: a node keeps the upper four bits
        ("", 0x1FF, 0.7, 8, 10, True),
        ("", 0x17F, 0.7, 8, 10, False),
        ("", 0x200, 0.7, 8, 10, False),
    ],
)
def test_an_identifier_near_by_with_like_frames_is_a_further_device(
    cycle: str, can_id: int, period_s: float, length: int, n: int, found: bool
) -> None:
    frames = sent(np.arange(float(n)) * period_s, can_id, length=length)
    sensors, absent = find_sensors(pot(cycle), frames)
    assert [(s.sensor.id_offset, s.surely) for s in sensors] == [(can_id - 385, False)] * found
    assert absent == ([] if found else ["pot.dbc"])


# Guesses on signals made by hand ------------------------------------------------------------------

PUSHED = pushes(trace([1.0, 1.0, 1.0, 1.0]))
QUIET = trace([0.0, 0.0, 0.0, 0.0])
IMU = {"Imu.AccX": "g", "Imu.AccY": "g", "Imu.AccZ": "g"}
RATES = {"Rate.GyrX": "rad/s", "Rate.GyrY": "rad/s", "Rate.GyrZ": "rad/s"}


def signal_layout(full: str, unit: str, span: float | None = None, bits: int = 16) -> SignalLayout:
    """Return a signal whose range, if it is stated, begins at 0."""
    limits = None if span is None else (0.0, span)
    name = full.rpartition(".")[2]
    return SignalLayout(name, unit, 0, bits, "little", True, False, 1, 0, limits, None, (), ())


def signal(
    full: str, unit: str, level: float | None, span: float | None = None
) -> Candidate | None:
    """Return a signal that reads a level, or was not measured."""
    values = np.full(0 if level is None else 20, level or 0.0)
    return candidate(full, signal_layout(full, unit, span), values)


def alone(full: str, unit: str, level: float | None = None) -> Guess | None:
    one = signal(full, unit, level)
    return guess_channels([one], None).get(full) if one is not None else None


@pytest.mark.parametrize(
    ("name", "corner"),
    [
        ("acc_FL", FL), ("AccRR", RR), ("wheel_front_right_z", FR), ("accHinterachseHL", RL),
        ("accfederwegvr", FR), ("LF_hub", FL), ("HubAcc_FL2 vert-up", FL), ("acc_z", None),
        ("front_rear_z", None),
    ],
)  # fmt: skip
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
    ],
)
def test_an_acceleration_is_vertical_by_gravity_or_by_its_name(
    name: str, level: float | None, quantity: Quantity, sign: int
) -> None:
    guess = alone(f"M.{name}", "g", level)
    assert guess is not None
    assert (guess.quantity, guess.sign) == (quantity, sign)


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
    ("name", "unit", "level", "is_travel"),
    [
        ("Travel_FL", "mm", 999.0, True),
        ("Travel_FL", "mm", -1001.0, False),
        ("Radar_FL", "mm", 100.0, False),
        ("Distance_FL", "mm", 100.0, False),
        ("Damper_RR", "mm", None, True),
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
        turns = Quantity.ROLL_RATE, Quantity.PITCH_RATE, Quantity.UNUSED
        assert (roll.quantity, pitch.quantity, yaw.quantity) == turns
        assert (roll.of_device, roll.is_proven) == (True, False)
        assert "+x axis" in roll.ask
        assert ("pushes did not show it" in roll.ask) is said
        vertical, pot = found["Imu.AccZ"], found["Pot.pot_fl"]
        assert (vertical.quantity, vertical.ask) == (Quantity.BODY_ACCELERATION, "")
        assert (pot.corner, pot.is_proven, pot.ask) == (Corner.FRONT_LEFT, False, "")


@pytest.mark.parametrize(("y", "z"), [(0.7, 0.7), (0.0, 9.8)])
def test_a_tilted_device_or_a_wrong_unit_is_asked_about(y: float, z: float) -> None:
    guess = device(gravity=(0.0, y, z))["Imu.AccZ"]
    assert guess.quantity is Quantity.UNUSED
    assert "is one axis vertical, and the unit right? It reads +0.00, " in guess.ask


def test_an_accelerometer_named_by_the_body_is_none_of_the_axes_of_an_imu() -> None:
    levels = {"Imu.AccX": 0.0, "Imu.AccY": 0.0, "Imu.AccZ": 1.0, "Imu.acc_body": 1.0}
    signals = [signal(full, "g", level) for full, level in levels.items()]
    found = guess_channels([one for one in signals if one is not None], None)
    used = {name for name, guess in found.items() if guess.quantity is not Quantity.UNUSED}
    assert used == {"Imu.AccZ", "Imu.acc_body"}


def test_pushes_show_how_an_imu_is_turned() -> None:
    """Its y axis points forward: it turns about x as the nose goes down, backwards."""
    down_on_left, nose_down = trace([-1.0, 1.0, -1.0, 1.0]), trace([-1.0, -1.0, 1.0, 1.0])
    found = device({"Rate.GyrY": down_on_left, "Rate.GyrX": nose_down})
    for name, turn, sign in (
        ("Rate.GyrY", Quantity.ROLL_RATE, 1),
        ("Rate.GyrX", Quantity.PITCH_RATE, -1),
    ):
        guess = found[name]
        assert (guess.quantity, guess.sign, guess.ask, guess.is_proven) == (turn, sign, "", True)


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
    assert (found.quantity, found.corner, found.sign) == (Quantity.SUSPENSION_TRAVEL, corner, sign)
    assert (found.ask, found.is_proven) == (ask, True)
    assert found.tare == pytest.approx(sign * 0.012)
