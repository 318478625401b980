"""One cause, one alarm: what a person reads while the journal holds every symptom."""

from __future__ import annotations

from dataclasses import replace
from time import localtime, strftime

import pytest

from daq.alarms import ALARM
from daq.alarms.causes import Wiring, causes, dead_bus
from daq.control.messages import Alarm, DiskStatus, QueueStatus

from ..watched_bench import CODEC, START_NS, WatchedBench, both, foreign

ALL = len(CODEC.messages)
WIRING = Wiring(
    {"IMU": "can0", "HUB": "can0", "SUSP": "can1"},
    {"acc": "IMU", "rate": "IMU", "hub": "HUB", "travel": "SUSP"},
    {"can0": START_NS, "can1": START_NS},
)


def an_alarm(code: str, subject: str = "", count: int = 0, since_ns: int = 5) -> Alarm:
    return Alarm(code, subject, f"text of {subject}", f"advice on {subject}", since_ns, count)


def shown(*alarms: Alarm) -> list[tuple[str, str]]:
    return [(alarm.code, alarm.subject) for alarm in causes(alarms, WIRING)]


def test_an_unplugged_bus_is_one_alarm_that_says_since_when_all_is_silent() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    plugged_out = strftime("%H:%M:%S", localtime(bench.t_ns * 1e-9))
    for _ in range(15):
        bench.turn(foreign(bench))
    first, *others = bench.state.causes
    assert (first.code, first.subject) == ("bus_silent", "can0")
    assert first.text == (
        f"bus unplugged or unpowered: all {ALL} messages silent since {plugged_out}"
    )
    assert first.advice == "plug the bus in, and check the power of the sensors"
    assert [alarm.code for alarm in others] == ["unknown_id"]
    assert bench.state.dead_bus == first


def test_a_bus_is_named_before_its_messages_are() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    seen = []
    for _ in range(15):
        bench.turn(foreign(bench))
        seen += [(a.code, a.subject) for a in bench.state.causes if a.code != "unknown_id"]
    assert set(seen) == {("bus_silent", "can0")}


def test_an_alarm_that_lasts_when_the_bus_is_back_ends_no_run() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    for _ in range(15):
        bench.turn(foreign(bench))
    assert bench.state.dead_bus is not None
    bench.turn(*both(bench))
    assert bench.alarm("bus_silent", "can0") is not None
    assert bench.state.dead_bus is None


def test_an_adapter_that_has_gone_is_silent_since_its_last_frame() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    gone = strftime("%H:%M:%S", localtime(bench.t_ns * 1e-9))
    bench.link(0, connected=False, error="has gone", advice="plug it in")
    for _ in range(40):
        bench.turn(foreign(bench))
    assert bench.state.causes[0].text == f"has gone; all {ALL} messages silent since {gone}"


def test_a_disk_that_is_nearly_full_is_the_cause_of_what_the_journal_lacks() -> None:
    low = an_alarm("disk_low")
    assert causes([an_alarm("journal_warning"), low], WIRING) == (low,)
    assert causes([an_alarm("journal_warning")], WIRING) == (an_alarm("journal_warning"),)


def test_gaps_after_a_bus_has_come_back_are_one_alarm() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    for _ in range(15):
        bench.healthy()  # was sent, and did not arrive
        bench.turn(foreign(bench))
    for _ in range(3):
        bench.turn(*both(bench))
    assert len([name for name in bench.logged(ALARM) if name.startswith("counter_gap")]) == ALL
    assert [alarm.code for alarm in bench.state.causes] == ["bus_silent", "unknown_id"]
    while bench.alarm("bus_silent", "can0"):
        bench.turn(*both(bench))
    gaps = [alarm for alarm in bench.state.causes if alarm.code == "counter_gap"]
    assert [alarm.subject for alarm in gaps] == ["can0"]
    assert gaps[0].text == f"frames of all {ALL} messages are missing by their counters"
    assert gaps[0].advice.endswith("of these sensors")


