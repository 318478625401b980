"""Fixtures of the terminal's tests: an app on a fake recorder, and its screen as text."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from functools import partialmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from textual.app import App
from textual.css import stylesheet
from textual.css.model import RuleSet
from textual.css.stylesheet import Stylesheet
from textual.css.tokenize import tokenize_values
from textual.pilot import Pilot
from textual.screen import Screen

from daq.control.messages import Setup
from tui.terminal.app import BenchApp
from tui.terminal.words import Glyphs, choose_glyphs

from .fake_recorder import FakeRecorder

if TYPE_CHECKING:
    from .operated import FakeWorker

SNAPSHOTS = Path(__file__).parent / "snapshots"
REDRAWS = 3
"""Frames before an app counts as settled: layout, then what was waiting for it, twice."""
MOST_S = 0.5
"""Seconds to wait for a thread: some wait for a process, or for a time-out."""
REWRITE = "BUMPBENCH_REWRITE_SNAPSHOTS"
SIZES = {"80x24": (80, 24), "140x40": (140, 40)}


Snapshot = Callable[[App[None], str], None]


async def at_every_size(pilot: Pilot[None], snapshot: Snapshot, name: str) -> None:
    """Give the terminal each size in turn, as a person does who pulls at the window."""
    for size, (width, height) in SIZES.items():
        await pilot.resize_terminal(width, height)
        await pilot.pause()
        snapshot(pilot.app, f"{name}_{size}")


def screen_text(app: App[None]) -> str:
    """Return what is on the screen: the only place that knows Textual's compositor."""
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(s.text for s in strip).rstrip() for strip in strips) + "\n"


_run_test = App.run_test


@pytest.fixture(autouse=True)
def _with_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Show messages to the operator, which Textual leaves out of a test."""
    monkeypatch.setattr(App, "run_test", partialmethod(_run_test, notifications=True))


@pytest.fixture(autouse=True)
def _settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a pilot wait until the app has nothing left to do.

    Textual's pilot looks whether the process uses little time in 20 ms.  On a busy machine that
    holds too early, and on a quiet one it takes most of the time of a test.
    """

    async def wait_for_screen(pilot: Pilot[None], timeout: float = 30.0) -> bool:
        await settle(pilot.app)
        draw_if_changed(pilot.app)
        return True

    async def wait_for_idle(_: float = 0.0) -> None:
        await _drain()

    monkeypatch.setattr(Pilot, "_wait_for_screen", wait_for_screen)
    monkeypatch.setattr("textual.pilot.wait_for_idle", wait_for_idle)
    monkeypatch.setattr("textual.app.wait_for_idle", wait_for_idle)


@pytest.fixture(autouse=True)
def _drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw a screen when its app has settled, and not each frame on the way there.

    The frames are a third of the CPU of these tests, and are not looked at.
    """
    monkeypatch.setattr(Screen, "_compositor_refresh", _draw_later)


_draw = Screen._compositor_refresh
_CHANGED = "_changed_since_drawn"


def _draw_later(screen: Screen[Any]) -> None:
    """Note that the screen in front has changed; those behind it draw nothing in any case."""
    if screen is screen.app.screen:
        setattr(screen, _CHANGED, True)
        screen._dirty_widgets.clear()
        screen.app._update_mouse_over(screen)
    else:
        _draw(screen)


def draw_if_changed(app: App[Any]) -> None:
    """Draw the screen in front if a frame of it is due."""
    if app.screen_stack and getattr(app.screen, _CHANGED, False):
        setattr(app.screen, _CHANGED, False)
        _draw(app.screen)


_TOKENS: dict[frozenset[tuple[str, str]], Any] = {}
_RULES: dict[tuple[object, ...], list[RuleSet]] = {}


@pytest.fixture(autouse=True)
def _parsed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Parse each style sheet once for all apps of this process."""
    parse_rules = Stylesheet._parse_rules

    def parsed(sheet: Stylesheet, *what: Any, **named: Any) -> list[RuleSet]:
        key = (what, tuple(named.items()), frozenset(sheet._variables.items()))
        if key not in _RULES:
            _RULES[key] = parse_rules(sheet, *what, **named)
        return _RULES[key]

    def tokens(variables: dict[str, str]) -> Any:
        key = frozenset(variables.items())
        if key not in _TOKENS:
            _TOKENS[key] = tokenize_values(variables)
        return _TOKENS[key]

    monkeypatch.setattr(Stylesheet, "_parse_rules", parsed)
    monkeypatch.setattr(stylesheet, "tokenize_values", tokens)


async def settle(app: App[Any]) -> None:
    """Wait until messages, threads and layout of an app are done."""
    for _ in range(REDRAWS):
        await _drain()
        if app._resize_timer is not None:
            app._check_resize()  # now in place of 8 ms later
        if app.screen_stack:
            app.screen._on_timer_update()  # lays out now what the next frame would
    await _drain()


async def _drain() -> None:
    """Wait until every task of the loop waits for a timer, and no thread works for the loop."""
    loop: Any = asyncio.get_running_loop()
    end_s = loop.time() + MOST_S
    while loop.time() < end_s:
        await asyncio.sleep(0)
        if loop._ready:
            continue
        if not _is_busy(loop._default_executor):
            return
        await asyncio.sleep(0.001)


def _is_busy(threads: Any) -> bool:
    """Return True while a thread of a pool works."""
    if threads is None:
        return False
    idle: int = threads._idle_semaphore._value
    return bool(threads._work_queue.qsize()) or idle < len(threads._threads)


@pytest.fixture(autouse=True)
def _same_everywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    monkeypatch.setenv("TEXTUAL_ANIMATIONS", "none")
    monkeypatch.delenv("NO_COLOR", raising=False)


@pytest.fixture
def make_app(tmp_path: Path) -> Callable[..., BenchApp]:
    """Return what makes an app on a recorder; time passes for the lock-out by itself."""

    def make(
        recorder: FakeRecorder,
        glyphs: str = "braille",
        clock: Callable[[], float] | None = None,
        auto: bool = False,
        theme: str = "bench-dark",
        wanted: Setup | None = None,
    ) -> BenchApp:
        ticks = iter(range(1_000_000))
        chosen: Glyphs = choose_glyphs(glyphs, {})
        by_itself = clock or (lambda: float(next(ticks)))
        return BenchApp(recorder, tmp_path, chosen, "MK", theme, auto, by_itself, wanted=wanted)

    return make


@pytest.fixture
def snapshot() -> Callable[[App[None], str], None]:
    """Compare the screen with a text file; `BUMPBENCH_REWRITE_SNAPSHOTS=1` writes it anew."""

    def compare(app: App[None], name: str) -> None:
        path = SNAPSHOTS / f"{name}.txt"
        seen = screen_text(app)
        if os.environ.get(REWRITE):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(seen, "utf-8")
        assert seen == path.read_text("utf-8"), f"{name}: look, then set {REWRITE}=1"

    return compare


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> FakeWorker:
    """Return what answers the tasks of workers from memory."""
    from .operated import FakeWorker

    return FakeWorker().use(monkeypatch)
