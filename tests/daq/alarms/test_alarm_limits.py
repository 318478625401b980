"""The limits of the alarms, each from both sides, on states made by hand: no bench, no bus."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.alarms import ALARM, ALARM_END, EXPLAINED
from daq.alarms.buses import BusWatch, advance_buses, bus_status, bus_symptoms
from daq.alarms.debounce import Ledger
from daq.alarms.host import dropped_since, host_symptoms
from daq.alarms.inputs import Count, Symptom, Window
from daq.alarms.messages import (
    MessagesWatch,
    MessageWatch,
    Stranger,
    advance_messages,
    alive,
    message_symptoms,
)
from daq.alarms.signals import (
    Limits,
    SignalsWatch,
    Standing,
    _stand,
    advance_signals,
    limits_of,
    signal_symptoms,
)
from daq.bench.config import RecorderConfig
from daq.bus.error_frames import ControllerState, ErrorClass
from daq.bus.source import LinkFacts, SourceLosses
from daq.channels import Quantity
from daq.clocks import Now
from daq.control.messages import BusState, DiskStatus, QueueStatus
from daq.samples.health import HealthState
from daq.samples.mapping import MappedChannel
from dbc import FrameBatch, FrameFlag
from dbc.samples import Quality, Samples

from ..watched_bench import CODEC, MAPPED, error_frames, frames

LINK = LinkFacts("can0", 500_000, True, "", "", 0.0, 0, SourceLosses())
USED = next(m for m in MAPPED if m.channel.quantity is not Quantity.UNUSED)
MESSAGE = CODEC.messages[0]
T_NS = 1_800_000_000_000_000_000
NOTHING = FrameBatch.concatenate([frames(0x700, [bytes(8)], T_NS)]).select(np.zeros(0, np.intp))


def now(monotonic_s: float) -> Now:
    return Now(round(monotonic_s * 1e9), monotonic_s)


SILENT = Symptom("bus_silent", "can0", "no frame")


def ledger_at(*turns: tuple[float, bool]) -> tuple[Ledger, list[tuple[float, str]]]:
    """Return the ledger after turns with and without a symptom, and its events."""
    ledger, events = Ledger(), list[tuple[float, str]]()
    for at_s, present in turns:
        ledger, found = ledger.advanced([SILENT] if present else [], now(at_s), 7)
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
    counted = Symptom("crc_bad", "HUB", "bad", new=2, recent=5)
    ledger, (event,) = Ledger().advanced([counted, replace(counted, text="other")], now(1.0), 7)
    assert (event.t_ns, event.value, event.text) == (7, 5, "crc_bad HUB: bad")
    ledger, _ = ledger.advanced([replace(counted, new=3, text="worse", advice="do")], now(2.0), 8)
    (alarm,) = ledger.alarms
    assert (alarm.count, alarm.since_ns, alarm.text, alarm.advice) == (8, 10**9, "worse", "do")
    ledger, _ = ledger.advanced([], now(3.6), 8)
    ledger, _ = ledger.advanced([counted], now(4.0), 9)
    (alarm,) = ledger.alarms
    assert (alarm.count, alarm.since_ns) == (5, 4 * 10**9)
    assert alarm.advice == EXPLAINED["crc_bad"].advice
    _, (without,) = Ledger().advanced([Symptom("disk_low", "", "full")], now(1.0), 7)
    assert without.text == "disk_low: full"


def test_at_most_256_alarms_are_kept() -> None:
    many = [Symptom("stale", f"M{n}", "") for n in range(300)]
    ledger, events = Ledger().advanced(many, now(1.0), 7)
    assert (len(ledger.alarms), len(events)) == (256, 256)
    ledger, events = ledger.advanced(many, now(1.1), 7)
    assert (len(ledger.alarms), len(events)) == (256, 0)


@pytest.mark.parametrize(("later_s", "total"), [(0.99, 5), (1.0, 2)])
def test_counts_are_those_of_the_last_second(later_s: float, total: int) -> None:
    key = ("crc_bad", "HUB")
    window = Window().advanced(10.0, {key: Count(3, "first")})
    window = window.advanced(10.0 + later_s, {key: Count(2)})
    (symptom,) = window.symptoms(10.0 + later_s)
    detail = ": first" if total == 5 else ""
    text = f"{total} frames with a bad checksum in the last second{detail}"
    assert symptom == Symptom("crc_bad", "HUB", text, 2, total)
    (quiet,) = window.advanced(10.1 + later_s, {}).symptoms(10.1 + later_s)
    assert (quiet.new, quiet.recent) == (0, 5 if later_s + 0.1 < 1.0 else 2)


@pytest.mark.parametrize(("number", "alarms"), [(4, 0), (5, 1)])
def test_error_frames_are_an_alarm_from_five_in_a_second_on(number: int, alarms: int) -> None:
    window = Window().advanced(1.0, {("error_frames", "can0"): Count(number)})
    assert len(window.symptoms(1.0)) == alarms


ROOM = DiskStatus(10**12, 0, 0, 0.0, total_bytes=2 * 10**12)


@pytest.mark.parametrize(("blocks", "high"), [(300, False), (301, True)])
def test_a_queue_is_high_when_more_than_half_full(blocks: int, high: bool) -> None:
    found = host_symptoms(RecorderConfig(), ROOM, QueueStatus(blocks, 600, 600), {})
    assert [s.code for s in found] == ["queue_high"] * high
    assert [s.text for s in found] == ["301 of 600 blocks wait"] * high


def test_faults_of_the_disk_and_of_a_part_are_named() -> None:
    disk = replace(ROOM, failed="full", held_frames=12, warning="a file is gone")
    found = host_symptoms(RecorderConfig(), disk, QueueStatus(0, 0, 600), {"derive": "why"})
    assert [(s.code, s.subject, s.text) for s in found] == [
        ("journal_failed", "", "full; 12 frames are held in memory"),
        ("journal_warning", "", "a file is gone"),
        ("consumer_failed", "derive", "why"),
    ]
    (failed,) = host_symptoms(
        RecorderConfig(), replace(ROOM, failed="full"), QueueStatus(0, 0, 600), {}
    )
    assert failed.text == "full"
    assert dropped_since(3, 3) == {}
    assert dropped_since(3, 5) == {("queue_dropped", ""): Count(2)}


def watched(**facts: Any) -> BusWatch:
    fresh = BusWatch("can0", 0.0, 0.0, 0.0, recent=((0.0, 0, 0, 0.0, 0),))
    return replace(fresh, **facts)


@pytest.mark.parametrize(
    ("quiet_s", "controller", "connected", "state"),
    [
        (1.9, None, True, BusState.OK),
        (2.0, None, True, BusState.SILENT),
        (1.9, ControllerState.PASSIVE, True, BusState.ERROR_PASSIVE),
        (2.0, ControllerState.PASSIVE, True, BusState.SILENT),
        (1.9, ControllerState.WARNING, True, BusState.OK),
        (0.0, ControllerState.BUS_OFF, True, BusState.BUS_OFF),
        (0.0, ControllerState.BUS_OFF, False, BusState.DISCONNECTED),
    ],
)
def test_states_of_a_bus(
    quiet_s: float, controller: ControllerState | None, connected: bool, state: BusState
) -> None:
    watch = watched(good_s=10.0 - quiet_s, controller=controller)
    assert bus_status(watch, replace(LINK, connected=connected), 2.0, 10.0).state is state


def test_load_and_frames_a_second_are_those_of_the_turns_after_the_first() -> None:
    """Two turns with 100 frames and 25,000 bits each in 0.4 s at 500 kbit/s: 25 %."""
    turns = ((9.6, 70, 1, 9e4, 0), (9.8, 100, 0, 25e3, 0), (10.0, 100, 0, 25e3, 0))
    status = bus_status(watched(recent=turns, frames=270), LINK, 2.0, 10.0)
    assert status.load == pytest.approx(0.25)
    assert status.frames_per_s == pytest.approx(500.0)
    stamped = tuple((*t[:4], T_NS + n * 10**9) for n, t in enumerate(turns))
    slow = bus_status(watched(recent=stamped), LINK, 2.0, 10.0)
    assert slow.frames_per_s == pytest.approx(100.0)  # 2 s by the stamps
    sudden = bus_status(watched(recent=((9.99, 0, 0, 0.0, 0), turns[2])), LINK, 2.0, 10.0)
    assert sudden.frames_per_s == pytest.approx(1000.0)  # over a tenth of a second at least


def test_a_block_is_taken_in() -> None:
    batch = FrameBatch.concatenate(
        [
            frames(0x10, [bytes(8)] * 3, T_NS),
            frames(0x11, [bytes(8)], T_NS + 5_000),  # earlier than the one before
            error_frames(ErrorClass.PROTOCOL, bytes(8), T_NS + 90_000, bus=0, n=2),
            frames(0x12, [bytes(8)] * 4, T_NS, bus=1),
        ]
    )
    links = (replace(LINK, losses=SourceLosses(7, 5, 3)), replace(LINK, name="can1"))
    before = (watched(last_ns=T_NS + 1, losses=SourceLosses(1, 1, 1)),)
    (first, second), counts = advance_buses(before, links, batch, 10.0)
    assert {key: count.number for key, count in counts.items()} == {
        ("overrun", "can0"): 6,
        ("garbled", "can0"): 4,
        ("restamped", "can0"): 2,
        ("time_back", "can0"): 2,
        ("error_frames", "can0"): 2,
    }
    assert (first.frames, first.error_frames, first.last_ns) == (4, 2, T_NS + 100_000)
    assert (first.heard_s, first.good_s, first.error_s) == (10.0, 10.0, 10.0)
    assert (second.frames, second.error_frames, second.connected_s) == (4, 0, 10.0)
    assert [turn[:3] for turn in first.recent] == [(0.0, 0, 0), (10.0, 4, 2)]
    assert first.losses == SourceLosses(7, 5, 3)
    (later, _), none = advance_buses((first, second), links, NOTHING, 10.5)
    assert none == {}
    assert (later.frames, later.heard_s, later.last_ns) == (4, 10.0, T_NS + 100_000)
    (gone, _), _ = advance_buses(
        (later, second), (replace(links[0], connected=False), links[1]), NOTHING, 11.0
    )
    assert (gone.connected_s, gone.heard_s, gone.good_s) == (11.0, 11.0, 11.0)
    (other,), _ = advance_buses((gone,), (replace(LINK, name="vcan"),), NOTHING, 12.0)
    assert (other.name, other.frames, other.good_s) == ("vcan", 0, 12.0)


def test_the_turns_of_the_last_second_and_one_before_are_kept() -> None:
    watches: tuple[BusWatch, ...] = ()
    for at_s in (1.0, 1.5, 2.0, 2.5, 3.0):
        batch = frames(0x10, [bytes(8)], T_NS + round(at_s * 1e9))
        watches, _ = advance_buses(watches, (LINK,), batch, at_s)
    assert [turn[0] for turn in watches[0].recent] == [2.0, 2.5, 3.0]


@pytest.mark.parametrize(("calm_s", "state"), [(1.9, "error-passive"), (2.0, "error-active")])
def test_a_controller_that_receives_is_well_two_seconds_after_its_last_error(
    calm_s: float, state: str
) -> None:
    watch = watched(
        controller=ControllerState.PASSIVE, tx_errors=130, rx_errors=1, error_s=10.0, good_s=10.0
    )
    (after,), _ = advance_buses((watch,), (LINK,), frames(0x10, [bytes(8)], T_NS), 10.0 + calm_s)
    assert after.controller == state
    assert (after.tx_errors, after.rx_errors) == ((130, 1) if calm_s < 2.0 else (None, None))
    deaf = watched(controller=ControllerState.PASSIVE, error_s=10.0, good_s=10.0)
    (still,), _ = advance_buses((deaf,), (LINK,), NOTHING, 20.0)
    assert still.controller is ControllerState.PASSIVE


def test_a_controller_is_off_until_a_frame_comes_after_its_report() -> None:
    off = error_frames(ErrorClass.BUS_OFF, bytes(8), T_NS, bus=0)
    good = frames(0x10, [bytes(8)], T_NS + 10)
    for batch, state in (
        (off, ControllerState.BUS_OFF),
        (FrameBatch.concatenate([good, off]), ControllerState.BUS_OFF),
        (FrameBatch.concatenate([off, good]), ControllerState.ACTIVE),
        (FrameBatch.concatenate([off, good, off]), ControllerState.BUS_OFF),
    ):
        (after,), counts = advance_buses((watched(),), (LINK,), batch, 1.0)
        assert after.controller is state
        assert counts["bus_off", "can0"].number == int(np.count_nonzero(batch.flags))


def symptoms(watch: BusWatch, link: LinkFacts = LINK, now_s: float = 10.0) -> list[Symptom]:
    return bus_symptoms(watch, link, bus_status(watch, link, 2.0, now_s), 2.0, now_s)


@pytest.mark.parametrize(("beat_s", "named"), [(8.1, False), (8.0, True)])
def test_a_bus_is_given_two_seconds_to_be_opened(beat_s: float, named: bool) -> None:
    link = replace(LINK, connected=False, heartbeat_s=beat_s)
    assert [s.text for s in symptoms(watched(), link)] == ["not connected"] * named
    (at_once,) = symptoms(watched(), replace(link, error="gone", advice="plug it in"))
    assert (at_once.code, at_once.text, at_once.advice) == ("disconnected", "gone", "plug it in")


def test_a_silent_bus_with_error_frames_has_another_bit_rate() -> None:
    silent = watched(good_s=7.5)
    (found,) = symptoms(silent)
    assert (found.code, found.text) == ("bus_silent", "no frame for 2.5 s")
    (found,) = symptoms(replace(silent, recent=((9.0, 0, 3, 0.0, 0), (10.0, 0, 4, 0.0, 0))))
    assert found.code == "check_bitrate"
    assert found.text == "7 error frames in the last second and no good frame for 2.5 s"
    (found,) = symptoms(silent, replace(LINK, interface_down=True, name="socketcan can3"))
    assert (found.code, found.advice.split("`")[1]) == (
        "interface_down",
        "sudo ip link set can3 up",
    )
    passive = watched(good_s=9.5, controller=ControllerState.PASSIVE, error_text="as it says")
    assert [s.text for s in symptoms(passive)] == ["as it says"]
    counted = replace(passive, tx_errors=0, rx_errors=130)
    assert [s.text for s in symptoms(counted)] == ["0 transmit and 130 receive errors counted"]


def message_watch(period_s: float | None, seen_s: float = 10.0, **facts: Any) -> MessageWatch:
    fresh = MessageWatch(seen_s, period_s, 0.0, 0, {0: seen_s})
    return replace(fresh, **facts)


def traffic(
    known: dict[str, MessageWatch], now_s: float, expected: tuple[str, ...] = (),
    well: tuple[bool, ...] = (True, True), **facts: Any,
) -> list[Symptom]:  # fmt: skip
    watch = replace(MessagesWatch(0.0, now_s, known), **facts)
    return message_symptoms(watch, CODEC, expected, ("can0", "can1"), well, now_s)


@pytest.mark.parametrize(
    ("period_s", "away_s", "stale"),
    [(0.2, 0.99, 0), (0.2, 1.01, 1), (0.01, 0.49, 0), (0.01, 0.51, 1), (None, 50.0, 0)],
)
def test_a_message_is_late_after_five_periods_or_half_a_second(
    period_s: float | None, away_s: float, stale: int
) -> None:
    known = {MESSAGE.name: message_watch(period_s)}
    found = traffic(known, 10.0 + away_s, (MESSAGE.name,))
    assert [s.code for s in found] == ["stale"] * stale
    if stale and period_s == 0.2:
        assert found[0].text == "no frame for 1.0 s; one is due every 200 ms"
    assert traffic(known, 10.0 + away_s, (MESSAGE.name,), (False, True)) == []
    assert traffic(known, 10.0 + away_s, (MESSAGE.name,), ()) == []


@pytest.mark.parametrize(("away_s", "stale"), [(60.0, 1), (60.1, 0)])
def test_a_message_that_no_channel_needs_has_ended_after_a_minute(
    away_s: float, stale: int
) -> None:
    known = {MESSAGE.name: message_watch(0.01)}
    assert len(traffic(known, 10.0 + away_s)) == stale
    assert len(traffic(known, 10.0 + away_s, (MESSAGE.name,))) == 1


@pytest.mark.parametrize(("ago_s", "mixed"), [(2.0, 1), (2.1, 0)])
def test_a_message_on_two_buses_within_two_seconds_is_mixed(ago_s: float, mixed: int) -> None:
    each = message_watch(0.01, 10.0, buses={1: 10.0, 0: 10.0 - ago_s})
    found = traffic({MESSAGE.name: each}, 10.0)
    assert [(s.code, s.text) for s in found] == [
        ("mixed_id", "comes from can0 and can1 at the same time")
    ] * mixed
    five = message_watch(0.01, 10.0, buses={5: 10.0, 2: 10.0})
    (found_five,) = traffic({MESSAGE.name: five}, 10.0)
    assert found_five.text == "comes from 2 and 5 at the same time"


def test_a_sensor_that_never_came_is_late_after_a_second() -> None:
    for waited_s, stale in ((0.99, 0), (1.01, 1)):
        found = traffic({}, waited_s, (MESSAGE.name,))
        assert [s.code for s in found] == ["stale"] * stale
        assert traffic({}, waited_s, (MESSAGE.name,), (False, False)) == []
    (late,) = traffic({}, 12.4, (MESSAGE.name,), (False, True))
    assert late.text == "no frame since the recorder listens (12 s)"
    assert message_symptoms(MessagesWatch(), CODEC, (MESSAGE.name,), (), (True,), 9.0) == []


@pytest.mark.parametrize(
    ("age_s", "waited_s", "code"),
    [
        (2.0, 10.0, "none_of_dbc"),
        (2.1, 10.0, ""),
        (0.0, 0.7, "unknown_id"),
        (0.0, 0.8, "none_of_dbc"),
    ],
)
def test_a_bus_of_strangers_is_another_bus(age_s: float, waited_s: float, code: str) -> None:
    strangers = {(0, 0x700, False): Stranger(9, 10.0, waited_s - age_s)}
    found = traffic({}, waited_s, strangers=strangers)
    assert [s.code for s in found][:1] == ([code] if code else [])
    if code == "none_of_dbc":
        assert found[0].text == f"no frame of a message of the DBC in {waited_s:.1f} s, but 0x700"
        with_known = traffic({MESSAGE.name: message_watch(1e3, waited_s)}, waited_s,
                             strangers=strangers)  # fmt: skip
        assert [s.code for s in with_known] == ["unknown_id"]


def test_six_strangers_are_named_the_most_frequent_first() -> None:
    strangers = {(1, 0x700 + n, n == 2): Stranger(10 * n, 2.0 * n + 0.4, 10.0) for n in range(8)}
    (found,) = traffic({MESSAGE.name: message_watch(1e3)}, 10.0, strangers=strangers)
    assert (found.code, found.subject) == ("unknown_id", "can1")
    assert found.text == (
        "8 identifiers are not in the DBC: 0x707 (14 Hz), 0x706 (12 Hz), 0x705 (10 Hz), "
        "0x704 (8 Hz), 0x703 (6 Hz), 0x702x (4 Hz) and 2 more"
    )
    six = {key: strangers[key] for key in list(strangers)[:6]}
    (found,) = traffic({MESSAGE.name: message_watch(1e3)}, 10.0, strangers=six)
    assert "more" not in found.text
    twin = {(0, MESSAGE.can_id, True): Stranger(1, 1.0, 10.0)}
    found, _ = traffic({MESSAGE.name: message_watch(1e3)}, 10.0, strangers=twin)
    assert found.text.endswith("comes with 29 bits; the DBC has it with 11")


def advanced(watch: MessagesWatch, batch: FrameBatch, now_s: float) -> MessagesWatch:
    return advance_messages(watch, CODEC, batch, None, HealthState(), now_s)[0]


def test_strangers_are_counted_with_their_rate_and_forgotten_after_a_minute() -> None:
    watch = advanced(MessagesWatch(), frames(0x700, [bytes(8)] * 5, T_NS), 100.0)
    key = (0, 0x700, False)
    assert watch.strangers[key] == Stranger(5, 5.0, 100.0)  # the first turn counts as a second
    both = FrameBatch.concatenate(
        [frames(0x700, [bytes(8)] * 4, T_NS), frames(0x700, [bytes(3)] * 2, T_NS)]
    )
    watch = advanced(watch, both, 100.5)
    assert watch.strangers[key] == Stranger(11, 12.0, 100.5)
    assert key in advanced(watch, NOTHING, 160.5).strangers
    assert key not in advanced(watch, NOTHING, 160.6).strangers
    many = FrameBatch.concatenate([frames(0x10000 + n, [b""], T_NS, FrameFlag.EXTENDED)
                                   for n in range(300)])  # fmt: skip
    assert len(advanced(MessagesWatch(), many, 1.0).strangers) == 256


def test_a_frame_of_another_length_is_counted() -> None:
    batch = FrameBatch.concatenate(
        [
            frames(MESSAGE.can_id, [bytes(MESSAGE.length - 1)] * 3, T_NS),
            frames(MESSAGE.can_id, [bytes(MESSAGE.length - 2)] * 2, T_NS),
            frames(MESSAGE.can_id, [bytes(8)] * 4, T_NS, FrameFlag.REMOTE),
        ]
    )
    after, counts = advance_messages(MessagesWatch(), CODEC, batch, None, HealthState(), 3.0)
    assert counts["wrong_length", MESSAGE.name].number == 5
    assert counts["wrong_length", MESSAGE.name].detail.endswith(
        f"bytes; the DBC says {MESSAGE.length}"
    )
    assert (after.began_s, after.turn_s) == (3.0, 3.0)
    assert advanced(MessagesWatch(), NOTHING, 3.0).began_s is None


def learn(times_s: list[float], each: int) -> MessageWatch:
    """Return a message without a cycle in the DBC after turns with some frames each."""
    (codec_message,) = (m for m in CODEC.messages if m is MESSAGE)
    watch = MessagesWatch(known={MESSAGE.name: message_watch(None, times_s[0], learn_s=times_s[0])})
    for at_s in times_s[1:]:
        batch = frames(codec_message.can_id, [bytes(MESSAGE.length)] * each, T_NS)
        watch = advanced(watch, batch, at_s)
    return watch.known[MESSAGE.name]


@pytest.mark.parametrize(
    ("turns", "each", "period_s"),
    [
        (20, 1, 0.1),  # 20 frames in 2 s
        (19, 1, None),
        (19, 2, None),  # 38 frames in 1.9 s
        (20, 2, 0.05),
    ],
)
def test_a_period_is_learned_from_twenty_frames_in_two_seconds(
    turns: int, each: int, period_s: float | None
) -> None:
    found = learn([10.0 + n / 10 for n in range(turns + 1)], each)
    assert found.period_s == (None if period_s is None else pytest.approx(period_s))


@pytest.mark.parametrize(("gap_s", "learned"), [(0.36, True), (0.37, False)])
def test_what_pauses_for_three_mean_periods_is_not_regular(gap_s: float, learned: bool) -> None:
    """Twelve frames in 1.1 s and the gap: three mean periods are 0.3667 s then."""
    times = [10.0 + n / 10 for n in range(12)]
    times += [times[-1] + gap_s + n / 10 for n in range(9)]
    assert (learn(times, 1).learn_s == 10.0) is learned


def test_alive_are_the_expected_messages_that_are_not_late() -> None:
    known = {"A": message_watch(0.2), "B": message_watch(None), "C": message_watch(0.01)}
    watch = MessagesWatch(0.0, 0.0, known)
    assert alive(watch, ("A", "B", "C", "D"), 10.4) == 3
    assert alive(watch, ("A", "B", "C", "D"), 10.6) == 2
    assert alive(watch, ("A", "B", "C", "D"), 11.1) == 1
    assert alive(watch, ("A", "B", "C", "D"), 12.1) == 0


def samples(values: list[float], start: int = 0, quality: int = 0) -> Samples:
    array: NDArray[np.float64] = np.array(values)
    t_ns = T_NS + (start + np.arange(len(values))) * 10**8
    return Samples("a.b", t_ns, array, np.full(len(values), quality, np.uint8))


def test_equal_samples_in_a_row_are_counted() -> None:
    one = _stand(None, samples([2.0, 2.0, 2.0]), 2.0, 2.0, True)
    assert one == Standing(2.0, T_NS, 3, T_NS + 2 * 10**8, 1)
    two = _stand(one, samples([2.0, 2.0], 3), 2.0, 2.0, False)
    assert two == Standing(2.0, T_NS, 5, T_NS + 4 * 10**8, 1)
    three = _stand(two, samples([2.0], 5), 2.0, 2.0, True)
    assert (three.samples, three.moving) == (6, 2)
    assert _stand(two, samples([4.0], 5), 4.0, 4.0, False).samples == 1
    moved = _stand(two, samples([2.0, 5.0], 5), 2.0, 5.0, True)
    assert moved == Standing(5.0, T_NS + 6 * 10**8, 1, T_NS + 6 * 10**8, 0)


@pytest.mark.parametrize(
    ("still_s", "moving", "fine", "n", "stuck"),
    [
        (0.79, 0, True, 500, ""),
        (0.8, 0, True, 500, "not even noise for 0.8 s"),
        (0.8, 0, False, 500, ""),
        (0.1, 2, False, 500, ""),
        (0.1, 3, False, 500, "while others move"),
        (0.8, 3, True, 2, ""),
    ],
)
def test_a_frozen_sensor(still_s: float, moving: int, fine: bool, n: int, stuck: str) -> None:
    standing = Standing(1.5, T_NS, n, T_NS + round(still_s * 1e9), moving)
    limits = Limits(-1.0, 1.0, 0.01, fine, "-1 to 1")
    found = signal_symptoms(SignalsWatch((), {"a": limits}, {"a": standing}))
    assert [s.code for s in found] == ["stuck"] * bool(stuck)
    if stuck:
        assert found[0].text.startswith("500 samples in a row are 1.5")
        assert found[0].text.endswith(stuck)


def with_signal(mapped: MappedChannel, **facts: Any) -> MappedChannel:
    changed = replace(mapped.signal, **facts)
    signals = tuple(changed if s is mapped.signal else s for s in mapped.message.signals)
    return replace(mapped, message=replace(mapped.message, signals=signals))


def test_the_range_is_that_of_the_bits_or_a_narrower_one_of_the_dbc() -> None:
    mapped = USED
    low, high = mapped.signal.span
    wide = with_signal(mapped, minimum=low - 1, maximum=high + 1)
    assert (limits_of(wide).low, limits_of(wide).high) == (low, high)
    narrow = with_signal(mapped, minimum=-1.0, maximum=2.0)
    assert (limits_of(narrow).low, limits_of(narrow).high) == (-1.0, 2.0)
    assert limits_of(narrow).range_text == f"-1 to 2 {mapped.signal.unit}"
    none = with_signal(mapped, minimum=0.0, maximum=0.0)
    assert (limits_of(none).low, limits_of(none).high) == (low, high)
    bit = with_signal(mapped, length=1)
    assert (limits_of(bit).low, limits_of(bit).high) == (-np.inf, np.inf)


def channel_turn(values: list[float], quality: int = 0) -> tuple[SignalsWatch, dict[str, int]]:
    """Return one turn of a channel from -4 to 4, and what was counted in it."""
    mapped = with_signal(USED, minimum=-4.0, maximum=4.0)
    decoded = CODEC.decode(NOTHING)
    signal = mapped.channel.signal
    decoded = replace(decoded, samples={signal: samples(values, 0, quality)})
    watch, counts = advance_signals(SignalsWatch(), (mapped,), decoded)
    return watch, {code: count.number for (code, _), count in counts.items()}


@pytest.mark.parametrize(
    ("values", "saturated"),
    [
        ([3.99, -3.99], 0),
        ([4.0, 3.0, 4.1], 2),
        ([-4.0, 0.0, 3.0], 1),
        ([-4.0, 4.0], 2),
        ([np.nan, 4.0], 1),
    ],
)
def test_samples_at_the_end_of_the_range_are_counted(values: list[float], saturated: int) -> None:
    watch, counts = channel_turn(values)
    assert counts.get("saturated", 0) == saturated
    assert counts.get("not_a_number", 0) == int(np.isnan(values).sum())
    assert watch.overloaded == (USED.channel.name,) * bool(saturated)


def test_samples_that_cannot_be_used_are_counted_by_their_kind() -> None:
    assert channel_turn([1.0, 2.0], int(Quality.SENTINEL))[1] == {"no_value": 2}
    assert channel_turn([1.0, 9.0], int(Quality.OUT_OF_RANGE))[1] == {
        "out_of_range": 2,
        "saturated": 1,
    }
    assert channel_turn([1.0, 9.0], int(Quality.CRC_BAD))[1] == {}
    assert channel_turn([1.0, 9.0], int(Quality.CRC_BAD))[0].standing == {}
