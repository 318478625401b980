"""The state of the page as a function of the recorder's status, without a browser."""

from __future__ import annotations

from dataclasses import replace

import pytest

from daq.bench.campaign import Origin
from daq.control.messages import Alarm, Arm, Pause, Phase, Reject
from daq.runs import Excitation
from tui.display.view import View, order_of, view
from tui.terminal.feed import Lost

from ..terminal.fake_recorder import DOUBLE_BUMP, FakeRecorder, ready


@pytest.fixture
def recorder() -> FakeRecorder:
    return ready()


def shown(recorder: FakeRecorder) -> View:
    return view(recorder.status, None)


def test_before_the_first_status_the_page_waits() -> None:
    page = view(None, None)
    assert page.headline.word == ("WAIT",)
    assert page.headline.why == "waiting for the recorder"
    assert page.buttons.next == ""


def test_each_phase_has_its_word(recorder: FakeRecorder) -> None:
    assert shown(recorder).headline.word == ("READY",)
    recorder.phase = Phase.WAITING
    recorder.publish(not_at_rest=("body_acc_z",))
    head = shown(recorder).headline
    assert (head.kind, head.word) == ("wait", ("WAIT",))
    assert head.why == "Hands off: not at rest: body_acc_z"
    recorder.turn(Phase.ARMED)
    head = shown(recorder).headline
    assert (head.kind, head.word) == ("bump", ("BUMP", "NOW"))
    assert head.why == "Roll all four wheels over the boards."
    recorder.turn(Phase.PAUSED)
    assert shown(recorder).headline.word == ("PAUSED",)
    recorder.finish("baseline")
    assert shown(recorder).headline.word == ("STEP", "4")
    assert shown(recorder).headline.why == "Go to the terminal: step 4 Masses"
    recorder.finish("added")
    assert shown(recorder).headline.word == ("DONE",)


def test_a_decay_counts_its_seconds_and_fills_its_bar(recorder: FakeRecorder) -> None:
    recorder.bump()
    head, before = shown(recorder).headline, shown(recorder).title
    assert (head.word, head.digits, head.share) == (("HANDS", "OFF"), "0.0", None)
    assert head.why == "Hands off. Recording the bump."
    recorder.t_ns += 1_440_000_000
    recorder.phase = Phase.DECAY
    recorder.publish(peak_left=0.31)
    later, title = shown(recorder).headline, shown(recorder).title
    assert (later.digits, later.share) == ("1.4", 0.69)
    assert later.why == "Hands off. 31% of the peak left."
    assert title == before, "it sounds once"
    recorder.publish(peak_left=1.7)  # a second bump: more is left than there was
    assert shown(recorder).headline.share == 0.0


