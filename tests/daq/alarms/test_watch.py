"""The watch of a healthy bench, of a hopeless one, and of faults that come and go."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.alarms.texts import EXPLAINED
from daq.alarms.watch import ALARM, ALARM_END
from daq.bus.error_frames import ErrorClass
from daq.bus.source import HopLosses
from daq.channels import Channel, Quantity
from daq.control.messages import BusState, DiskStatus, StorageStatus
from daq.samples.mapping import map_channels
from dbc import FrameBatch, parse_codec

from ..watched_bench import (
    CODEC,
    MAPPED,
    ROOMY,
    START_NS,
    WatchedBench,
    both,
    error_frames,
    foreign,
    frames,
    saturating,
)


def test_a_healthy_bench_raises_nothing_and_its_figures_are_right() -> None:
    bench = WatchedBench(["can0"])
    for _ in range(50):
        bench.turn(bench.healthy(motion=1.0))
    assert bench.alarms == []
    assert bench.events == []
    (bus,) = bench.state.buses
    # 1000 of 6 and 8 bytes each a second: 2 x 500 of 8, 2 x 1000 of 6, 2 x 500 of 6
    assert bus.frames_per_s == pytest.approx(4000, rel=1e-6)
    assert bus.frames == 20_000
    # Without any stuff bit and with as many as there can be.
    least = 1000 * (47 + 64) + 3000 * (47 + 48)
    most = 1000 * (47 + 64 + (34 + 64 - 1) // 4) + 3000 * (47 + 48 + (34 + 48 - 1) // 4)
    assert least < bus.load * 1_000_000 < most
    assert bus.state is BusState.OK
    assert (bench.state.sensors_alive, bench.state.sensors_expected) == (6, 6)


def test_what_piled_up_before_the_start_fills_no_bus() -> None:
    bench = WatchedBench(["can0"])
    bench.turn(FrameBatch.empty())
    piled = []
    for _ in range(30):  # 3 s of the bus, taken in at once
        piled.append(bench.healthy())
        bench.turns += 1
    bench.turns = 1
    bench.turn(FrameBatch.concatenate(piled))
    (bus,) = bench.state.buses
    assert bus.frames_per_s == pytest.approx(4000, rel=1e-3)
    assert 0.3 < bus.load < 0.6


def test_a_bus_that_is_being_opened_is_given_its_time() -> None:
    bench = WatchedBench(["can0"])
    bench.link(0, connected=False, heartbeat_s=5000.0)  # now
    for _ in range(9):
        bench.turn(FrameBatch.empty())
        assert bench.alarms == []
    for _ in range(3):
        bench.turn(FrameBatch.empty())
    assert [(a.code, a.text) for a in bench.alarms] == [("disconnected", "not connected")]


def test_the_alarms_come_in_order_of_severity() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(bench.healthy().select(slice(1, None)), foreign(bench))
    bench.link(1, connected=False, error="gone")
    bench.turn()
    assert [alarm.code for alarm in bench.alarms] == ["disconnected", "counter_gap"]


def test_sensors_on_a_bus_that_has_gone_are_counted_but_not_named_one_by_one() -> None:
    bench = WatchedBench(["can0"])
    for _ in range(10):
        bench.turn()
    bench.link(0, connected=False, error="has gone: No such device", advice="plug it in")
    for _ in range(40):
        bench.turn(FrameBatch.empty())
    assert [(a.code, a.text, a.advice) for a in bench.alarms] == [
        ("disconnected", "has gone: No such device", "plug it in")
    ]
    assert bench.bus_state(0) is BusState.DISCONNECTED
    assert (bench.state.sensors_alive, bench.state.sensors_expected) == (0, 6)
    bench.link(0, connected=True, error="", advice="", reopened=1)
    for _ in range(20):
        bench.turn()
    assert bench.alarms == []
    assert bench.state.sensors_alive == 6
    assert bench.state.buses[0].reopened == 1


def test_a_sensor_that_never_comes_is_named_and_a_bus_without_the_bench_is_one_alarm() -> None:
    bench = WatchedBench(["can0"])
    for _ in range(15):
        bench.turn(bench.healthy(without=["HUB_Rear"]))
    assert [(a.code, a.subject) for a in bench.alarms] == [("stale", "HUB_Rear")]

    # The hubs are on a bus of their own that never opens: its alarm is enough.
    messages = tuple(replace(m, bus=int("HUB" in m.name)) for m in CODEC.messages)
    bench = WatchedBench(codec=replace(CODEC, messages=messages))
    bench.link(1, connected=False, error="no such device")
    for _ in range(15):
        bench.turn(bench.healthy(without=["HUB_Front", "HUB_Rear"]))
    assert [(a.code, a.subject) for a in bench.alarms] == [("disconnected", "can1")]

    strange = WatchedBench()
    for _ in range(30):
        strange.turn(foreign(strange))
    reported = [(a.code, a.subject) for a in strange.alarms]
    assert reported == [("bus_silent", "can0"), ("none_of_dbc", "")]
    assert "but 0x700" in strange.alarms[-1].text


def test_a_fault_that_hovers_at_its_threshold_does_not_flap() -> None:
    bench = WatchedBench(["can0"])
    for k in range(80):  # some seconds have five, others four or six
        bad = error_frames(PROT, b"", bench.t_ns + 99_500_000, bus=0, n=k * 7 % 2)
        bench.turn(bench.healthy(), *[bad] * (k % 20 != 3))
    assert bench.logged(ALARM) == ["error_frames can0"]
    assert bench.logged(ALARM_END) == []


SLOW_DBC = """VERSION ""
BU_: S
BO_ 512 Slow: 8 S
 SG_ level : 0|16@1+ (0.001,0) [0|0] "m" S
