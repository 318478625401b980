"""A bench of three makers' sensors, proposed from rest and a push on each corner."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from daq.bench.config import Bench, BusConfig, bench_codec, parse_bench
from daq.bench.databases import Database, stored_text
from daq.channels import Quantity
from daq.check.check import check_bench
from daq.check.find_sensors import find_sensors, traffic_of
from daq.check.guess_map import guess_quantity, unit_by_gravity
from daq.check.mounting import axis_of, mounting, pushed_corner, up_axis
from daq.check.propose import Proposal, propose_sensors
from daq.check.pushes import find_pushes
from daq.vehicle import Corner
from dbc import FrameBatch, Severity, parse_codec

from ..wild_bench import DATABASES, IMU_A, NODES, POT, rest_and_pushes, wild_bench

FL, FR, RL, RR = Corner.FRONT_LEFT, Corner.FRONT_RIGHT, Corner.REAR_LEFT, Corner.REAR_RIGHT


@cache
def proposal(with_pushes: bool) -> Proposal:
    rest, pushes = rest_and_pushes()
    return propose_sensors(DATABASES, (), rest, pushes if with_pushes else None)


def bench_of(proposed: Proposal, databases: tuple[Database, ...] = DATABASES) -> Bench:
    """Return a proposal as a bench, which fits its databases."""
    bench = parse_bench(proposed.text, "proposed", Path(), stored_text(databases))
    bench_codec(bench)
    return bench


def by_signal(bench: Bench) -> dict[tuple[int, int, str], tuple[Quantity, float, Corner | None]]:
    """Return what channels are, by bus, identifier and signal: names of sensors do not matter."""
    codec = bench_codec(bench)
    found = {}
    for channel in bench.channels:
        name, _, signal = channel.signal.rpartition(".")
        message = codec.message(name)
        key = (message.bus or 0, message.can_id, signal)
        found[key] = (channel.quantity, channel.sign, channel.corner)
    return found


def test_every_sensor_is_found_as_it_is_mounted_in_truth() -> None:
    truth = {k: v for k, v in by_signal(wild_bench()).items() if v[0] != Quantity.UNUSED}
    found = by_signal(bench_of(proposal(True)))
    assert {key: found.get(key) for key in truth} == truth
    assert {v[0] for k, v in found.items() if k not in truth} == {Quantity.UNUSED}


def test_two_like_imus_are_two_sensors_and_four_nodes_are_four() -> None:
    sensors = {s.name: (s.database, s.bus, s.id_offset) for s in bench_of(proposal(True)).sensors}
    assert sensors == {
        "imu_a_1": ("imu_a.dbc", 0, 0), "imu_a_2": ("imu_a.dbc", 1, 0),
        "imu_b": ("imu_b.dbc", 0, 0), "hubs": ("hubs.dbc", 0, 0),
        "pot_1": ("pot.dbc", 1, 0), "pot_2": ("pot.dbc", 1, 1),
        "pot_3": ("pot.dbc", 1, 2), "pot_4": ("pot.dbc", 1, 3),
    }  # fmt: skip
    assert [q.partition(":")[0] for q in proposal(True).questions] == [
        "sensor pot_2", "sensor pot_3", "sensor pot_4",
    ]  # fmt: skip


def test_the_counters_of_one_maker_are_found() -> None:
    rules = {rule.name: rule.counter for rule in bench_of(proposal(True)).message_rules}
    assert rules == {
        "hubs.WheelAccelFront": "MsgCounter", "hubs.WheelAccelRear": "MsgCounter",
        "imu_b.Motion_Accel": "MsgCounter", "imu_b.Motion_Rate": "MsgCounter",
    }  # fmt: skip


def test_without_pushes_what_is_not_sure_is_asked() -> None:
    bench, questions = bench_of(proposal(False)), proposal(False).questions
    assert "sensor imu_a_1: does the sensor's +x axis point forward?" in questions
    assert "sensor imu_a_2: does the sensor's -z axis point forward?" in questions
    assert sum("its corner is guessed from the order of sensors" in each for each in questions) == 4
    assert proposal(False).text.count("# ASK: ") >= 8
    travels = {c.signal: c.corner for c in bench.channels if c.corner and "pot" in c.signal}
    assert list(travels.values()) == [FL, FR, RL, RR]  # of which the truth is another
    vertical = [c for c in bench.channels if c.quantity is Quantity.BODY_ACCELERATION]
    assert [(c.signal.rpartition(".")[2], c.sign) for c in vertical] == [
        ("AccZ", 1), ("AccX", 1), ("Accel_Vertical", -1),
    ]  # fmt: skip


def test_the_check_asks_until_the_marks_are_deleted() -> None:
    rest, _ = rest_and_pushes()
    bench = bench_of(proposal(False))
    asked = _asked(bench, rest)
    assert len(asked) == proposal(False).text.count("# ASK: ") >= 8
    assert any("does the sensor's +x axis point forward?" in text for text in asked)
    number = next(
        i for i, line in enumerate(bench.text.splitlines(), start=1) if line.startswith("# ASK")
    )
    assert any(text.startswith(f"bench.toml:{number}: asks: ") for text in asked)
    answered = replace(bench, text=bench.text.replace("# ASK: ", "# "))
    assert _asked(answered, rest) == []


def _asked(bench: Bench, rest: FrameBatch) -> list[str]:
    report = check_bench(bench, bench_codec(bench), rest, date(2026, 6, 1))
    found = [line for line in report.lines if line.code == "ask"]
    assert all(line.severity is Severity.WARNING for line in found)
    return [f"{line.subject}: {line.text}" for line in found]


def test_a_radar_is_no_suspension_travel_and_a_validity_no_acceleration() -> None:
    for proposed in (proposal(True), proposal(False), propose_sensors(DATABASES, (), None, None)):
        assert "Radar_FL_Distance" not in proposed.text
        assert "Validity_Accel_Vertical" not in proposed.text


def test_the_zero_of_a_travel_is_what_it_read_at_rest() -> None:
    codec = bench_codec(wild_bench())
    rest, _ = rest_and_pushes()
    decoded = codec.decode(rest)
    for channel in bench_of(proposal(True)).channels:
        if channel.quantity is Quantity.SUSPENSION_TRAVEL:
            node = next(n for n, corner in NODES.items() if corner == channel.corner)
            level = np.median(decoded[f"node_{node}.TPDO1.Position_Value"].value) * 1e-3
            assert channel.tare == pytest.approx(-level, rel=1e-4)


def test_the_buses_that_were_listened_to_are_written() -> None:
    buses = [BusConfig("socketcan", "can4", 250_000), BusConfig("pcan", "PCAN_USBBUS1", 1_000_000)]
    rest, _ = rest_and_pushes()
    bench = bench_of(propose_sensors(DATABASES, buses, rest, None))
    assert bench.buses == tuple(buses)


def test_a_database_of_which_nothing_came_is_named() -> None:
    rest, _ = rest_and_pushes()
    foreign = Database("foreign.dbc", POT.replace("385", "1200").replace("1793", "1201"))
    proposed = propose_sensors([*DATABASES, foreign], (), rest, None)
    assert "foreign.dbc" in proposed.text.partition("# Not on the bus: ")[2]
    assert all(s.database != "foreign.dbc" for s in bench_of(proposed).sensors)


def test_no_four_pushes_are_asked_for_again() -> None:
    rest, pushes = rest_and_pushes()
    first = pushes.select(pushes.t_ns < pushes.t_ns[0] + 3_000_000_000)
    proposed = propose_sensors(DATABASES, (), rest, first)
    assert proposed.questions[0].startswith("1 push was found instead of one on each")


@pytest.mark.parametrize(("offset", "is_found"), [(0x7F, True), (0x80, False)])
def test_a_like_device_lies_within_the_nodes_of_canopen(offset: int, is_found: bool) -> None:
    frames = _pots(offset, 5_000_000)
    found, _ = find_sensors([Database("pot.dbc", POT)], traffic_of(frames))
    assert [f.sensor.id_offset for f in found] == ([0, offset] if is_found else [0])


@pytest.mark.parametrize(("step_ns", "is_found"), [(5_400_000, True), (5_700_000, False)])
def test_a_like_device_has_the_rate_of_its_kind(step_ns: int, is_found: bool) -> None:
    found, _ = find_sensors([Database("pot.dbc", POT)], traffic_of(_pots(1, step_ns)))
    assert len(found) == 1 + is_found


def _pots(offset: int, step_ns: int) -> FrameBatch:
    """Return frames of one pot every 5 ms, and of another with its identifier and beat."""
    parts = []
    for can_id, step in ((385, 5_000_000), (385 + offset, step_ns)):
        n = 100
        flags, bus = np.zeros(n, np.uint16), np.zeros(n, np.uint8)
        length, data = np.full(n, 7, np.uint8), np.zeros((n, 8), np.uint8)
        ids = np.full(n, can_id, np.uint32)
        parts.append(FrameBatch(np.arange(n) * step, ids, flags, bus, length, data))
    frames = FrameBatch.concatenate(parts)
    return frames.by_time()


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
    found = up_axis(dict(zip("xyz", gravity, strict=True)))
    assert (axis_of(found[0]) if found else None) == up


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
            found = mounting(up, 0.0, seen)
            assert found.surely_forward
            np.testing.assert_array_equal(found.forward, forward)
            np.testing.assert_array_equal(found.left, left)
            tried += 1
    assert tried == 24


def test_pushes_that_show_nothing_leave_forward_open() -> None:
    still = {corner: dict.fromkeys("xyz", 0.0) for corner in Corner}
    found = mounting(np.array([0.0, 0.0, 1.0]), 0.0, still)
    assert not found.surely_forward
    assert axis_of(found.forward) == ("x", 1)


@pytest.mark.parametrize(("second", "is_clear"), [(4.9, True), (5.1, False)])
def test_a_travel_is_where_its_own_push_moves_it_twice_as_far(
    second: float, is_clear: bool
) -> None:
    own = {FL: -10.0, FR: second, RL: 1.0, RR: 0.0}
    assert pushed_corner(own, []) == ((FL, -1) if is_clear else None)
    assert pushed_corner(own, [{FL: 11.0}]) is None


def test_four_pushes_are_told_from_three_and_from_noise() -> None:
    t_ns = np.arange(0, 10_000, 10) * 1_000_000
    noise = np.random.default_rng(1).normal(0, 0.01, len(t_ns))
    value = noise.copy()
    for begin_s in (1.0, 3.0, 5.0, 7.0):
        inside = (t_ns >= begin_s * 1e9) & (t_ns < (begin_s + 0.8) * 1e9)
        value[inside] += np.sin(np.linspace(0, np.pi, inside.sum()))
    pushes, number = find_pushes({"a": (t_ns, value)})
    assert number == 4
    assert pushes is not None
    assert list(pushes.spans) == [FL, FR, RL, RR]
    assert pushes.peaks((t_ns, value))[FL] == pytest.approx(1.0, abs=0.05)
    turned = pushes.turns((t_ns, value))[RL]
    assert turned == pytest.approx(0.8 * 2 / np.pi, rel=0.05)  # the integral of a half sine
    early = t_ns < 6_000_000_000
    assert find_pushes({"a": (t_ns[early], value[early])}) == (None, 3)
    assert find_pushes({"a": (t_ns, noise)}) == (None, 0)


def test_units_that_are_not_stated_follow_from_gravity_or_are_asked() -> None:
    bare = IMU_A.replace('"m.s-2"', '""').replace('"rad.s-1"', '""')
    databases = (Database("imu_a.dbc", bare), *DATABASES[1:])
    rest, pushes = rest_and_pushes()
    proposed = propose_sensors(databases, (), rest, pushes)
    bench = bench_of(proposed, databases)
    units = {c.signal: c.signal_unit for c in bench.channels}
    assert units["imu_a_2.ImuAcceleration.AccX"] == "m/s2"
    assert units["imu_a_1.ImuRate.GyrY"] == "deg/s"
    assert "sensor imu_a_1: is it deg/s?" in proposed.questions
    assert [unit_by_gravity(x) for x in (1.0, 9.8, 1003.0, 3.0)] == ["g", "m/s2", "mg", None]


@pytest.mark.parametrize(
    ("name", "level_mm", "is_travel"),
    [
        ("Travel_FL", 999.0, True),
        ("Travel_FL", 1001.0, False),
        ("Radar_FL", 100.0, False),
        ("Distance_FL", 100.0, False),
        ("Damper_RR", None, True),
    ],
)
def test_lengths_that_may_be_travels(name: str, level_mm: float | None, is_travel: bool) -> None:
    signal = parse_codec(POT, "pot.dbc").message("TPDO1").signal("Position_Value")
    guess = guess_quantity("M", replace(signal, name=name), "", level_mm)
    assert (guess is not None and guess.quantity is Quantity.SUSPENSION_TRAVEL) == is_travel
