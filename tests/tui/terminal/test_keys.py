"""Keys: the run loop, bursts as of a scanner, help, notes, messages, the palette."""

from __future__ import annotations

from collections.abc import Awaitable
from functools import partial

from textual.events import AppBlur
from textual.widgets import Input

from daq.control.messages import (
    Accept,
    Acknowledge,
    Arm,
    AskCheck,
    Build,
    Note,
    Pause,
    Phase,
    Redo,
    Reject,
    ShutDown,
    Stop,
    Undo,
)
from daq.runs import Excitation
from daq.verdict.words import WORDS
from tui.terminal.app import BenchApp
from tui.terminal.campaign import BenchStep
from tui.terminal.feed import Role
from tui.terminal.form import Form
from tui.terminal.screens.base import BenchScreen
from tui.terminal.screens.bumping import HomeScreen
from tui.terminal.screens.vehicle import VehicleScreen
from tui.terminal.widgets import HelpScreen, page_of

from ...house.test_walks import walked
from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, FakeRecorder, ready
from .operated import (
    FakeWorker,
    Make,
    Snapshot,
    at_every_size,
    burst,
    commands,
    measured,
    on_screen,
    orders_of,
    playing,
    pressed,
    seen,
    shows,
    until,
)


async def test_a_campaign_step_by_space_alone(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    async with playing(app) as pilot:
        assert isinstance(app.screen, HomeScreen)
        for _ in range(3):  # bounce, pitch, roll
            await pressed(pilot, "space")
            assert app.screen.has_class("-run")
            for _ in range(2):
                recorder.bump()
                recorder.judge()
                await pilot.pause()
            recorder.turn(Phase.IDLE)
            await pilot.pause()
        assert len(orders_of(recorder, Arm)) == 3
        await pressed(pilot, "space")
        assert app.step is BenchStep.MASSES


async def test_a_bump_passes_few_files(make_app: Make) -> None:
    """From SPACE to the verdict on the screen: in the terminal, without socket and recorder."""
    recorder = ready()
    app = make_app(recorder)
    async with playing(app) as pilot:
        with walked() as files:
            await pressed(pilot, "space")
            recorder.bump()
            recorder.judge()
            await pilot.pause()
        assert app.screen.has_class("-run")
    assert {"tui/terminal/app.py", "tui/terminal/screens/bumping.py"} <= files
    assert len(files) <= 15, sorted(files)


async def test_a_held_key_counts_once(make_app: Make) -> None:
    recorder = ready()
    recorder.bump()
    recorder.judge()
    recorder.phase = Phase.PAUSED
    now_s = 0.0
    app = make_app(recorder, clock=lambda: now_s)
    async with playing(app) as pilot:
        for _ in range(12):  # the keyboard repeats thirty times a second
            await pilot.press("backspace")
            now_s += 0.03
        assert len(orders_of(recorder, Reject)) == 1
        now_s += 0.31
        await pilot.press("backspace")
        await pilot.pause()
        assert len(orders_of(recorder, Reject)) == 2


async def test_overload_lamps_stay_until_put_out(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        recorder.publish(overloaded=("hub_acc_fl",))
        await pilot.pause()
        assert "OVERLOAD hub_acc_fl" in screen_text(app).splitlines()[0]
        recorder.publish()
        await pilot.pause()
        assert "OVERLOAD" in screen_text(app)
        await pressed(pilot, "a")
        assert orders_of(recorder, Acknowledge)
        assert "OVERLOAD" not in screen_text(app)


async def test_a_viewer_gives_no_orders_until_it_has_taken_over(make_app: Make) -> None:
    recorder = ready(in_control=False)
    app = make_app(recorder)
    async with playing(app) as pilot:
        assert "VIEWER" in screen_text(app).splitlines()[0]
        await pressed(pilot, "space")
        assert not orders_of(recorder, Arm)
        await pressed(pilot, "c", "space")
        assert orders_of(recorder, Arm)
        recorder.post(Role(False, "somebody else has taken over"))
        recorder.publish()
        await pilot.pause()
        assert "VIEWER" in screen_text(app).splitlines()[0]
        assert "somebody else has taken over" in screen_text(app), "and why the keys are dead"


async def test_a_new_terminal_is_where_the_old_one_was(make_app: Make) -> None:
    recorder = ready()
    recorder.finish("baseline")
    recorder.mark("masses")
    recorder.bump()
    recorder.phase = Phase.DECAY
    app = make_app(recorder)
    async with playing(app):
        assert app.screen.has_class("-run")
        assert app.step is BenchStep.ADDED
        assert "DECAY" in screen_text(app)


async def test_auto_presses_what_is_next_and_leaves_the_rest(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder, auto=True)
    async with playing(app) as pilot:
        await app._press_next()
        await pilot.pause()
        assert orders_of(recorder, Arm)
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


async def test_the_weights_are_asked_for_where_they_change(make_app: Make) -> None:
    recorder = ready()
    recorder.finish("baseline")
    recorder.mark("masses")
    now_s = [0.0]
    app = make_app(recorder, clock=lambda: now_s[0])
    async with playing(app) as pilot:
        for key, asked, after_s in (
            ("space", True, 1.0),
            ("space", True, 0.1),  # still held down
            ("escape", False, 1.0),
            ("space", True, 1.0),
            ("space", False, 1.0),
        ):
            assert orders_of(recorder, Arm) == []
            now_s[0] += after_s
            await pressed(pilot, key)
            assert ("Weights on?" in screen_text(app)) is asked
        assert orders_of(recorder, Arm) == [Arm(mass_state="added")]
        recorder.turn(Phase.IDLE)
        now_s[0] += 1.0
        assert "Weights on?" in await pressed(pilot, "space")
        recorder.choose("baseline", Excitation.BOUNCE)  # at another terminal
        recorder.publish()
        await pressed(pilot, "enter")
        assert len(orders_of(recorder, Arm)) == 1, "the answer was to another question"


def _typed(app: BenchApp) -> dict[str, str]:
    return app.screen.query_one(Form).values


async def test_a_whole_form_in_one_burst(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    async with on_screen(app, VehicleScreen) as (pilot, _):
        keys = ["tab", *"T5 A1", "enter", *"JL", "tab", *"1552", "tab", *"1.5"]
        keys += ["enter", *"800x", "backspace", "down", *"2", "up", "home", *"1", "delete"]
        await burst(pilot, *keys)
        typed = _typed(app)
        assert typed["name"] == "T5 A1"
        assert typed["operator"] == "JL"
        assert (typed["total_mass_kg"], typed["total_mass_kg.sigma"]) == ("1552", "1.5")
        assert (typed["front_axle_kg"], typed["front_axle_kg.sigma"]) == ("100", "2")


async def test_an_answer_in_one_burst_with_its_question(make_app: Make) -> None:
    recorder = ready()
    label = recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    recorder.phase = Phase.IDLE
    app = make_app(recorder)
    async with on_screen(app, HomeScreen) as (pilot, _):
        assert "second bump at +0.84 s" in await pressed(pilot, "t")
        await pressed(pilot, "enter", "escape")
        assert not orders_of(recorder, Accept), "without a reason nothing happens"
        await burst(pilot, "t", *"a door", "enter", "n", *"2nd door")
        assert orders_of(recorder, Accept) == [Accept(label, "a door")]
        assert app.screen.query_one(Input).value == "2nd door"
        await burst(pilot, "escape")
        # With caps lock keys are the same and a text keeps its capitals; a browser may say in
        # between that the focus is gone.
        await burst(pilot, "N", "R", AppBlur(), "L", "enter")
        assert orders_of(recorder, Note) == [Note("RL")]


def test_there_is_help_for_every_screen_and_reason(make_app: Make) -> None:
    app = make_app(FakeRecorder())
    screens = [app.get_screen(name) for name in app.SCREENS]
    for name in (screen.help_page for screen in screens if isinstance(screen, BenchScreen)):
        assert page_of(name).startswith("# ")
    for name, reason in WORDS.items():
        assert page_of(name).startswith(f"# Rejected: {reason.title}")
        assert reason.advice.rstrip(".")[1:] in page_of(name)


async def test_help_shows_the_keys_of_the_screen(make_app: Make, snapshot: Snapshot) -> None:
    app = make_app(measured())
    async with playing(app, (100, 30)) as pilot:
        await pressed(pilot, "f1")
        assert isinstance(app.screen, HelpScreen)
        await at_every_size(pilot, snapshot, "help_identify")
        await pressed(pilot, "f1")
        assert not isinstance(app.screen, HelpScreen)


async def test_notes_messages_and_the_palette(make_app: Make, worker: FakeWorker) -> None:
    recorder = measured()
    app = make_app(recorder)

    async def do(name: str) -> None:
        made = commands(app)[name]()
        if isinstance(made, Awaitable):
            await made

    async with playing(app) as pilot:
        rows = screen_text(app).splitlines()
        for text in ("No space left on device", "the note is in the recording"):
            app.warn(text)
            await until(pilot, partial(shows, app, text))
            shown = screen_text(app).splitlines()
            assert text in "\n".join(shown[-4:])
            assert (shown[:10], shown[-1]) == (rows[:10], rows[-1]), "it covers neither"
            assert "\u2518" in "".join(shown[-4:-1]), "the lower edge of the box is seen"
        await pressed(pilot, "n", *"wet [b] 7", "enter")
        await pressed(pilot, "n", *"  ", "enter", "escape")
        assert orders_of(recorder, Note) == [Note("wet [b] 7")]
        assert all(": " in name for name in commands(app))
        await do("recorder: stop")
        assert isinstance(recorder.orders[-1], Stop)
        await pilot.press("ctrl+p", *"shut")
        await pilot.pause(0.3)
        assert "recorder: shut down" in screen_text(app)
        await pilot.press("escape")
        await do("recorder: shut down")
        assert isinstance(recorder.orders[-1], ShutDown)
        assert app._exit


async def test_the_run_loop_says_what_a_key_has_done(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    async with playing(app) as pilot:
        await pressed(pilot, "pagedown")
        label = recorder.bump()
        await pilot.pause()
        assert "pauses after this run" in await pressed(pilot, "escape")
        recorder.turn(Phase.TRIGGERED)
        recorder.judge()
        await pilot.pause()
        await pressed(pilot, "backspace")
        run = recorder.run_log.run(label)
        assert run is not None
        assert run.status.value == "rejected"
        assert "undone; R = redo" in await pressed(pilot, "u")
        assert "redone; U = undo" in await pressed(pilot, "r")
        given = [type(order) for order in recorder.orders if not hasattr(order, "seconds")]
        assert given[-4:] == [Pause, Reject, Undo, Redo]
        recorder.turn(Phase.PAUSED)
        await pilot.pause()
        assert "next: baseline pitch" in await pressed(pilot, "down", "m")
        await pressed(pilot, "space")
        assert isinstance(recorder.orders[-1], Arm)
        recorder.turn(Phase.PAUSED)
        await pilot.pause()
        assert not app.screen.has_class("-run")


async def test_a_refused_order_says_why_and_a_viewer_gives_none(make_app: Make) -> None:
    recorder = ready()
    app = make_app(recorder)
    async with playing(app) as pilot:
        await pressed(pilot, "6")
        assert isinstance(app.screen, HomeScreen)
        assert screen_text(app).count("not reached yet") == 1, "a toast would cover what is next"
        recorder.refuse = "the disk is full"
        assert "the disk is full" in await pressed(pilot, "space")
        app.in_control = False
        assert await app.ask(Arm()) is None
        await pilot.pause()
        assert "C asks for control" in seen(app)
        assert await app.ask(Build()) is None
        assert orders_of(recorder, Build) == []
        recorder.refuse = ""
        assert await app.ask(AskCheck(1.0)) is not None, "who looks on may ask"
