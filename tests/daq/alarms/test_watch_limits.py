"""The watch's own times: of events, of a clock that was set, of a bus that is quiet."""

from __future__ import annotations

import pytest

from daq.bus.error_frames import ErrorClass
from daq.control.messages import BusState, DiskStatus
from dbc import FrameBatch

from ..watched_bench import CODEC, START_NS, WatchedBench, both, error_frames, foreign, saturating

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


@pytest.mark.parametrize(("step_ms", "seen"), [(49, False), (51, True), (-49, False), (-51, True)])
def test_a_clock_was_set_if_it_is_fifty_milliseconds_off(step_ms: int, seen: bool) -> None:
    bench = WatchedBench()
    for _ in range(3):
        bench.turn(*both(bench))
    bench.wall_step_ns = step_ms * 1_000_000
    events = bench.turn(*both(bench))
    steps = [event for event in events if event.code == "clock_step"]
    assert [event.value for event in steps] == [pytest.approx(step_ms / 1000)] * seen
    alarm = bench.alarm("clock_step", "")
    assert (alarm is not None) is seen
    if alarm:
        assert f"{step_ms / 1000:+.3f} s" in alarm.text
    events = bench.turn(*both(bench))  # the new time is the measure from now on
    assert events == ()


@pytest.mark.parametrize(("turns", "lasts"), [(44, True), (46, False)])
def test_a_clock_that_was_set_is_shown_for_three_seconds(turns: int, lasts: bool) -> None:
    """And, as every alarm, for one and a half seconds after that."""
    bench = WatchedBench()
    bench.turn(*both(bench))
    bench.wall_step_ns = 10**9
    bench.turn(*both(bench))
    for _ in range(turns):
        bench.turn(*both(bench))
    assert bool(bench.alarm("clock_step", "")) is lasts


@pytest.mark.parametrize(("turns", "is_dead"), [(3, False), (5, True)])
def test_a_bus_is_dead_after_four_tenths_of_a_second(turns: int, is_dead: bool) -> None:
    bench = WatchedBench()
    for _ in range(15):
        bench.turn(*both(bench))
    bench.link(0, connected=False, error="has gone", advice="plug it in")
    for _ in range(turns):
        bench.turn(foreign(bench))
    assert bench.alarm("disconnected", "can0")
    assert (bench.state.dead_bus is not None) is is_dead
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
    assert [(a.code, a.subject) for a in bench.state.shown] == [("stale", "HUB_Front, HUB_Rear")]
    assert len(bench.alarms) == 2  # in the journal, one by one
    for _ in range(30):
        bench.turn(NOTHING)
        names = [(a.code, a.subject) for a in bench.state.shown]
    assert names == [("bus_silent", "can0")]


@pytest.mark.parametrize(("in_a_second", "is_alarm"), [(4, False), (5, True)])
def test_five_error_frames_in_a_second_are_an_alarm(in_a_second: int, is_alarm: bool) -> None:
    bench = WatchedBench()
    bad = error_frames(ErrorClass.PROTOCOL, b"", bench.t_ns + 90_000_000, n=in_a_second)
    bench.turn(*both(bench), bad)
    assert (bench.alarm("error_frames", "can1") is not None) is is_alarm


def test_sensors_are_counted_as_they_come() -> None:
    bench = WatchedBench()
    assert (bench.state.sensors_alive, bench.state.sensors_expected) == (0, 0)
    for _ in range(12):
        bench.turn(*both(bench))
    assert (bench.state.sensors_alive, bench.state.sensors_expected) == (len(CODEC.messages),) * 2
    for _ in range(12):
        bench.turn(bench.healthy(without=["IMU_Rate"]), foreign(bench))
    assert bench.state.sensors_alive == len(CODEC.messages) - 1
    assert [bus.state for bus in bench.state.buses] == [BusState.OK, BusState.OK]


def test_an_overload_lamp_is_on_until_it_is_acknowledged_also_on_another_bench() -> None:
    bench = WatchedBench(["can0"])
    bench.turn(saturating(bench))
    bench.turn()
    bench.state.adopt()
    bench.turn()
    assert bench.state.overloaded == ("hub_acc_fl",)
    bench.state.acknowledge()
    assert not bench.state.overloaded


def test_frames_missing_before_another_bench_are_not_missing_again() -> None:
    bench = WatchedBench(["can0"])
    bench.turn()
    bench.turn(bench.healthy().select(slice(1, None)))
    bench.turn()
    assert bench.alarm("counter_gap", "HUB_Front") or bench.alarms
    counts = [alarm.count for alarm in bench.alarms]
    bench.state.adopt()
    for _ in range(3):
        bench.turn()
    assert [alarm.count for alarm in bench.alarms] == counts