def test_an_accepted_run_counts_down(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.judge()
    page = shown(recorder)
    head = page.headline
    assert (head.kind, head.word, head.digits) == ("accepted", ("ACCEPTED",), "3")
    assert page.title == "baseline: bounce 1, 1 of 2 accepted"
    assert (page.done, page.planned) == (1, 12)
    recorder.publish(countdown_s=2.0)
    assert shown(recorder).headline.digits == "2"
    recorder.publish(sensors_alive=0)  # the countdown stands still, before there is an alarm
    assert (shown(recorder).headline.digits, shown(recorder).headline.advice) == ("", "")
    recorder.publish(countdown_s=None)
    assert shown(recorder).headline.advice == "Pauses after this run."


def test_a_rejected_run_says_why_and_what_to_do(recorder: FakeRecorder) -> None:
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    head = shown(recorder).headline
    assert (head.kind, head.word) == ("again", ("AGAIN",))
    assert head.why == "DOUBLE BUMP: second bump at +0.84 s"
    assert head.advice == "Bump once, keep hands off."
    assert shown(recorder).rows[0].rejected == 1


def test_a_lost_recorder_hides_what_was(recorder: FakeRecorder) -> None:
    recorder.turn(Phase.ARMED)
    page = view(recorder.status, Lost("the recorder has ended", "see its log"))
    assert page.headline.word == ("RECORDER", "LOST")
    assert (page.headline.why, page.headline.advice) == ("the recorder has ended", "see its log")
    assert page.buttons.pause == ""
    assert page.rows, "the progress of the campaign is still true"


def test_three_rejects_stop_the_loop(recorder: FakeRecorder) -> None:
    recorder.publish(halted="double_bump")
    head = shown(recorder).headline
    assert head.word == ("STOPPED",)
    assert head.why == "three rejects for one reason: bumped twice"


def test_the_gravest_alarm_is_shown_and_the_others_are_counted(recorder: FakeRecorder) -> None:
    assert shown(recorder).alarm is None
    first = Alarm("bus_silent", "can0", "no frame\x1b[31m for 2 s", "Check cable", 7)
    recorder.publish(alarms=(first, replace(first, code="stale")))
    alarm = shown(recorder).alarm
    assert alarm is not None
    assert alarm.text.startswith("BUS SILENT can0: no frame")
    assert "\x1b" not in alarm.text
    assert (alarm.advice, alarm.more) == ("Check cable", 1)


def test_a_simulated_recording_is_marked(recorder: FakeRecorder) -> None:
    assert shown(recorder).mark == ""
    recorder.publish(origin=Origin.SIMULATED)
    assert shown(recorder).mark == "SIMULATED"


def test_rows_follow_what_is_due(recorder: FakeRecorder) -> None:
    page = shown(recorder)
    assert [row.kind for row in page.rows] == ["bounce", "pitch", "roll"] * 2
    assert [row.due for row in page.rows] == [True, False, False, False, False, False]


def test_what_the_buttons_do(recorder: FakeRecorder) -> None:
    buttons = shown(recorder).buttons
    assert (buttons.next, buttons.pause, buttons.reject) == ("Start", "", "")
    assert isinstance(order_of("next", "", recorder.status), Arm)
    assert order_of("pause", "", recorder.status) is None
    recorder.turn(Phase.ARMED)
    assert shown(recorder).buttons.next == ""
    assert order_of("next", "", recorder.status) is None
    assert isinstance(order_of("pause", "", recorder.status), Pause)
    label = recorder.bump()
    recorder.judge()
    buttons = shown(recorder).buttons
    assert (buttons.next, buttons.reject, buttons.reject_target) == (
        "Next now",
        "Reject bounce 1",
        "baseline_bounce_1",
    )
    assert order_of("reject", label, recorder.status) == Reject(label)
    assert order_of("shutdown", label, recorder.status) is None


def test_the_weights_are_asked_for_and_the_button_answers(recorder: FakeRecorder) -> None:
    recorder.finish("baseline")
    assert shown(recorder).headline.word == ("STEP", "4")
    assert order_of("next", "added", recorder.status) is None
    recorder.mark("masses")
    page = shown(recorder)
    assert page.headline.word == ("WEIGHTS", "ON?")
    assert page.headline.why == "The next run is of the car with weights (added)."
    assert (page.buttons.next, page.buttons.next_target) == ("Weights are on: start", "added")
    assert order_of("next", "", recorder.status) is None  # touched before the question was there
    assert order_of("next", "added", recorder.status) == Arm(mass_state="added")
    recorder.bump()
    recorder.judge()
    recorder.choose("baseline", Excitation.ROLL)
    recorder.turn(Phase.IDLE)
    assert shown(recorder).headline.word == ("WEIGHTS", "OFF?")
    assert shown(recorder).buttons.next == "Weights are off: start"


def test_a_late_touch_rejects_no_other_run(recorder: FakeRecorder) -> None:
    first = recorder.bump()
    recorder.judge()
    recorder.bump()
    assert order_of("reject", first, recorder.status) is None
    assert order_of("reject", "", recorder.status) is None
