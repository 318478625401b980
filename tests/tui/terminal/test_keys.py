"""Keys of the run loop, by pilot: what is asked of the recorder, and what is not."""

from __future__ import annotations

from collections.abc import Callable

from textual.pilot import Pilot

from daq.control.messages import (
    Accept,
    Acknowledge,
    Arm,
    Order,
    Pause,
    Phase,
    Redo,
    Reject,
    Undo,
)
from tui.terminal.app import BenchApp
from tui.terminal.campaign import BenchStep
from tui.terminal.feed import Role
from tui.terminal.screens.bumping import HomeScreen, RunScreen

from ...house.walks import walked
from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, FakeRecorder

MakeApp = Callable[..., BenchApp]


def _bench() -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    return recorder


def _given(recorder: FakeRecorder, kind: type) -> list[Order]:
    return [order for order in recorder.orders if isinstance(order, kind)]


async def _press(pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await pilot.pause()


async def test_a_campaign_step_by_space_alone(make_app: MakeApp) -> None:
    recorder = _bench()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert isinstance(app.screen, HomeScreen)
        for _ in range(3):  # bounce, pitch, roll
            await _press(pilot, "space")
            assert isinstance(app.screen, RunScreen)
            for _ in range(2):
                recorder.bump()
                recorder.judge()
                await pilot.pause()
            recorder.turn(Phase.IDLE)
            await pilot.pause()
        assert len(_given(recorder, Arm)) == 3
        await _press(pilot, "space")
        assert app.step is BenchStep.MASSES


async def test_a_bump_passes_few_files(make_app: MakeApp) -> None:
    """From SPACE to the verdict on the screen: in the terminal, without socket and recorder."""
    recorder = _bench()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        with walked() as files:
            await _press(pilot, "space")
            recorder.bump()
            recorder.judge()
            await pilot.pause()
        assert isinstance(app.screen, RunScreen)
    assert {"tui/terminal/app.py", "tui/terminal/screens/bumping.py"} <= files
    assert len(files) <= 20, sorted(files)


async def test_a_held_key_counts_once(make_app: MakeApp) -> None:
    recorder = _bench()
    recorder.bump()
    recorder.judge()
    recorder.phase = Phase.PAUSED
    now_s = 0.0
    app = make_app(recorder, clock=lambda: now_s)
    async with app.run_test() as pilot:
        await pilot.pause()
        for _ in range(12):  # the keyboard repeats thirty times a second
            await pilot.press("backspace")
            now_s += 0.03
        assert len(_given(recorder, Reject)) == 1
        now_s += 0.31
        await pilot.press("backspace")
        await pilot.pause()
        assert len(_given(recorder, Reject)) == 2
        await pilot.press("pageup")  # the presenter's key is the same one
        await pilot.pause()
        assert len(_given(recorder, Reject)) == 2


async def test_reject_undo_redo_pause_and_on(make_app: MakeApp) -> None:
    recorder = _bench()
    app = make_app(recorder)
    async with app.run_test() as pilot:
        await pilot.pause()
        await _press(pilot, "pagedown")
        label = recorder.bump()
        recorder.judge()
        await pilot.pause()
        await _press(pilot, "backspace", "u", "r", "escape")
        kinds = [type(order) for order in recorder.orders if not hasattr(order, "seconds")]
        assert kinds[-4:] == [Reject, Undo, Redo, Pause]
        run = recorder.run_log.run(label)
        assert run is not None
        assert run.status.value == "rejected"
        assert recorder.phase is Phase.PAUSED
        await _press(pilot, "space")
        assert recorder.orders[-1] == Arm()
        recorder.turn(Phase.PAUSED)
        await pilot.pause()
        await _press(pilot, "escape")
        assert isinstance(app.screen, HomeScreen)


async def test_space_does_nothing_while_the_car_moves(make_app: MakeApp) -> None:
    recorder = _bench()
    app = make_app(recorder)
    async with app.run_test() as pilot:
        await pilot.pause()
        recorder.phase = Phase.ARMED
        recorder.bump()
        await pilot.pause()
        before = list(recorder.orders)
        await _press(pilot, "space")
        recorder.turn(Phase.DECAY)
        await pilot.pause()
        await _press(pilot, "space")
        assert recorder.orders == before


async def test_a_rejected_run_is_taken_back_with_a_reason(make_app: MakeApp) -> None:
    recorder = _bench()
    label = recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    recorder.phase = Phase.IDLE
    app = make_app(recorder)
    async with app.run_test() as pilot:
        await pilot.pause()
        await _press(pilot, "t")
        assert "second bump at +0.84 s" in screen_text(app)
        await _press(pilot, "enter")  # without a reason nothing happens
        assert not _given(recorder, Accept)
        await _press(pilot, *"a door", "enter")
        assert _given(recorder, Accept) == [Accept(label, "a door")]


async def test_overload_lamps_stay_until_put_out(make_app: MakeApp) -> None:
    recorder = _bench()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        recorder.publish(overloaded=("hub_acc_fl",))
        await pilot.pause()
        assert "OVERLOAD hub_acc_fl" in screen_text(app).splitlines()[0]
        recorder.publish()
        await pilot.pause()
        assert "OVERLOAD" in screen_text(app)
        await _press(pilot, "a")
        assert _given(recorder, Acknowledge)
        assert "OVERLOAD" not in screen_text(app)


async def test_a_viewer_gives_no_orders_until_it_has_taken_over(make_app: MakeApp) -> None:
    recorder = FakeRecorder(in_control=False)
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert "VIEWER" in screen_text(app).splitlines()[0]
        await _press(pilot, "space")
        assert not _given(recorder, Arm)
        await _press(pilot, "c", "space")
        assert _given(recorder, Arm)
        recorder.post(Role(False, "somebody else has taken over"))
        recorder.publish()
        await pilot.pause()
        assert "VIEWER" in screen_text(app).splitlines()[0]
        assert "somebody else has taken over" in screen_text(app), "and why the keys are dead"


async def test_a_new_terminal_is_where_the_old_one_was(make_app: MakeApp) -> None:
    recorder = _bench()
    recorder.finish("baseline")
    recorder.mark("masses")
    recorder.bump()
    recorder.phase = Phase.DECAY
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert isinstance(app.screen, RunScreen)
        assert app.step is BenchStep.ADDED
        assert "DECAY" in screen_text(app)


async def test_a_step_that_is_not_reached_is_refused(make_app: MakeApp) -> None:
    app = make_app(_bench())
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        await _press(pilot, "6")
        assert isinstance(app.screen, HomeScreen)
        assert screen_text(app).count("not reached yet") == 1, "a toast would cover what is next"


async def test_auto_presses_what_is_next_and_leaves_the_rest(make_app: MakeApp) -> None:
    recorder = _bench()
    app = make_app(recorder, auto=True)
    async with app.run_test() as pilot:
        await pilot.pause()
        await app._press_next()
        await pilot.pause()
        assert _given(recorder, Arm)
        recorder.bump()
        recorder.judge(DOUBLE_BUMP)
        await pilot.pause()
        before = list(recorder.orders)
        await app._press_next()  # the countdown runs out by itself
        recorder.publish(halted="double_bump")
        recorder.turn(Phase.IDLE)
        await pilot.pause()
        await app._press_next()  # three times the same: a person has to look
        assert recorder.orders == before
    await app._press_next()  # the timer may still run when the app has closed its screens
    assert recorder.orders == before


async def test_the_weights_are_asked_for_once_where_they_change(make_app: MakeApp) -> None:
    recorder = _bench()
    recorder.finish("baseline")
    recorder.mark("masses")
    now_s = [0.0]
    app = make_app(recorder, clock=lambda: now_s[0])
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        for key, asked, after_s in (
            ("space", True, 1.0),
            ("space", True, 0.1),  # still held down
            ("escape", False, 1.0),
            ("space", True, 1.0),
            ("space", False, 1.0),
        ):
            assert _given(recorder, Arm) == []
            now_s[0] += after_s
            await _press(pilot, key)
            assert ("Weights on?" in screen_text(app)) is asked
        assert _given(recorder, Arm) == [Arm(mass_state="added")]
        recorder.turn(Phase.PAUSED)
        await pilot.pause()
        now_s[0] += 1.0
        await _press(pilot, "space")
        assert _given(recorder, Arm) == 2 * [Arm(mass_state="added")]
