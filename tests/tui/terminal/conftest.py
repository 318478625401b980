"""What the terminal's tests share: an app on a fake recorder, and its screen as text."""

from __future__ import annotations

import asyncio
import inspect
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from textual.app import App
from textual.pilot import Pilot

from tui.terminal.app import BenchApp
from tui.terminal.state.glyphs import Glyphs, GlyphSet, choose_glyphs

from .fake_recorder import FakeRecorder

SNAPSHOTS = Path(__file__).parent / "snapshots"
TRIES = 20
CALM = 3
"""Looks in a row at which nothing waits: what is done may put off something more."""
MOST_LOOKS = 20
"""Some screens are never calm: they draw what is measured."""
REWRITE = "BUMPBENCH_REWRITE_SNAPSHOTS"
SIZES = {"80x24": (80, 24), "140x40": (140, 40), "200x50": (200, 50)}


async def at_every_size(
    pilot: Pilot[None], snapshot: Callable[[App[None], str], None], name: str
) -> None:
    """Give the terminal each size in turn, as a person does who pulls at the window."""
    for size, (width, height) in SIZES.items():
        await pilot.resize_terminal(width, height)
        await pilot.pause()
        await pilot.pause()
        for left in reversed(range(TRIES)):
            try:
                snapshot(pilot.app, f"{name}_{size}")
                break
            except AssertionError:  # on a busy machine it takes longer to come to that
                if not left:
                    raise
                await pilot.pause(0.1)


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
    """Let a pilot wait until no message waits, and then as it does by itself.

    Its own way alone is to look whether the process uses little time, and on a busy machine every
    process does.
    """
    once = Pilot._wait_for_screen

    async def until_calm(pilot: Pilot[None], timeout: float = 30.0) -> bool:
        calm = 0
        for _ in range(MOST_LOOKS):
            if not await once(pilot, timeout):
                return False
            await asyncio.sleep(0)
            calm = calm + 1 if _is_calm(pilot.app) else 0
            if calm == CALM:
                break
        return True

    monkeypatch.setattr(Pilot, "_wait_for_screen", until_calm)


def _is_calm(app: App[None]) -> bool:
    nodes = [app, *app.screen.walk_children(with_self=True)]
    return not any(node.message_queue_size for node in nodes) and not getattr(app, "_news", None)


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
