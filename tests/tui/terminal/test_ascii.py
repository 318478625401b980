"""A terminal that is trusted with ASCII alone is sent nothing else, on whatever screen."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from unicodedata import normalize

from rich.segment import Segment
from textual.color import Color

from tui.terminal.app import BenchApp
from tui.terminal.look import PlainAscii
from tui.terminal.screens.results import ResultsScreen
from tui.terminal.state.glyphs import GlyphSet

from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .outcomes import outcome

SCREENS = (
    "vehicle", "check", "home", "run", "masses", "identify", "results", "report", "sessions",
)  # fmt: skip
NAME = "Prüfwagen 車 [b]é"


def test_no_screen_holds_anything_but_ascii(make_app: Callable[..., BenchApp]) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge()
    recorder.changes["vehicle"] = NAME
    app = make_app(recorder, glyphs=GlyphSet.ASCII)

    async def act() -> None:
        async with app.run_test(size=(100, 30)) as pilot:
            await pilot.pause()
            for name in SCREENS:
                await app.open(name)
                if isinstance(app.screen, ResultsScreen):
                    app.screen.show_outcome(outcome())
                for keys in ((), ("tab",), ("escape", "f1"), ("escape",)):
                    await pilot.press(*keys)
                    await pilot.pause()
                    seen = screen_text(app)
                    wrong = {c for c in seen if not c.isascii()}
                    assert not wrong, (name, keys, wrong)
                    assert seen.strip()
            await pilot.press("ctrl+p")
            await pilot.pause()
            palette = screen_text(app)
            search = next(line for line in palette.splitlines() if "Search for commands" in line)
            assert "?" not in search  # a picture that the terminal has not
            await pilot.press("escape")
            app.action_note()
            await pilot.pause()
            assert screen_text(app).isascii()

    asyncio.run(act())


def test_every_character_keeps_its_width() -> None:
    reported = "| ± 0.3 · 12\u00d74 \u2013 Prüf 車 ┌─┐ ▶ m² 95 % ⠒ ±"
    (made,) = PlainAscii().apply([Segment(reported)], Color(0, 0, 0))
    assert made.text == "|+/-0.3 . 12x4 - Pruf ?? +-+ > m2 95 % ? ~"
    assert made.cell_length == Segment(normalize("NFC", reported)).cell_length
