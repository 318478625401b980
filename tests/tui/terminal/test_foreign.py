"""Names, notes and errors of others on every screen at every size: never markup, never control."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable
from dataclasses import replace

import pytest
from rich.cells import cell_len
from textual.color import Color
from textual.theme import Theme
from textual.widgets import Input

from daq.control.messages import Alarm, BusState, BusStatus, Phase, SessionState, SessionStatus
from tui.terminal.app import BenchApp
from tui.terminal.look import THEMES
from tui.terminal.screens.help import HelpScreen
from tui.terminal.state.feed import Lost

from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, FakeRecorder
from .test_bench_screens import NOISY, UPSIDE_DOWN

FOREIGN = {
    "acts": "[/x] [@click=app.quit]q[/]\x1b[31m\x1b]0;x\x07b\r\n\tc\x9b31m\x00 \u202e\u05e9\u05dc",
    "is wide": "日本語の車両番号👩\u200d🔧🚗🇩🇪e\u0301" * 8 + "W" * 200,
}
ROOMS = {"acts": ((80, 24),), "is wide": ((60, 20), (80, 24))}
"""Sizes of the terminal: what acts does so at any, what is wide runs over a small one."""
_INVISIBLE = {"Cc", "Cf", "Cs"}


def _bad_lines(app: BenchApp, columns: int) -> list[str]:
    """Return lines that are wider than the terminal or would act on it."""
    return [
        line
        for line in screen_text(app).splitlines()
        if cell_len(line) > columns or any(unicodedata.category(c) in _INVISIBLE for c in line)
    ]


def _reported_by(recorder: FakeRecorder, text: str) -> None:
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge(replace(DOUBLE_BUMP, text=text, advice=text))
    due = recorder.status.due
    assert due is not None
    recorder.phase = Phase.IDLE
    recorder.changes |= {
        "vehicle": text,
        "alarms": tuple(Alarm("bus_off", text, text, text, 0) for _ in range(5)),
        "overloaded": (text, text),
        "not_at_rest": (text,),
        "buses": (BusStatus(text, BusState.BUS_OFF, 0.3, 1.0, 1, 1, 1),),
        "due": replace(due, instruction=text),
        "session": SessionStatus(SessionState.FAILED, text, text),
        "disk": replace(recorder.status.disk, failed=text, warning=text),
    }


@pytest.mark.parametrize("name", FOREIGN)
async def test_foreign_text_only_shows(name: str, make_app: Callable[..., BenchApp]) -> None:
    text = FOREIGN[name]
    warned = replace(NOISY, subject=f"channel {text}", reason=text, advice=text)
    recorder = FakeRecorder(check=(warned, replace(UPSIDE_DOWN, reason=text, advice=text)))
    _reported_by(recorder, text)
    app = make_app(recorder)
    app.operator = text
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        for screen in app.SCREENS:
            for size in ROOMS[name]:
                await pilot.resize_terminal(*size)
                await app.open(screen)
                await pilot.pause()
                await pilot.pause()
                assert _bad_lines(app, size[0]) == [], (screen, size)
            await pilot.press("f1")
            await pilot.pause()
            assert isinstance(app.screen, HelpScreen), screen
            await pilot.press("f1")
            await pilot.pause()
            assert not isinstance(app.screen, HelpScreen), screen
        await app.open("run")
        await pilot.press("t")
        await pilot.pause()
        assert _bad_lines(app, 80) == []
        await pilot.press("escape")
        app.warn(text)
        recorder.post(Lost(text, text))
        await pilot.pause()
        assert _bad_lines(app, 80) == []


async def test_a_terminal_that_is_too_small_says_so(make_app: Callable[..., BenchApp]) -> None:
    app = make_app(FakeRecorder())
    async with app.run_test(size=(60, 20)) as pilot:
        await pilot.pause()
        await pilot.pause()
        assert "60x20 is too small: make it 80x24" in screen_text(app)
        await pilot.resize_terminal(80, 24)
        await pilot.pause()
        await pilot.pause()
        assert "too small" not in screen_text(app)


async def test_a_reason_that_was_not_given_is_there_again(
    make_app: Callable[..., BenchApp],
) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    recorder.bump()
    recorder.judge(DOUBLE_BUMP)
    recorder.phase = Phase.IDLE
    app = make_app(recorder)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        for end in ("escape", "enter"):
            recorder.refuse = "the disk is full"
            await pilot.press("t")
            await pilot.pause()
            await pilot.press("x", end)
            await pilot.pause()
        recorder.refuse = ""
        await pilot.press("t")
        await pilot.pause()
        assert app.screen.query_one(Input).value == "xx"


def _luminance(color: Color) -> float:
    """Return the relative luminance of WCAG 2.1."""
    parts = [c / 255 for c in (color.r, color.g, color.b)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", THEMES, ids=lambda theme: theme.name)
def test_every_colour_of_words_stands_out_from_every_ground(theme: Theme) -> None:
    words = ("foreground", "primary", "warning", "error", "success", "accent")
    for word in words:
        for ground in ("background", "surface", "panel"):
            pair = [_luminance(Color.parse(getattr(theme, name))) for name in (word, ground)]
            contrast = (max(pair) + 0.05) / (min(pair) + 0.05)
            assert contrast >= 4.5, (word, ground, contrast)
