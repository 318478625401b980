"""When an alarm begins, ends, is written and counted, on symptoms made by hand."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.alarms import ALARM, ALARM_END, EXPLAINED
from daq.alarms.debounce import Ledger
from daq.alarms.host import dropped_since, host_symptoms
from daq.alarms.inputs import Count, Window, fault
from daq.bench.config import RecorderConfig
from daq.clocks import Now
from daq.control.messages import DiskStatus, QueueStatus, StorageStatus


def now(monotonic_s: float) -> Now:
    return Now(round(monotonic_s * 1e9), monotonic_s)


SILENT = fault("bus_silent", "can0", "no frame")


def ledger_at(*turns: tuple[float, bool]) -> tuple[Ledger, list[tuple[float, str]]]:
    """Return the ledger after turns with and without a symptom, and its events."""
    ledger, events = Ledger(), list[tuple[float, str]]()
    for at_s, present in turns:
        ledger, found = ledger.advanced([SILENT] if present else [], {}, now(at_s), 7)
        events += [(at_s, event.code) for event in found]
    return ledger, events


@pytest.mark.parametrize(("away_s", "lasts"), [(1.4, True), (1.5, False)])
def test_an_alarm_ends_one_and_a_half_seconds_after_its_symptom(away_s: float, lasts: bool) -> None:
    ledger, events = ledger_at((10.0, True), (10.0 + away_s, False))
    assert bool(ledger.alarms) is lasts
    assert events == [(10.0, ALARM)] + [(11.5, ALARM_END)] * (not lasts)


@pytest.mark.parametrize(("again_s", "written"), [(24.9, False), (25.0, True)])
def test_an_alarm_is_written_again_after_fifteen_seconds(again_s: float, written: bool) -> None:
    ledger, events = ledger_at((10.0, True), (12.0, False), (again_s, True))
    assert [alarm.since_ns for alarm in ledger.alarms] == [round(again_s * 1e9)]
    assert events == [(10.0, ALARM), (12.0, ALARM_END)] + [(again_s, ALARM)] * written
    _, more = ledger_at((10.0, True), (12.0, False), (24.9, True), (26.5, False))
    assert more == [(10.0, ALARM), (12.0, ALARM_END)]  # no end of what was not written
    _, later = ledger_at((10.0, True), (12.0, False), (24.0, True), (25.0, True))
    assert later == [(10.0, ALARM), (12.0, ALARM_END), (25.0, ALARM)]


@pytest.mark.parametrize(("away_s", "kept"), [(30.0, True), (30.1, False)])
def test_an_alarm_that_has_ended_is_forgotten_after_half_a_minute(
    away_s: float, kept: bool
) -> None:
    ledger, _ = ledger_at((10.0, True), (12.0, False), (10.0 + away_s, False))
    assert bool(ledger.entries) is kept


def test_an_alarm_counts_while_it_lasts_and_the_first_of_a_kind_counts() -> None:
    key = ("crc_bad", "HUB")
    bad = fault(*key, "bad")
    ledger, (event,) = Ledger().advanced([bad, fault(*key, "other")], {key: (2, 5)}, now(1.0), 7)
    assert (event.t_ns, event.value, event.text) == (7, 5, "crc_bad HUB: bad")
    ledger, _ = ledger.advanced([fault(*key, "worse", "do")], {key: (3, 5)}, now(2.0), 8)
    (alarm,) = ledger.alarms
    assert (alarm.count, alarm.since_ns, alarm.text, alarm.advice) == (8, 10**9, "worse", "do")
    ledger, _ = ledger.advanced([], {}, now(3.6), 8)
    ledger, _ = ledger.advanced([bad], {key: (2, 5)}, now(4.0), 9)
    (alarm,) = ledger.alarms
    assert (alarm.count, alarm.since_ns) == (5, 4 * 10**9)
    assert alarm.advice == EXPLAINED["crc_bad"].advice
    _, (without,) = Ledger().advanced([fault("disk_low", "", "full")], {}, now(1.0), 7)
    assert (without.text, without.value) == ("disk_low: full", 0)


def test_at_most_256_alarms_are_kept() -> None:
    many = [fault("stale", f"M{n}", "") for n in range(300)]
    ledger, events = Ledger().advanced(many, {}, now(1.0), 7)
    assert (len(ledger.alarms), len(events)) == (256, 256)
    ledger, events = ledger.advanced(many, {}, now(1.1), 7)
    assert (len(ledger.alarms), len(events)) == (256, 0)


@pytest.mark.parametrize(("later_s", "total"), [(0.99, 5), (1.0, 2)])
def test_counts_are_those_of_the_last_second(later_s: float, total: int) -> None:
    key = ("crc_bad", "HUB")
    window = Window().advanced(10.0, {key: Count(3, "first")})
    window = window.advanced(10.0 + later_s, {key: Count(2)})
    assert window.numbers(10.0 + later_s) == {key: (2, total)}
    (symptom,) = window.symptoms(window.numbers(10.0 + later_s))
    detail = ": first" if total == 5 else ""
    text = f"{total} frames with a bad checksum in the last second{detail}"
    assert symptom == fault("crc_bad", "HUB", text)
    quiet = window.advanced(10.005 + later_s, {})
    assert quiet.numbers(10.005 + later_s) == {key: (0, total)}


@pytest.mark.parametrize(("number", "alarms"), [(4, 0), (5, 1)])
def test_error_frames_are_an_alarm_from_five_in_a_second_on(number: int, alarms: int) -> None:
    window = Window().advanced(1.0, {("error_frames", "can0"): Count(number)})
    assert len(window.symptoms(window.numbers(1.0))) == alarms


STORED = StorageStatus(100, 100, 0.0)
ROOM = DiskStatus(10**12, 0, 0, 0.0, total_bytes=2 * 10**12)


@pytest.mark.parametrize(("blocks", "high"), [(300, False), (301, True)])
def test_a_queue_is_high_when_more_than_half_full(blocks: int, high: bool) -> None:
    found = host_symptoms(RecorderConfig(), ROOM, QueueStatus(blocks, 600, 600), {}, STORED)
    assert [s.code for s in found] == ["queue_high"] * high
    assert [s.text for s in found] == ["301 of 600 blocks wait"] * high


def test_faults_of_the_disk_and_of_a_part_are_named() -> None:
    disk = replace(ROOM, failed="full", held_frames=12, warning="a file is gone")
    found = host_symptoms(RecorderConfig(), disk, QueueStatus(0, 0, 600), {"derive": "why"}, STORED)
    assert [(s.code, s.subject, s.text) for s in found] == [
        ("journal_failed", "", "full; 12 frames are held in memory"),
        ("journal_warning", "", "a file is gone"),
        ("consumer_failed", "derive", "why"),
    ]
    (failed,) = host_symptoms(
        RecorderConfig(), replace(ROOM, failed="full"), QueueStatus(0, 0, 600), {}, STORED
    )
    assert failed.text == "full"
    assert dropped_since(3, 3) == {}
    assert dropped_since(3, 5) == {("queue_dropped", ""): Count(2)}
