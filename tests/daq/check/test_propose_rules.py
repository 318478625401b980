"""What traffic must show before counters, checksums, times, axes and devices are proposed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.databases import Database
from daq.channels import Quantity
from daq.check.answers import answered
from daq.check.find_sensors import find_sensors
from daq.check.frame_checks import Arrivals
from daq.check.guess_map import (
    Asked,
    Guess,
    axis_by_name,
    guess_quantity,
    is_travel,
    unit_by_gravity,
)
from daq.check.mounting import axis_of, mounting, pushed_corner
from daq.check.propose_message import Seen, message_rule
from daq.vehicle import Corner
from dbc import parse_codec
from dbc.layout import MessageLayout
from dbc.samples import DecodeCounts, Decoded, Samples

FL, FR, RL, RR = Corner
Numbers = Sequence[float] | NDArray[Any]


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


def seen(name: str, values: Numbers, period_s: float = 0.01, quality: int = 0) -> Seen:
    array = np.asarray(values, np.float64)
    frames = arrivals(len(array), period_s)
    samples = Samples(f"M.{name}", frames.t_ns, array, np.full(len(array), quality, np.uint8))
    return Seen({"M": frames}, Decoded({f"M.{name}": samples}, DecodeCounts(0, 0, 0, 0, 0)))


def rules(signal: str, traffic: Seen | None) -> list[str]:
    """Return the lines after the name of the message."""
    return message_rule(layout(signal), traffic, is_used=True)[2:]


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
    lines = rules(COUNTER, seen("cnt", values))
    assert [line.split(" ")[0] for line in lines] == [line.split(" ")[0] for line in expected]
    if expected and " " in expected[0]:
        assert lines == expected


@pytest.mark.parametrize(
    ("signal", "is_counter"),
    [
        ('cnt : 0|2@1+ (1,0) [0|0] ""', True),
        ('cnt : 0|1@1+ (1,0) [0|0] ""', False),
        ('cnt : 0|32@1+ (1,0) [0|0] ""', True),
        ('cnt : 0|33@1+ (1,0) [0|0] ""', False),
        ('cnt : 0|8@1- (1,0) [0|0] ""', False),
        ('cnt : 0|8@1+ (2,0) [0|0] ""', False),
        ('cnt : 0|8@1+ (1,1) [0|0] ""', False),
        ('speed : 0|8@1+ (1,0) [0|0] ""', False),
    ],
)
def test_a_counter_is_a_plain_number_of_two_to_32_bits(signal: str, is_counter: bool) -> None:
    asked = ['# counter = "cnt"  # by its name; true?']
    assert message_rule(layout(signal), None, is_used=True)[2:] == asked * is_counter


def test_unusable_samples_show_no_counter() -> None:
    assert rules(COUNTER, seen("cnt", np.arange(40), quality=2)) == []
    values = np.arange(40.0)
    values[20] = np.nan
    assert len(seen("cnt", values).good("M.cnt")[1]) == 39
    assert [len(each) for each in seen("cnt", values).good("M.absent")] == [0, 0]


@pytest.mark.parametrize(
    ("signal", "named"),
    [
        ('crc : 8|8@1+ (1,0) [0|0] ""', True),
        ('crc : 7|8@0+ (1,0) [0|0] ""', True),
        ('crc : 8|7@1+ (1,0) [0|0] ""', False),
        ('crc : 8|9@1+ (1,0) [0|0] ""', False),
        ('crc : 12|8@1+ (1,0) [0|0] ""', False),
        ('crc : 8|8@1- (1,0) [0|0] ""', False),
    ],
)
def test_a_checksum_is_one_whole_byte(signal: str, named: bool) -> None:
    lines = message_rule(layout(signal), None, is_used=True)
    assert ('# crc = "crc"  # which rule? give crc_rule' in lines) is named


@pytest.mark.parametrize(("rate", "is_clock"), [(1.049, True), (0.951, True), (1.051, False)])
@pytest.mark.parametrize(("unit", "per_s"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_a_time_stamp_runs_with_the_bus(
    unit: str, per_s: float, rate: float, is_clock: bool
) -> None:
    """It begins anew on the way, where its 48 bits end."""
    signal = f'stamp : 0|48@1+ (0.001,0) [0|0] "{unit}"'
    wrap = 0.001 * 2**48
    values = (wrap - 0.5 * per_s + np.arange(200) * 0.01 * per_s * rate) % wrap
    (line,) = rules(signal, seen("stamp", values))
    if is_clock:
        assert line == 'time_signal = "stamp"  # runs with the bus\'s clock'
    else:
        assert line.startswith(f'# "stamp" runs {rate:.3g} times as fast')
    assert rules(signal, seen("stamp", values[:19])) == []
    assert len(rules(signal, seen("stamp", values[:20]))) == 1
    assert rules(signal, seen("stamp", values, 0.0)) == []
    assert rules(signal.replace("stamp", "steam"), seen("steam", values)) == []


@pytest.mark.parametrize(
    ("cycle_ms", "n", "lines"),
    [(10, 20, []), (20, 20, ["cycle_ms = 10"]), (20, 19, []), (0, 20, ["cycle_ms = 10"]),
     (0, 19, [])],
)  # fmt: skip
def test_a_cycle_is_measured_over_twenty_frames(cycle_ms: int, n: int, lines: list[str]) -> None:
    described = layout('v : 0|8@1+ (1,0) [0|0] "mm"', cycle_ms=cycle_ms)
    found = message_rule(described, seen("v", np.zeros(n)), is_used=True)
    assert [line.split("  #")[0] for line in found[2:]] == lines
    if cycle_ms:
        assert message_rule(described, seen("v", np.zeros(n)), is_used=False) == []


@pytest.mark.parametrize(
    ("size", "unit"),
    [(0.91, "g"), (1.09, "g"), (0.89, None), (1.11, None), (8.9, "m/s2"), (10.75, "m/s2"),
     (8.7, None), (10.8, None), (910, "mg"), (1090, "mg"), (9000, "mm/s2"), (0.0, None)],
)  # fmt: skip
def test_gravity_shows_the_unit_within_a_tenth(size: float, unit: str | None) -> None:
    assert unit_by_gravity(size) == unit


@pytest.mark.parametrize(
    ("level", "span", "travels"),
    [(999.0, 9e9, True), (-999.0, 9e9, True), (1001.0, 1.0, False), (-1001.0, 1.0, False),
     (None, 2000.0, True), (None, 2001.0, False)],
)  # fmt: skip
def test_a_travel_reads_a_metre_at_most(level: float | None, span: float, travels: bool) -> None:
    signal = layout('pot : 0|32@1- (1,0) [0|0] "mm"').signals[0]
    signal = replace(signal, minimum=100.0, maximum=100.0 + span)
    assert is_travel("M", signal, "", level) is travels
    open_ended = replace(signal, minimum=None)
    assert is_travel("M", open_ended, "", None)
    assert is_travel("M", replace(signal, maximum=None), "", None)


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
        ("acc_fl", 0.0, Quantity.UNUSED, 1),
    ],
)
def test_an_acceleration_is_vertical_by_gravity_or_by_its_name(
    name: str, level: float | None, quantity: Quantity, sign: int
) -> None:
    signal = layout(f'{name} : 0|16@1- (1,0) [0|0] "g"').signals[0]
    guess = guess_quantity("M", signal, "", level)
    assert guess is not None
    assert (guess.quantity, guess.sign) == (quantity, sign)
    if level is None and quantity is not Quantity.UNUSED:
        said = "vertical by its name" if name.endswith("z") else "assumed to be vertical"
        assert said in guess.why


Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(("roll", "sure"), [(-0.35, True), (-0.3, False)])
def test_forward_explains_the_pushes_twice_as_well_as_the_next_best(
    roll: float, sure: bool
) -> None:
    """A push at the front left turns by 1 about y: forward fits by 1 - roll, right by 1 + roll."""
    for size in (1.0, 100.0):
        found = mounting(Z, 0.0, {FL: {"x": roll * size, "y": size}})
        assert found.surely_forward is sure
        assert axis_of(found.forward) == ("x", 1)


def test_the_axis_that_is_stated_is_taken_unless_it_is_vertical() -> None:
    turns = {FL: {"x": -1.0, "y": 1.0}}
    for stated, axis in (("-y", ("y", -1)), ("+y", ("y", 1)), ("-x", ("x", -1)), ("+z", ("x", 1))):
        found = mounting(Z, 3.0, turns, stated)
        assert (axis_of(found.forward), found.surely_forward) == (axis, True)
        assert found.tilt_deg == 3.0
    assert not mounting(Z, 0.0, None, "+z").surely_forward


@pytest.mark.parametrize(
    ("up", "forward"),
    [((0, 0, 1), ("x", 1)), ((0, 0, -1), ("x", 1)), ((0, 1, 0), ("x", 1)), ((1, 0, 0), ("z", -1)),
     ((-1, 0, 0), ("z", 1))],
)  # fmt: skip
def test_without_pushes_x_is_forward_or_else_z(
    up: tuple[int, int, int], forward: tuple[str, int]
) -> None:
    found = mounting(np.array(up, np.float64), 0.0, None)
    assert (axis_of(found.forward), found.surely_forward) == (forward, False)


@pytest.mark.parametrize(
    ("own", "others", "place"),
    [
        ({FL: 1.0}, [], None),
        ({FL: 0.0, FR: 0.0, RL: 0.0, RR: 0.0}, [], None),  # a dead one
        ({FL: 2.0, FR: -1.0}, [], (FL, 1)),
        ({FL: 1.0, RR: -2.0}, [], (RR, -1)),
        ({FL: 2.0, FR: 1.0}, [{FL: -2.0}, {FR: 9.0}], (FL, 1)),
        ({FL: 2.0, FR: 1.0}, [{FL: -2.1}], None),
    ],
)
def test_a_travel_is_where_its_own_push_moves_it_most(
    own: Mapping[Corner, float],
    others: list[Mapping[Corner, float]],
    place: tuple[Corner, int] | None,
) -> None:
    assert pushed_corner(own, others) == place


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
    traffic = {(0, can_id, False): arrivals(n, period_s, can_id, length)}
    sensors, absent = find_sensors((pot(cycle),), traffic)
    assert [(s.sensor.id_offset, s.surely) for s in sensors] == [(can_id - 385, False)] * found
    assert absent == () if found else ("pot.dbc",)


def test_an_answer_of_body_makes_an_acceleration_one_of_the_body() -> None:
    guess = Guess(Quantity.HUB_ACCELERATION, FL, -1, "why", "where?", Asked.CORNER)
    on_body = answered(guess, "body")
    assert (on_body.quantity, on_body.corner, on_body.sign, on_body.ask) == (
        Quantity.BODY_ACCELERATION, None, -1, "",
    )  # fmt: skip
    on_hub = answered(guess, "RL")
    assert (on_hub.quantity, on_hub.corner) == (Quantity.HUB_ACCELERATION, RL)


@pytest.mark.parametrize(
    ("name", "comment", "axis"),
    [
        ("AccZ", "", "z"),
        ("s1", "pitch rate", "y"),
        ("rateX", "z", "x"),  # the name goes before the comment
        ("gyroy", "", "y"),  # no word of its own, but the last letter
        ("gyrob", "", None),
        ("", "", None),
    ],
)
def test_an_axis_is_known_by_a_word_or_else_by_the_last_letter(
    name: str, comment: str, axis: str | None
) -> None:
    assert axis_by_name(name, comment) == axis
