"""What the terminal's tests share: an app on a fake recorder, and its screen as text."""

from __future__ import annotations

import asyncio
import inspect
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from textual.app import App
from textual.pilot import Pilot

from tui.terminal.app import BenchApp
from tui.terminal.screens.masses import MassesScreen
from tui.terminal.state.glyphs import Glyphs, GlyphSet, choose_glyphs

from .fake_recorder import FakeRecorder

SNAPSHOTS = Path(__file__).parent / "snapshots"
REDRAWS = 3
"""Frames drawn before an app counts as settled: layout, then what was waiting for it, twice."""
MOST_S = 0.5
"""Seconds to wait for a thread: some wait for a process, or for a time-out."""
REWRITE = "BUMPBENCH_REWRITE_SNAPSHOTS"
SIZES = {"80x24": (80, 24), "140x40": (140, 40), "200x50": (200, 50)}


async def at_every_size(
    pilot: Pilot[None], snapshot: Callable[[App[None], str], None], name: str
) -> None:
    """Give the terminal each size in turn, as a person does who pulls at the window."""
    for size, (width, height) in SIZES.items():
        await pilot.resize_terminal(width, height)
        await pilot.pause()
        snapshot(pilot.app, f"{name}_{size}")


def screen_text(app: App[None]) -> str:
    """Return what is on the screen: the only place that knows Textual's compositor."""
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(s.text for s in strip).rstrip() for strip in strips) + "\n"


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a coroutine of a test in a loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    wanted = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in wanted}))
    return True


@pytest.fixture(autouse=True)
def _settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a pilot wait until the app has nothing left to do.

    Textual's pilot looks whether the process uses little time in 20 ms.  On a busy machine that
    holds too early, and on a quiet one it takes most of the time of a test.
    """

    async def wait_for_screen(pilot: Pilot[None], timeout: float = 30.0) -> bool:
        await settle(pilot.app)
        return True

    async def wait_for_idle(_: float = 0.0) -> None:
        await _drain()

    monkeypatch.setattr(Pilot, "_wait_for_screen", wait_for_screen)
    monkeypatch.setattr("textual.pilot.wait_for_idle", wait_for_idle)
    monkeypatch.setattr("textual.app.wait_for_idle", wait_for_idle)


async def settle(app: App[Any]) -> None:
    """Wait until messages, threads and drawing of an app are done."""
    for _ in range(REDRAWS):
        await _drain()
        if app._resize_timer is not None:
            app._check_resize()  # now in place of 8 ms later
        if app.screen_stack:
            app.screen._on_timer_update()  # draws now what the next frame would
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


@pytest.fixture(autouse=True)
def _no_outlook(monkeypatch: pytest.MonkeyPatch) -> None:
    """Start no planner in a process of its own whenever the masses are on the screen."""

    async def compute(screen: MassesScreen, text: str) -> None:
        """Leave the outlook open."""

    monkeypatch.setattr(MassesScreen, "_compute", compute)


@pytest.fixture
def make_app(tmp_path: Path) -> Callable[..., BenchApp]:
    """Return what makes an app on a recorder; time passes for the lock-out by itself."""

    def make(
        recorder: FakeRecorder,
        glyphs: GlyphSet = GlyphSet.BRAILLE,
        clock: Callable[[], float] | None = None,
        auto: bool = False,
        theme: str = "bench-dark",
    ) -> BenchApp:
        ticks = iter(range(1_000_000))
        chosen: Glyphs = choose_glyphs(glyphs, {}, "utf-8")
        by_itself = clock or (lambda: float(next(ticks)))
        return BenchApp(recorder, tmp_path, chosen, "MK", theme, auto, by_itself)

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
