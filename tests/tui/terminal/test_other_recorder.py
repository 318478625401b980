"""A terminal that finds another recorder than the one it was started for."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from daq.bench.campaign import Origin
from daq.control.messages import Setup
from daq.control.orders import ShutDown, Stop
from tui.cli import run
from tui.diagnostics import ExitCode
from tui.terminal.app import BenchApp
from tui.terminal.state.glyphs import GlyphSet, choose_glyphs

from .conftest import screen_text
from .fake_recorder import FakeRecorder

RUNNING = Setup(Origin.SIMULATED, "Granada", 1, 2, ("virtual demo",))
MENU = "attach to it: it goes on as it is"


def _app(recorder: FakeRecorder, folder: Path, wanted: Setup | None) -> BenchApp:
    glyphs = choose_glyphs(GlyphSet.BRAILLE, {}, "utf-8")
    return BenchApp(recorder, folder, glyphs, "MK", wanted=wanted)


def _answered(recorder: FakeRecorder, folder: Path, *keys: str) -> tuple[BenchApp, str, str]:
    """Return the app, what it asks, and what it shows after the keys."""
    app = _app(recorder, folder, Setup(Origin.REAL))
    shown: list[str] = []

    async def act() -> None:
        async with app.run_test(size=(100, 30)) as pilot:
            await pilot.pause()
            shown.append(screen_text(app))
            await pilot.press(*keys)
            await pilot.pause()
            if app.is_running and app.screen_stack:
                recorder.publish()
                await pilot.pause()
                shown.append(screen_text(app))

    asyncio.run(act())
    return app, shown[0], shown[-1]


def _recorder() -> FakeRecorder:
    recorder = FakeRecorder()
    recorder.setup = RUNNING
    recorder.changes["origin"] = Origin.SIMULATED
    return recorder


def test_it_is_attached_to_when_the_operator_says_so(tmp_path: Path) -> None:
    recorder = _recorder()
    app, asked, then = _answered(recorder, tmp_path, "enter")
    assert "it records a simulated car, not a real bus" in " ".join(asked.replace("│", " ").split())
    assert MENU in asked
    assert MENU not in then
    assert "SIMULATED" in then.splitlines()[0]
    assert app.return_code in (None, 0)
    assert not {Stop(), ShutDown()} & set(recorder.orders)


def test_a_new_recording_ends_the_old_one_first(tmp_path: Path) -> None:
    recorder = _recorder()
    _, _, then = _answered(recorder, tmp_path, "down", "enter")
    assert [o for o in recorder.orders if isinstance(o, Stop | ShutDown)] == [Stop(), ShutDown()]
    assert recorder.restarts == 1
    assert MENU not in then


@pytest.mark.parametrize(
    ("keys", "ended"), [(("down", "down", "enter"), True), (("escape",), False)]
)
def test_the_terminal_ends_with_the_recorder_or_leaves_it(
    tmp_path: Path, keys: tuple[str, ...], ended: bool
) -> None:
    recorder = _recorder()
    app, *_ = _answered(recorder, tmp_path, *keys)
    assert not app.is_running
    assert (ShutDown() in recorder.orders) is ended
    assert recorder.restarts == 0


def test_one_who_looks_on_can_only_attach(tmp_path: Path) -> None:
    recorder = _recorder()
    recorder.in_control = False
    _, asked, _ = _answered(recorder, tmp_path, "enter")
    assert MENU in asked
    assert "end its recording" not in asked


SAME = replace(RUNNING, origin=Origin.REAL)


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (None, ""),
        (Setup(Origin.REAL), ""),
        (SAME, ""),
        (replace(SAME, bench_crc32=3), "another bench.toml (vehicle Granada)"),
        (replace(SAME, dbc_crc32=3), "another DBC"),
        (replace(SAME, buses=("socketcan can0",)), "it records virtual demo, not socketcan can0"),
        (Setup(Origin.REPLAYED), "a real bus, not a replayed recording"),
    ],
)
def test_what_differs_is_named_and_what_was_not_asked_for_is_not(
    tmp_path: Path, wanted: Setup | None, words: str
) -> None:
    recorder = FakeRecorder()
    recorder.setup = SAME
    app = _app(recorder, tmp_path, wanted)

    async def act() -> None:
        async with app.run_test(size=(120, 30)) as pilot:
            await pilot.pause()
            shown = " ".join(screen_text(app).replace("│", " ").split())
            assert (MENU in shown) is bool(words)
            assert words in shown

    asyncio.run(act())


@pytest.mark.parametrize(("width", "origin"), [(80, Origin.SIMULATED), (140, Origin.REPLAYED)])
def test_no_screen_hides_that_nothing_is_measured(
    make_app: Callable[..., BenchApp], width: int, origin: Origin
) -> None:
    recorder = FakeRecorder()
    recorder.changes["origin"] = origin
    app = make_app(recorder)

    async def act() -> None:
        async with app.run_test(size=(width, 30)) as pilot:
            await pilot.pause()
            for name in app.SCREENS:
                await app.open(name)
                await pilot.pause()
                recorder.publish()
                await pilot.pause()
                assert f" {origin.upper()} " in screen_text(app).splitlines()[0], name

    asyncio.run(act())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--demo", "--replay", "x.h5"], "cannot be combined"),
        (["--demo", "--fault", "nonsense"], "is not a fault"),
        (["--fault", "weak"], "works on simulated runs only"),
        (["BENCH"], "bench.toml"),
        (["--demo", "BENCH"], "bench.toml"),
        (["--web", "BENCH"], "bench.toml"),
        (["--interface", "virtual", "--channel", "x"], "does not reach other processes"),
    ],
)
def test_a_bad_bench_or_option_starts_no_recorder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    bad = tmp_path / "bench.toml"
    bad.write_text("[vehicle]\nwheels = 5\n")
    given = [str(bad) if option == "BENCH" else option for option in options]
    code = run(["tui", *given, "--out", str(tmp_path / "out")])
    assert code == ExitCode.BAD_INPUT
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
