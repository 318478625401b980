"""Which keys a screen of the run loop has at hand: those that do something now, and no other."""

from __future__ import annotations

from dataclasses import replace

from textual.pilot import Pilot

from daq.control.messages import LeftOut, Phase
from daq.control.orders import Accept, Choose, Pause, Reject
from daq.runs import Excitation
from tui.terminal.screens.bumping import BumpingScreen
from tui.terminal.state.feed import STARTING, Lost
from tui.terminal.widgets.lists import TallyList

from .fake_recorder import DOUBLE_BUMP, FakeRecorder
from .operated import Make, orders_of
from .test_step_keys import front, pressed, seen

PRESSED = ("next", "reject", "undo", "redo", "leave_out", "pause")
OTHERS = ("take_back", "more", "acknowledge", "start_recorder")


async def at_hand(pilot: Pilot[None]) -> set[str]:
    """Return what the keys of the screen in front would do."""
    await pilot.pause()
    screen = pilot.app.screen
    assert isinstance(screen, BumpingScreen)
    found = {name for name in PRESSED if screen.check_action("press", (name,))}
    return found | {name for name in OTHERS if screen.check_action(name, ())}


async def test_only_keys_that_do_something_are_at_hand(make_app: Make) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        home = app.screen
        assert isinstance(home, BumpingScreen)
        assert await at_hand(pilot) == {"next", "more"}
        assert (home.acts, home.ready) == (True, True)
        recorder.post(STARTING)
        assert await at_hand(pilot) == set()
        recorder.post(Lost("it has ended", "all is on the disk"))
        assert await at_hand(pilot) == {"start_recorder"}
        assert (home.acts, home.ready) == (False, False)
        recorder.publish(halted="double_bump")
        await pilot.press("escape")  # the page of help on the reason
        assert await at_hand(pilot) == {"next", "more"}
        assert (home.acts, home.ready) == (True, False), "a person has to look"
        recorder.publish(halted="", overloaded=("hub_acc_fl",))
        assert await at_hand(pilot) == {"next", "more", "acknowledge"}
        recorder.publish(overloaded=(), proposed=(LeftOut("baseline_roll_1", "odd"),))
        assert await at_hand(pilot) == {"next", "more", "leave_out"}
        recorder.publish(proposed=())
        await pressed(pilot, "space")
        run = front(app)
        assert run is not home
        assert await at_hand(pilot) == {"pause"}
        label = recorder.bump()
        assert await at_hand(pilot) == {"reject", "pause"}
        recorder.judge(DOUBLE_BUMP)
        assert await at_hand(pilot) == {"next", "reject", "undo", "pause", "take_back"}
        assert isinstance(run, BumpingScreen)
        assert not run.ready, "the countdown runs out by itself"
        await pressed(pilot, "escape")
        assert orders_of(recorder, Pause) == [Pause()]
        assert "pauses after this run" not in seen(app)
        assert await at_hand(pilot) == {
            "next", "reject", "undo", "pause", "take_back", "more",
        }  # fmt: skip
        await pressed(pilot, "u")
        assert "redo" in await at_hand(pilot)
        await pressed(pilot, "r", "t", "escape")
        assert orders_of(recorder, Accept) == []
        await pressed(pilot, "t", *"a door", "enter")
        assert orders_of(recorder, Accept) == [Accept(label, "a door")]
        assert "take_back" not in await at_hand(pilot)
        recorder.refuse = "JL is in control"
        await pressed(pilot, "m")
        assert "next: baseline" not in seen(app)
        recorder.refuse = ""
        app.screen.query_one(TallyList).chosen = 99
        assert "next: added roll" in await pressed(pilot, "m"), "the last one there is"
        assert orders_of(recorder, Choose)[-1] == Choose("added", Excitation.ROLL)
        await pressed(pilot, "escape")
        assert front(app) is home
        await pressed(pilot, "backspace")
        assert orders_of(recorder, Reject) == [Reject()]
        status = replace(recorder.status, tallies=())
        recorder.post(status)
        await pilot.pause()
        count = len(orders_of(recorder, Choose))
        await pressed(pilot, "m")
        assert len(orders_of(recorder, Choose)) == count
        assert recorder.phase is Phase.PAUSED