def test_one_sensor_off_is_one_alarm_in_the_right_number() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    for _ in range(15):
        bench.turn(bench.healthy(without=["IMU_Rate"]), foreign(bench))
    (silent,) = [alarm for alarm in bench.state.causes if alarm.code == "stale"]
    assert silent.subject == "IMU_Rate"
    assert silent.advice == "check plug and power of this sensor"
    for _ in range(15):
        bench.turn(bench.healthy(without=["IMU_Rate", "IMU_Accel"]), foreign(bench))
    (silent,) = [alarm for alarm in bench.state.causes if alarm.code == "stale"]
    assert silent.subject == "can0"
    assert silent.text == "2 messages silent: IMU_Accel, IMU_Rate"
    assert silent.advice.startswith("check plug and power of these sensors")
    assert bench.state.dead_bus is None


@pytest.mark.parametrize(("bitrate", "full"), [(420_000, False), (340_000, True)])
def test_a_full_bus_is_the_cause_of_what_is_late_on_it(bitrate: int, full: bool) -> None:
    bench = WatchedBench()
    bench.link(0, bitrate=bitrate)
    for _ in range(25):
        bench.turn(bench.healthy(without=["SUSP_Rear"]), foreign(bench))
    codes = [alarm.code for alarm in bench.state.causes]
    assert (bench.state.buses[0].load >= 0.95) is full
    assert codes == (["bus_full", "stale"] if full else ["stale"]) + ["unknown_id"]


def test_a_full_disk_is_the_cause_of_the_queue_and_of_what_it_drops() -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    refused = DiskStatus(0, 0, 0, 3.0, 812, "No space left")
    for k in range(15):
        bench.hops = replace(bench.hops, queue_dropped=7 * (k + 1))
        bench.turn(*both(bench), disk=refused, queue=QueueStatus(400, 400, 600))
    first, *others = bench.state.causes
    assert first.code == "journal_failed"
    assert first.text == "No space left; 812 frames are held in memory"
    assert first.advice.startswith("make room on the disk")
    assert [alarm.code for alarm in others] == ["unknown_id"]


@pytest.mark.parametrize("code", ["disconnected", "bus_off", "interface_down", "check_bitrate"])
def test_a_dead_bus_keeps_its_own_text_and_adds_what_is_silent(code: str) -> None:
    dead, gap = an_alarm(code, "can0"), an_alarm("counter_gap", "HUB")
    (alarm,) = causes(
        [dead, gap, an_alarm("stuck", "acc"), an_alarm("error_frames", "can0")], WIRING
    )
    assert alarm.text.startswith("text of can0; all 2 messages silent since ")
    assert alarm.advice == "advice on can0"
    assert dead_bus([alarm], WIRING) == alarm


def test_a_bus_of_one_message_and_one_without_any_are_named_as_they_are() -> None:
    one, none = causes([an_alarm("bus_silent", "can1"), an_alarm("bus_silent", "can7")], WIRING)
    assert one.text.startswith("bus unplugged or unpowered: SUSP silent since ")
    assert none == an_alarm("bus_silent", "can7")
    assert dead_bus([none], WIRING) is None


def test_what_is_on_another_bus_is_another_cause() -> None:
    assert shown(an_alarm("bus_silent", "can0"), an_alarm("stale", "SUSP")) == [
        ("bus_silent", "can0"),
        ("stale", "SUSP"),
    ]
    assert shown(an_alarm("overrun", "can0"), an_alarm("counter_gap", "IMU")) == [
        ("overrun", "can0")
    ]
    assert shown(an_alarm("overrun", "can0"), an_alarm("counter_gap", "SUSP")) == [
        ("overrun", "can0"),
        ("counter_gap", "SUSP"),
    ]
    assert shown(an_alarm("clock_step"), an_alarm("time_back", "can0")) == [("clock_step", "")]


def test_channels_of_one_sensor_are_one_alarm_and_their_counts_add_up() -> None:
    acc, rate = an_alarm("saturated", "acc", 3, 7), an_alarm("saturated", "rate", 4, 5)
    one, other = causes([acc, rate, an_alarm("saturated", "hub", 1)], WIRING)
    assert (one.subject, one.count, one.since_ns) == ("IMU", 7, 5)
    assert one.text == "2 channels at the end of their range: acc, rate"
    assert (other.subject, other.count) == ("hub", 1)


def test_many_names_are_counted() -> None:
    wiring = Wiring({f"M{k}": "can0" for k in range(7)}, {}, {})
    (alarm,) = causes([an_alarm("crc_bad", f"M{k}", 1) for k in range(6)], wiring)
    assert alarm.text == "bad checksums in 6 messages: M0, M1, M2, M3 and 2 more"
    assert alarm.count == 6
