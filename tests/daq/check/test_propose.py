"""Proposals from databases and traffic whose meaning is written down here."""

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
from daq.bench.sensors import Database
from daq.channels import Quantity
from daq.check.frame_checks import Arrivals
from daq.check.propose import find_sensors, message_rule, propose_sensors
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.codec import DecodeCounts, Decoded, Samples
from dbc.layout import CRC_RULES, MessageLayout

from ..sensor_bench import Row, frame_batch
from .test_frame_limits import sent

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
    text = propose_sensors([Database("car.dbc", DBC)], (), frames, None).text
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
    assert '# crc = "Checksum"' in text
    assert tomllib.loads(text)["dbc"] == "car.dbc"


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


def test_hostile_names_stay_inside_their_quotes() -> None:
    proposal = propose_sensors([Database('a"b\n.dbc', DBC)], (), None, None).text
    assert tomllib.loads(proposal)["dbc"] == 'a"b\n.dbc'
    assert tomllib.loads(proposal)["bus"]["channel"] == "can0"


# Rules of messages --------------------------------------------------------------------------------


def layout(signal: str, message: str = "M", cycle_ms: int = 10) -> MessageLayout:
    text = (
        f'VERSION ""\n\nBU_: A\n\nBO_ 256 {message}: 8 A\n SG_ {signal} A\n'
        'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\n'
        f'BA_DEF_DEF_ "GenMsgCycleTime" {cycle_ms};\n'
    )
    return parse_codec(text, "m.dbc").messages[0]


def arrivals(n: int, period_s: float, can_id: int = 256, length: int = 8) -> Arrivals:
    t_ns = np.rint(np.arange(n) * period_s * 1e9).astype(np.int64)
    data = np.zeros((n, 8), np.uint8)
    return Arrivals(can_id, False, t_ns, np.full(n, length, np.uint8), data, (0,))


def rules(
    signal: str, values: Numbers | None, period_s: float = 0.01, quality: int = 0
) -> list[str]:
    """Return the lines after the name of the message; `values`: of the signal, if it was seen."""
    came = decoded = None
    if values is not None:
        array = np.asarray(values, np.float64)
        came, full = arrivals(len(array), period_s), f"M.{signal.partition(' ')[0]}"
        samples = Samples(full, came.t_ns, array, np.full(len(array), quality, np.uint8))
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


@pytest.mark.parametrize(("rate", "is_clock"), [(1.049, True), (0.951, True), (1.051, False)])
@pytest.mark.parametrize(("unit", "per_s"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_time_stamp_runs_with_the_bus(
    unit: str, per_s: float, rate: float, is_clock: bool
) -> None:
    """It begins anew on the way, where its 48 bits end."""
    signal = f'stamp : 0|48@1+ (0.001,0) [0|0] "{unit}"'
    wrap = 0.001 * 2**48
    values = (wrap - 0.5 * per_s + np.arange(200) * 0.01 * per_s * rate) % wrap
    (line,) = rules(signal, values)
    if is_clock:
        assert line == 'time_signal = "stamp"  # runs with the bus\'s clock'
    else:
        assert line.startswith(f'# "stamp" runs {rate:.3g} times as fast')
    assert rules(signal, values[:19]) == []
    assert len(rules(signal, values[:20])) == 1
    assert rules(signal, values, 0.0) == []
    assert rules(signal.replace("stamp", "steam"), values) == []


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


def pot(cycle: str = "") -> Database:
    text = 'VERSION ""\n\nBU_: A\n\nBO_ 385 TPDO1: 8 A\n SG_ pos : 0|32@1- (1,0) [0|0] "mm" A\n'
    return Database("pot.dbc", text + cycle)


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
    sensors, absent = find_sensors((pot(cycle),), frames)
    assert [(s.sensor.id_offset, s.surely) for s in sensors] == [(can_id - 385, False)] * found
    assert absent == ([] if found else ["pot.dbc"])