"""


def test_a_message_without_a_period_is_late_after_two_seconds_if_it_has_channels() -> None:
    codec = parse_codec(SLOW_DBC, "slow")
    level = [Channel("level", Quantity.BODY_DISPLACEMENT, "m", "Slow.level")]
    for channels in ([], level):
        bench = WatchedBench(["can0"], codec, map_channels(channels, codec.messages, "slow"))
        for k in range(60):
            comes = [frames(512, [bytes(8)], bench.t_ns)] if k < 10 else []
            bench.turn(frames(0x7, [b""], bench.t_ns), *comes)
            is_late = bench.alarm("stale", "Slow") is not None
            assert is_late == (bool(channels) and k >= 9 + 21), k


RANGED_DBC = """VERSION ""
BU_: S
BO_ 256 Sensor: 8 S
 SG_ real : 0|32@1- (1,0) [0|0] "m/s2" S
 SG_ ranged : 32|16@1- (0.01,0) [-100|100] "m/s2" S
 SG_ named : 48|16@1+ (0.01,-100) [-100|500] "m/s2" S
SIG_VALTYPE_ 256 real : 1;
VAL_ 256 named 65535 "not available" ;
"""


def test_values_that_are_none_or_cannot_be_are_counted_per_channel() -> None:
    codec = parse_codec(RANGED_DBC, "ranged")
    channels = [
        Channel(name, Quantity.BODY_ACCELERATION, "m/s2", f"Sensor.{name}")
        for name in ("real", "ranged", "named")
    ]
    bench = WatchedBench(["can0"], codec, map_channels(channels, codec.messages, "ranged"))
    rng = np.random.default_rng(3)

    def payloads(n: int) -> list[bytes]:
        return [
            struct.pack("<fhH", rng.normal(), rng.integers(-99, 99), rng.integers(9000, 11000))
            for _ in range(n)
        ]

    for _ in range(10):
        bench.turn(frames(256, payloads(10), bench.t_ns))
    assert bench.alarms == []
    for _ in range(10):
        odd = [
            struct.pack("<fhH", math.nan, 12_000, 10_000),
            struct.pack("<fhH", math.inf, 0, 0xFFFF),
        ]
        bench.turn(frames(256, [*payloads(8), *odd], bench.t_ns))
    counts = {(a.code, a.subject): a.count for a in bench.alarms}
    assert counts == {
        ("saturated", "ranged"): 10,
        ("no_value", "named"): 10,
        ("no_value", "real"): 20,
    }
    assert bench.state.overloaded == ("ranged",)


def test_bus_off_lasts_until_a_frame_is_received_and_shows_what_the_controller_counted() -> None:
    bench = WatchedBench()
    for _ in range(10):
        bench.turn(*both(bench))
    counters = OFF | ErrorClass.COUNTERS
    bench.turn(bench.healthy(), error_frames(counters, bytes([0] * 6 + [248, 5]), bench.t_ns))
    bus = bench.state.buses[1]
    assert (bus.state, bus.tx_errors, bus.rx_errors) == (BusState.BUS_OFF, 248, 5)
    for _ in range(40):
        bench.turn(bench.healthy())
    assert bench.bus_state(1) is BusState.BUS_OFF
    assert bench.alarms[0].code == "bus_off"
    assert bench.alarm("bus_silent", "can1") is None  # bus-off says why
    for _ in range(30):
        bench.turn(*both(bench))
    assert bench.bus_state(1) is BusState.OK
    assert bench.alarms == []


# Times: of events, of a clock that was set, of a bus that is quiet ------------------------------

NOTHING = FrameBatch.empty()
REFUSED = DiskStatus(0, 0, 0, 3.0, 812, "No space left")


def test_an_event_has_the_time_of_the_last_frame_or_else_of_the_clock() -> None:
    bench = WatchedBench()
    bench.turn(NOTHING, disk=REFUSED)
    assert {event.t_ns for _, event in bench.events} == {START_NS + 100_000_000}
    bench = WatchedBench()
    frames = bench.healthy()
    bench.turn(frames, foreign(bench))
    bench.turn(NOTHING)
    events = bench.turn(NOTHING, disk=REFUSED)
    assert "journal_failed: No space left; 812 frames are held in memory" in [
        e.text for e in events
    ]
    assert {e.t_ns for e in events} == {START_NS + 40_000}  # the last of the other bus's frames


def test_a_bus_with_channels_is_dead_while_it_delivers_nothing() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    bench.link(0, connected=False, error="has gone", advice="plug it in")
    bench.turn(foreign(bench))
    assert bench.state.dead_bus == bench.alarm("disconnected", "can0")
    bench.link(1, connected=False, error="has gone", advice="plug it in")  # without channels
    bench.link(0, connected=True, error="", advice="")
    for _ in range(9):
        bench.turn(bench.healthy())
    assert bench.alarm("disconnected", "can1")
    assert bench.state.dead_bus is None


def test_a_bus_without_power_is_one_alarm_and_sensors_without_power_are_one_line() -> None:
    bench = WatchedBench(["can0"])
    for _ in range(15):
        bench.turn()
    for _ in range(20):
        bench.turn(bench.healthy(without=["HUB_Front", "HUB_Rear"]))
    grouped = [(a.code, a.subject) for a in bench.state.grouped_alarms]
    assert grouped == [("stale", "HUB_Front, HUB_Rear")]
    assert len(bench.alarms) == 2  # in the journal, one by one
    shown = set()
    for _ in range(30):
        bench.turn(NOTHING)
        names = [(a.code, a.subject) for a in bench.state.grouped_alarms]
        shown.update(names)
    assert names == [("bus_silent", "can0")]
    assert shown == {*grouped, *names}, "no message is named meanwhile"


@pytest.mark.parametrize(("in_a_second", "is_alarm"), [(4, False), (5, True)])
def test_five_error_frames_in_a_second_are_an_alarm(in_a_second: int, is_alarm: bool) -> None:
    bench = WatchedBench()
    bad = error_frames(ErrorClass.PROTOCOL, b"", bench.t_ns + 90_000_000, n=in_a_second)
    bench.turn(*both(bench), bad)
    assert (bench.alarm("error_frames", "can1") is not None) is is_alarm


def test_an_overload_lamp_is_on_until_it_is_acknowledged_also_on_another_bench() -> None:
    bench = WatchedBench(["can0"])
    bench.turn(saturating(bench))
    bench.turn()
    bench.state.adopt(CODEC, MAPPED)
    bench.turn()
    assert bench.state.overloaded == ("hub_acc_fl",)
    bench.state.acknowledge()
    assert not bench.state.overloaded


@pytest.mark.parametrize(
    ("free_gb", "total_gb", "warned"),
    [(1.99, 4.0, True), (2.01, 4.0, False), (9.99, 100.0, True), (10.01, 100.0, False)],
)
def test_little_room_is_ten_reserves_or_a_tenth_of_the_disk(
    free_gb: float, total_gb: float, warned: bool
) -> None:
    """The usual reserve is 200 MB."""
    bench = WatchedBench()
    bench.turn(disk=replace(ROOMY, free_bytes=int(free_gb * 1e9), total_bytes=int(total_gb * 1e9)))
    assert bool(bench.alarm("disk_low", "")) is warned


# R9, the watch: every fault is named within a second, counted exactly, and over with the  ---------

FAULTY_TURNS = 12
NAMED_WITHIN_S, OVER_WITHIN_S = 1.0, 5.0

FaultyTurn = Callable[[WatchedBench, int], object]
"""Takes the turn of this number with the fault in it."""


def payload(frame_batch: FrameBatch, message: str) -> NDArray[np.intp]:
    return np.flatnonzero(frame_batch.can_id == CODEC.message(message).can_id)


def losing(field: str, number: int) -> FaultyTurn:
    def turn(bench: WatchedBench, k: int) -> object:
        bench.link(1, losses=HopLosses(**{field: number * (k + 1)}))
        return bench.turn(*both(bench))

    return turn


def unplugged(bench: WatchedBench, k: int) -> object:
    bench.link(1, connected=False, error="has gone: No such device", advice="plug it in")
    bench.turn(bench.healthy())
    bench.link(1, connected=True, error="", advice="")  # for the first turn after the fault
    return None


def taken_down(bench: WatchedBench, k: int) -> object:
    bench.link(1, interface_down=True)
    bench.turn(bench.healthy())
    bench.link(1, interface_down=False)
    return None


def error_turn(classes: ErrorClass, data: bytes, n: int, also_good: bool) -> FaultyTurn:
    def turn(bench: WatchedBench, k: int) -> object:
        bad = error_frames(classes, data, bench.t_ns + 90_000_000, n=n)
        good = [foreign(bench)] if also_good else []
        return bench.turn(bench.healthy(), *good, bad)

    return turn


def silent(bench: WatchedBench, k: int) -> object:
    return bench.turn(bench.healthy())


def crowded(bench: WatchedBench, k: int) -> object:
    bench.link(0, bitrate=300_000)
    bench.turn(*both(bench))
    bench.link(0, bitrate=1_000_000)
    return None


def sensor_silent(bench: WatchedBench, k: int) -> object:
    return bench.turn(bench.healthy(without=["IMU_Rate"]), foreign(bench))


def cut_short(bench: WatchedBench, k: int) -> object:
    whole = bench.healthy()
    length = whole.length.copy()
    length[payload(whole, "SUSP_Rear")[:3]] = 4
    return bench.turn(replace(whole, length=length), foreign(bench))


def flipped_bit(bench: WatchedBench, k: int) -> object:
    whole = bench.healthy()
    data = whole.data.copy()
    data[payload(whole, "HUB_Front")[10:12], 0] ^= 0x10
    return bench.turn(replace(whole, data=data), foreign(bench))


def lost_frames(bench: WatchedBench, k: int) -> object:
    whole = bench.healthy()
    keep = np.ones(len(whole), bool)
    keep[payload(whole, "HUB_Rear")[20:23]] = False
    return bench.turn(whole.select(keep), foreign(bench))


def saturated(bench: WatchedBench, k: int) -> object:
    return bench.turn(saturating(bench), foreign(bench))


def facts(**given: object) -> FaultyTurn:
    return lambda bench, _: bench.turn(*both(bench), **given)


def queue_drops(bench: WatchedBench, k: int) -> object:
    bench.hops = HopLosses(queue_dropped=7 * (k + 1))
    return bench.turn(*both(bench))


CTRL, OFF, PROT = ErrorClass.CONTROLLER, ErrorClass.BUS_OFF, ErrorClass.PROTOCOL
PASSIVE_BYTES = bytes([0, 0x10, 0, 0, 0, 0, 3, 130])
OVERFLOW_BYTES = bytes([0, 0x01])

FAULTS: list[tuple[str, str, FaultyTurn, int]] = [
    ("disconnected", "can1", unplugged, 0),
    ("bus_off", "can1", error_turn(OFF, b"", 1, True), 1),
    ("error_passive", "can1", error_turn(CTRL, PASSIVE_BYTES, 1, True), 0),
    ("error_frames", "can1", error_turn(PROT, b"", 2, True), 2),
    ("check_bitrate", "can1", error_turn(PROT, b"", 2, False), 0),
    ("overrun", "can1", error_turn(CTRL, OVERFLOW_BYTES, 2, True), 2),
    ("overrun", "can1", losing("bus_dropped", 13), 13),
    ("garbled", "can1", losing("bus_garbled", 3), 3),
    ("interface_down", "can1", taken_down, 0),
    ("bus_silent", "can1", silent, 0),
    ("bus_full", "can0", crowded, 0),
    ("stale", "IMU_Rate", sensor_silent, 0),
    ("wrong_length", "SUSP_Rear", cut_short, 3),
    ("crc_bad", "HUB_Front", flipped_bit, 2),
    ("counter_gap", "HUB_Rear", lost_frames, 3),
    ("saturated", "", saturated, 4),
    ("queue_dropped", "", queue_drops, 7),
    ("disk_low", "", facts(disk=replace(ROOMY, free_bytes=500_000_000)), 0),
    ("journal_warning", "", facts(disk=replace(ROOMY, warning="a file was deleted")), 0),
    ("journal_failed", "", facts(disk=DiskStatus(0, 0, 0, 3.0, 812, "No space left")), 0),
    ("not_recording", "", facts(storage=StorageStatus(900, 100, 3.1)), 0),
    ("consumer_failed", "trigger", facts(failed={"trigger": "ValueError: x"}), 0),
]


@pytest.mark.parametrize(("code", "subject", "faulty", "each"), FAULTS)
def test_a_fault_is_named_within_a_second_counted_and_over_within_five(
    code: str, subject: str, faulty: FaultyTurn, each: int
) -> None:
    bench = WatchedBench()
    for _ in range(4):
        bench.turn(*both(bench))
    assert bench.alarms == []

    if code == "saturated":
        subject = next(m.channel.name for m in MAPPED if m.message.name == "HUB_Front")
    began_s, named_s = bench.now_s, None
    for k in range(FAULTY_TURNS):
        faulty(bench, k)
        if named_s is None and bench.alarm(code, subject):
            named_s = bench.now_s
    alarm = bench.alarm(code, subject)
    assert named_s is not None, bench.alarms
    assert alarm is not None
    assert named_s - began_s <= NAMED_WITHIN_S + 1e-9
    assert alarm.count == each * FAULTY_TURNS
    assert alarm.text.startswith("20 error frames in the last second" * (code == "check_bitrate"))
    assert alarm.advice
    assert (alarm.since_ns - bench.t_ns) * 1e-9 <= 0

    over_s = bench.now_s
    while bench.alarm(code, subject) and bench.now_s < over_s + OVER_WITHIN_S:
        bench.turn(*both(bench))
    assert bench.alarm(code, subject) is None
    name = f"{code} {subject}".strip()
    assert bench.logged(ALARM).count(name) == 1
    assert bench.logged(ALARM_END).count(name) == 1


ELSEWHERE = {"none_of_dbc", "no_value"}
"""Codes whose faults are injected by the tests below."""


def test_every_alarm_is_explained_and_every_explained_alarm_is_raised_by_a_test() -> None:
    assert {code for code, *_ in FAULTS} | ELSEWHERE == set(EXPLAINED)
    for explanation in EXPLAINED.values():
        assert explanation.title
        assert explanation.advice
