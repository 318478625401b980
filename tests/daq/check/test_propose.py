"""Maps proposed from DBCs and traffic whose meaning is written down here."""

import struct
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import Bench, bench_codec, parse_bench
from daq.bench.databases import Database
from daq.channels import Quantity
from daq.check.guess_map import guess_corner, guess_quantity, words
from daq.check.propose import propose_sensors
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.crc import CRC_RULES

from ..sensor_frames import Row, frame_batch

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
 SG_ w1 : 0|16@1- (0.01,0) [0|0] "deg/s" B
 SG_ w2 : 16|16@1- (0.01,0) [0|0] "deg/s" B
 SG_ TimeStamp : 32|32@1+ (1,0) [0|0] "us" B
BO_ 19 Absent: 8 A
 SG_ pitch_rate : 0|16@1- (0.01,0) [0|0] "deg/s" B
CM_ SG_ 18 w1 "Nick rate of the car";
CM_ SG_ 18 w2 "gierrate";
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
    text = propose_sensors([Database("car.dbc", DBC)], (), frames, None).text
    bench = parse_bench(text, "proposed", Path(), DBC)
    bench_codec(bench)  # fits its DBC
    return text, bench


def test_names_units_and_comments_alone_tell_much() -> None:
    text, bench = _proposed(None)
    found = {c.name: (c.quantity, c.corner) for c in bench.channels}
    assert found == {
        "ch1": (Quantity.UNUSED, None),
        "ch2": (Quantity.UNUSED, None),
        "ch3": (Quantity.UNUSED, None),
        "AccVL": (Quantity.HUB_ACCELERATION, Corner.FRONT_LEFT),
        "AccHR": (Quantity.HUB_ACCELERATION, Corner.REAR_RIGHT),
        "StrokeVL": (Quantity.SUSPENSION_TRAVEL, Corner.FRONT_LEFT),
        "w1": (Quantity.PITCH_RATE, None),
        "w2": (Quantity.UNUSED, None),
        "pitch_rate": (Quantity.PITCH_RATE, None),
    }
    assert '# crc = "Checksum"' in text
    assert tomllib.loads(text)["dbc"] == "car.dbc"


def test_every_line_that_is_left_to_the_reader_can_be_uncommented() -> None:
    text, _ = _proposed(None)
    settings = ("# [[", "# name = ", "# counter", "# cycle_ms", "# mass_kg", "# hub", "# x_m",
                "# y_m", "# quantity", "# value", "# sigma")  # fmt: skip
    lines = [x.removeprefix("# ") if x.startswith(settings) else x for x in text.splitlines()]
    bench = parse_bench("\n".join(lines), "proposed", Path(), DBC)
    bench_codec(bench)
    assert [rule.cycle_ms for rule in bench.message_rules] == [10.0] * 4
    assert [weight.mass_kg for weight in bench.mass_states[1].added.weights] == [32.5, 4.0]
    assert bench.vehicle.facts[0].value == pytest.approx(1551.8)


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
    (gyro,) = [rule for rule in bench.message_rules if rule.name == "Gyro"]
    assert gyro.time_signal == "TimeStamp"
    assert text.count("FILL IN") >= 6


def test_a_clock_that_runs_at_another_rate_is_not_taken() -> None:
    rows = [(t, i, d) if i != 18 else (t, i, d[:4] + struct.pack("<I", round(t * 1e4)))
            for t, i, d in _traffic()]  # fmt: skip
    text, bench = _proposed(rows)
    assert '# "TimeStamp" runs 0.01 times as fast' in text
    assert all(rule.time_signal is None for rule in bench.message_rules)


def test_hostile_names_stay_inside_their_quotes() -> None:
    # What a tool may write into a comment must not become TOML.
    text = DBC.replace("Nick rate of the car", "nick\\\n[bus]\nchannel = 1\n")
    proposal = propose_sensors([Database('a"b\n.dbc', text)], (), None, None).text
    assert tomllib.loads(proposal)["dbc"] == 'a"b\n.dbc'
    assert tomllib.loads(proposal)["bus"]["channel"] == "can0"


@pytest.mark.parametrize(
    ("name", "corner"),
    [
        ("acc_FL", Corner.FRONT_LEFT),
        ("AccRR", Corner.REAR_RIGHT),
        ("wheel_front_right_z", Corner.FRONT_RIGHT),
        ("HinterachseHL", Corner.REAR_LEFT),
        ("federwegvr", Corner.FRONT_RIGHT),
        ("LF_hub", Corner.FRONT_LEFT),
        ("acc_z", None),
        ("front_rear", None),
    ],
)
def test_corners_from_names(name: str, corner: Corner | None) -> None:
    found = guess_corner(name, "", "")
    assert (found[0] if found else None) == corner


def test_words_of_any_case_style() -> None:
    assert words("HubAcc_FL2 vert-up") >= {"hub", "acc", "fl", "vert", "up"}


def test_a_unit_that_is_not_known_says_nothing() -> None:
    signal = parse_codec(DBC, "car.dbc").message("Gyro").signal("w1")
    assert guess_quantity("Gyro", signal, "", None) is not None
    assert guess_quantity("Gyro", replace(signal, unit="lux"), "", None) is None
