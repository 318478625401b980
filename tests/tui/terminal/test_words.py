"""The words, figures and boxes of the bench, each on both sides of where it changes."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.alarms.texts import EXPLAINED
from daq.control.messages import Alarm, Arm, Phase, Status
from daq.runs import Excitation
from tui.display.view import headline
from tui.terminal.campaign import (
    BenchStep,
    NextAction,
    bump_step,
    in_first_runs,
    in_run,
    next_action,
    progress,
    shown_obstacle,
)
from tui.terminal.screens.bumping import tally_rows
from tui.terminal.screens.check import zero_offsets
from tui.terminal.words import Signal, accepted_words, banner, last_judged, signal_of

from .fake_recorder import DOUBLE_BUMP, GOOD, WALL_NS, FakeRecorder, ready
from .operated import PLAIN, check_items

S = 1_000_000_000


@pytest.fixture
def recorder() -> FakeRecorder:
    return ready()


def said(status: Status) -> list[str]:
    shown = banner(status, None, next_action(status), PLAIN)
    return [shown.word, shown.title, shown.event, shown.addition, shown.digits]


def test_a_verdict_compares_a_run_with_the_first_of_its_kind(recorder: FakeRecorder) -> None:
    assert accepted_words(recorder.status, None) == "good: every check passed"
    motion = replace(GOOD, code="motion", text="f 1.15 Hz, zeta 0.33", unit="Hz", value=1.15)
    said = []
    for findings in ((motion,), (replace(motion, value=1.16),), (GOOD,)):
        recorder.bump()
        recorder.judge(*findings)
        said.append(accepted_words(recorder.status, last_judged(recorder.status)))
    assert said == [
        "good: the car swings at 1.15 Hz",
        "good: like the first within 1 %",
        "good: every check passed",
    ]


def test_the_banner_of_each_state(recorder: FakeRecorder) -> None:
    assert said(recorder.status) == [
        "IDLE", "SPACE starts   next: baseline bounce 1 of 2",
        "Roll all four wheels over the boards.", "", "",
    ]  # fmt: skip
    recorder.turn(Phase.ARMED)
    assert said(recorder.status) == [
        "ARMED", "bounce 1 of 2   at rest +  pre-trigger +",
        "Roll all four wheels over the boards.", "", "-.-",
    ]  # fmt: skip
    recorder.bump()
    recorder.t_ns += S * 3 // 2
    assert said(recorder.status)[4] == "1.5"
    assert said(replace(recorder.status, bump_ns=0))[4] == ""
    assert said(replace(recorder.status, bump_ns=recorder.t_ns + S))[4] == "0.0"
    for left, bar in ((0.25, "###############....."), (1.7, "." * 20), (-0.1, "#" * 20)):
        recorder.phase = Phase.DECAY
        recorder.publish(peak_left=left)
        percent = {0.25: "25%", 1.7: "100%", -0.1: " 0%"}[left]
        assert said(recorder.status)[2] == f"Hands off.  {percent} of the peak left  [{bar}]"
    recorder.publish(peak_left=None)
    assert said(recorder.status)[2] == "Hands off.  "
    recorder.judge()
    assert said(recorder.status) == [
        "ACCEPTED", "SPACE = now   bounce 1   1 of 2 accepted", "good: every check passed",
        "The next run arms itself in 3 s.   Bksp = reject", "3",
    ]  # fmt: skip
    recorder.publish(countdown_s=None)
    assert said(recorder.status)[3:] == ["Pauses after this run.   Bksp = reject", ""]
    last = replace(recorder.status, due=None)
    assert said(last)[3:] == ["The last of its kind.   Bksp = reject", ""]
    recorder.publish(countdown_s=2.4)
    assert said(replace(recorder.status, sensors_alive=0))[3:] == ["Bksp = reject", ""]
    recorder.bump()
    recorder.judge(replace(DOUBLE_BUMP, advice=""))
    assert said(recorder.status)[1:] == [
        "SPACE = again, or in 3 s   bounce 2   kept, not counted",
        "DOUBLE BUMP: second bump at +0.84 s", "U = undo.", "3",
    ]  # fmt: skip
    looks_on = banner(recorder.status, None, next_action(recorder.status, False), PLAIN)
    assert looks_on.title.startswith("C = take control, or in 3 s")
    without_runs = replace(recorder.status, runs=())
    assert said(without_runs) == ["REJECTED", "SPACE = again", "", "", ""]
    recorder.publish(phase=Phase.IDLE, halted="double_bump")
    assert said(recorder.status)[:2] == ["STOPPED", "SPACE starts   bounce 2 of 2"]
    assert said(recorder.status)[3] == "F1 = what to do"
    recorder.publish(halted="")
    recorder.changes.clear()
    recorder.finish("baseline")
    assert said(recorder.status)[:2] == ["DONE", "SPACE = step 4 Masses"]


def test_steps_are_reached_and_ended_by_what_the_book_says(recorder: FakeRecorder) -> None:
    assert BenchStep.CHECK.title == "2 Check"
    assert BenchStep.CHECK.mark == "step check done"
    assert bump_step(recorder.status) is BenchStep.BASELINE
    assert not in_run(recorder.status)
    assert not in_first_runs(recorder.status)
    recorder.turn(Phase.WAITING)
    assert in_run(recorder.status)
    assert in_first_runs(recorder.status)
    recorder.finish("baseline")
    assert bump_step(recorder.status) is BenchStep.BASELINE
    recorder.mark("masses")
    assert bump_step(recorder.status) is BenchStep.ADDED
    recorder.turn(Phase.WAITING)
    assert not in_first_runs(recorder.status)
    recorder.finish("added")
    recorder.turn(Phase.COMPLETE)
    assert not in_run(recorder.status)
    recorder.mark("identify")
    assert progress(recorder.status).due is BenchStep.REPORT
    later = replace(recorder.status, revision=recorder.status.revision + 1)
    assert progress(later).due is BenchStep.IDENTIFY
    recorder.mark("report")
    assert progress(recorder.status).due is BenchStep.REPORT
    whole = progress(recorder.status)
    assert whole.done == frozenset(BenchStep)
    recorder.choose("baseline", Excitation.ROLL)
    assert bump_step(recorder.status) is BenchStep.BASELINE


@pytest.mark.parametrize(
    ("code", "seen"),
    [
        ("queue_dropped", True), ("overrun", True), ("bus_off", False), ("interface_down", False),
        ("check_bitrate", False), ("none_of_dbc", False),
    ],
)  # fmt: skip
def test_an_alarm_of_lost_frames_stops_after_three_seconds(
    code: str, seen: bool, recorder: FakeRecorder
) -> None:
    alarm = Alarm(code, "can0", "text", "do it", WALL_NS - 3 * S)
    recorder.publish(alarms=(alarm,))
    assert (shown_obstacle(recorder.status) is not None) is seen
    recorder.publish(alarms=(replace(alarm, since_ns=WALL_NS - 3 * S + 1),))
    assert shown_obstacle(recorder.status) is None
    recorder.publish(sensors_alive=3)
    assert (shown_obstacle(recorder.status) is not None) is (code in (
        "bus_off", "interface_down", "check_bitrate", "none_of_dbc"
    ))  # fmt: skip
    assert shown_obstacle(replace(recorder.status, due=None)) is None


def test_only_an_offset_that_a_tare_can_improve_is_one() -> None:
    channels = FakeRecorder().bench.channels
    largest = check_items(travel_fl=0.0005, travel_fr=-0.0005, pitch_rate=0.001, roll_rate=-0.001)
    assert zero_offsets(largest, channels) == []
    over = {"travel_rl": 0.0006, "travel_rr": -0.0035, "pitch_rate": 0.0011, "roll_rate": -0.004}
    offsets = zero_offsets(check_items(**over), channels)
    assert offsets is not None
    assert {channel.name: level for channel, level in offsets} == over
    assert zero_offsets(check_items()[:-1], channels) is None, "roll_rate has no reading"


def _alarm(code: str) -> Alarm:
    return Alarm(code, "can0", "text", "advice", 0)


@pytest.mark.parametrize(
    ("phase", "after", "alarms", "signal"),
    [
        (Phase.WAITING, Phase.ARMED, (), Signal.ARMED),
        (Phase.DECAY, Phase.ACCEPTED, (), Signal.ACCEPTED),
        (Phase.DECAY, Phase.REJECTED, (), Signal.REJECTED),
        (Phase.ARMED, Phase.TRIGGERED, (), None),
        (Phase.ARMED, Phase.ARMED, (), None),
        (Phase.ARMED, Phase.ARMED, ("stale",), Signal.ALARM),
        (Phase.WAITING, Phase.ARMED, ("stale",), Signal.ALARM),
        (Phase.DECAY, Phase.REJECTED, ("bus_silent",), Signal.REJECTED),
        (Phase.ARMED, Phase.ARMED, ("restamped",), None),
    ],
)
def test_what_is_signalled(
    phase: Phase, after: Phase, alarms: tuple[str, ...], signal: Signal | None
) -> None:
    before = replace(FakeRecorder().status, phase=phase, alarms=(_alarm("counter_gap"),))
    raised = (*before.alarms, *map(_alarm, alarms))
    assert signal_of(before, replace(before, phase=after, alarms=raised)) is signal


def test_space_gives_the_order_that_fits() -> None:
    recorder = FakeRecorder()
    assert next_action(None).order is None
    assert next_action(recorder.status).step is BenchStep.VEHICLE
    recorder.mark("vehicle", "check")
    assert next_action(recorder.status).order == Arm()
    assert next_action(recorder.status, False) == NextAction("C = take control")
    for phase in (Phase.WAITING, Phase.ARMED, Phase.TRIGGERED, Phase.DECAY):
        recorder.turn(phase)
        assert next_action(recorder.status) == next_action(recorder.status, False) == NextAction()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    assert next_action(recorder.status).order == Arm()
    recorder.turn(Phase.PAUSED)
    assert next_action(recorder.status) == NextAction("SPACE = go on", Arm())
    recorder.bump()
    recorder.judge()
    assert next_action(recorder.status).order == Arm()
    # The last of its kind: the boards have to be moved before anything is armed.
    assert next_action(replace(recorder.status, countdown_s=None)) == NextAction()
    recorder.finish("baseline")
    to_masses = NextAction("SPACE = step 4 Masses", step=BenchStep.MASSES)
    assert next_action(recorder.status) == next_action(recorder.status, False) == to_masses
    recorder.mark("masses")
    assert next_action(recorder.status).order == Arm(mass_state="added")
    assert next_action(replace(recorder.status, due=None)).words == "SPACE = step 5 Added"


def test_more_runs_are_recorded_by_the_one_key_after_each_step() -> None:
    recorder = ready()
    recorder.finish("baseline")
    recorder.choose("baseline", Excitation.ROLL)
    more = next_action(recorder.status)
    assert (more.words, more.order) == ("SPACE = one more roll", Arm())
    recorder.mark("masses")
    recorder.bump()
    recorder.judge()
    recorder.finish("added")
    recorder.mark("identify", "report")
    assert next_action(recorder.status).step is BenchStep.REPORT
    recorder.choose("added", Excitation.PITCH)
    assert next_action(recorder.status).order == Arm()
    recorder.bump()
    recorder.judge()
    recorder.turn(Phase.COMPLETE)
    assert next_action(recorder.status).step is BenchStep.IDENTIFY


def test_progress_marks_what_is_due_and_counts_what_was_rejected(recorder: FakeRecorder) -> None:
    def rows() -> list[list[str]]:
        return [[str(cell).strip() for cell in row] for row in tally_rows(recorder.status, PLAIN)]

    recorder.bump()
    recorder.judge()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    assert rows()[:2] == [
        ["> baseline bounce", "#.", "1/2", "1 rejected"],
        ["baseline pitch", "..", "0/2", ""],
    ]
    recorder.bump()
    recorder.judge()
    recorder.choose("baseline", recorder.status.tallies[0].excitation)
    recorder.bump()
    recorder.judge()
    assert rows()[0][1:3] == ["##", "2/2 +1"]
    tallies = (replace(recorder.status.tallies[0], planned=0),)  # the plan has been changed
    recorder.publish(tallies=tallies)
    assert rows()[0][1:3] == ["", "0/0 +3"]


def alarmed(code: str, phase: Phase = Phase.ARMED, alive: int = 4) -> Status:
    recorder = ready()
    recorder.phase = phase
    alarm = Alarm(code, "can0", "what was seen", EXPLAINED[code].advice, WALL_NS - 10 * S)
    recorder.changes = {"alarms": (alarm,), "sensors_alive": alive}
    return recorder.status


@pytest.mark.parametrize(
    ("code", "alive", "name", "advice"),
    [
        ("disconnected", 0, "BUS DISCONNECTED", "Check plug and power of the adapter."),
        ("bus_silent", 0, "BUS SILENT", "Check cable, power of the sensors and bit rate."),
        ("stale", 3, "SENSOR SILENT", "Check plug and power of this sensor."),
        ("bus_full", 4, "BUS OVERLOADED", "Take other devices off this bus"),
        ("counter_gap", 4, "FRAMES MISSING", "Check the load of the bus"),
        ("journal_failed", 4, "THE DISK REFUSES", "Make room on the disk"),
        ("not_recording", 4, "NOT RECORDING", "See the other alarms"),
    ],
)
@pytest.mark.parametrize("phase", [Phase.IDLE, Phase.WAITING, Phase.ARMED, Phase.PAUSED])
def test_the_first_line_is_the_cause_and_the_next_its_advice(
    code: str, alive: int, name: str, advice: str, phase: Phase
) -> None:
    status = alarmed(code, phase, alive)
    shown = banner(status, None, next_action(status), PLAIN)
    assert (shown.word, shown.title) == ("STOP", f"{name}  can0")
    assert shown.event.startswith(advice)
    assert shown.addition == "what was seen"
    page = headline(status)
    assert (page.word, page.why) == (("STOP",), f"{name}  can0")
    assert page.advice.startswith(advice)


def test_a_run_and_its_verdict_are_shown_before() -> None:
    for phase in (Phase.TRIGGERED, Phase.DECAY):
        assert shown_obstacle(alarmed("stale", phase, alive=3)) is None
    for phase in (Phase.ACCEPTED, Phase.REJECTED):
        assert shown_obstacle(alarmed("stale", phase, alive=3)) is None
    assert shown_obstacle(alarmed("disconnected", Phase.ACCEPTED, alive=0)) is not None


def test_without_frames_no_countdown_is_shown() -> None:
    recorder = FakeRecorder()
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    status = recorder.status
    assert "in 3 s" in banner(status, None, next_action(status), PLAIN).title
    recorder.changes = {"sensors_alive": 0}
    still = banner(recorder.status, None, next_action(recorder.status), PLAIN)
    assert (still.digits, "in 3 s" in still.title) == ("", False)
    assert headline(recorder.status).digits == ""
