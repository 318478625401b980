"""R9, the watch: every fault is named within a second, counted exactly, and over with the fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.alarms import ALARM, ALARM_END, EXPLAINED, GRAVITY
from daq.alarms.texts import COUNTED
from daq.bus.error_frames import ErrorClass
from daq.bus.source import HopLosses
from daq.channels import Quantity
from daq.control.messages import DiskStatus, StorageStatus
from dbc import FrameBatch

from ..watched_bench import (
    CODEC,
    MAPPED,
    ROOMY,
    WatchedBench,
    both,
    error_frames,
    foreign,
    saturating,
)

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


def frozen_at_rest(bench: WatchedBench, k: int) -> object:
    return bench.turn(bench.healthy(values={FINE.signal: 0.25}), foreign(bench))


def frozen_in_motion(bench: WatchedBench, k: int) -> object:
    moving = bench.healthy(values={COARSE.signal: 0.0}, motion=4.0 if k > 1 else 0.0)
    return bench.turn(moving, foreign(bench))


def facts(**given: object) -> FaultyTurn:
    return lambda bench, _: bench.turn(*both(bench), **given)


def queue_drops(bench: WatchedBench, k: int) -> object:
    bench.hops = HopLosses(queue_dropped=7 * (k + 1))
    return bench.turn(*both(bench))


FINE = next(m.channel for m in MAPPED if m.channel.quantity is Quantity.BODY_ACCELERATION)
COARSE = next(m.channel for m in MAPPED if m.channel.quantity is Quantity.SUSPENSION_TRAVEL)
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
    ("stuck", FINE.name, frozen_at_rest, 0),
    ("stuck", COARSE.name, frozen_in_motion, 0),
    ("queue_dropped", "", queue_drops, 7),
    ("disk_low", "", facts(disk=replace(ROOMY, free_bytes=500_000_000)), 0),
    ("journal_warning", "", facts(disk=replace(ROOMY, warning="a file was deleted")), 0),
    ("journal_failed", "", facts(disk=DiskStatus(0, 0, 0, 3.0, 812, "No space left")), 0),
    ("not_recording", "", facts(storage=StorageStatus(900, 100, 3.1)), 0),
    ("consumer_failed", "trigger", facts(failed={"trigger": "ValueError: x"}), 0),
]


@pytest.mark.parametrize(
    ("code", "subject", "faulty", "each"),
    FAULTS,
    ids=[f"{f[0]}-{i}" for i, f in enumerate(FAULTS)],
)
def test_a_fault_is_named_within_a_second_counted_and_over_within_five(
    code: str, subject: str, faulty: FaultyTurn, each: int
) -> None:
    bench = WatchedBench()
    for _ in range(12):
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
    assert alarm.text
    assert alarm.advice
    assert (alarm.since_ns - bench.t_ns) * 1e-9 <= 0

    over_s = bench.now_s
    while bench.alarm(code, subject) and bench.now_s < over_s + OVER_WITHIN_S:
        bench.turn(*both(bench))
    assert bench.alarm(code, subject) is None
    name = f"{code} {subject}".strip()
    assert bench.logged(ALARM).count(name) == 1
    assert bench.logged(ALARM_END).count(name) == 1


ELSEWHERE = {"none_of_dbc", "clock_step", "no_value"}
"""Codes whose faults are injected by the tests below."""


def test_every_alarm_is_explained_and_every_explained_alarm_is_raised_by_a_test() -> None:
    assert {code for code, *_ in FAULTS} | ELSEWHERE == set(EXPLAINED)
    assert set(COUNTED) <= set(EXPLAINED)
    assert list(GRAVITY.values()) == sorted(GRAVITY.values())
    for explanation in EXPLAINED.values():
        assert explanation.title
        assert explanation.meaning
        assert explanation.advice
