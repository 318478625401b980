"""Tallies of the accepted runs: their frequency, and how it scatters."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace

from daq.control.messages import Phase
from tui.terminal.app import BenchApp

from .conftest import screen_text
from .fake_recorder import DOUBLE_BUMP, GOOD, FakeRecorder


def test_accepted_runs_show_their_frequency(make_app: Callable[..., BenchApp]) -> None:
    recorder = FakeRecorder()
    recorder.mark("vehicle", "check")
    for hertz in (1.14, 1.16):
        recorder.bump()
        recorder.judge(replace(GOOD, code="motion", unit="Hz", value=hertz))
    recorder.bump()
    recorder.judge(DOUBLE_BUMP, replace(GOOD, code="motion", unit="Hz", value=9.0))
    recorder.phase = Phase.IDLE
    app = make_app(recorder)

    async def act() -> None:
        async with app.run_test(size=(200, 50)) as pilot:
            await pilot.pause()
            await pilot.pause()
            assert "1.15 ± 0.01 Hz" in screen_text(app)
            await pilot.resize_terminal(140, 40)
            await pilot.pause()
            recorder.publish()
            await pilot.pause()
            assert "1.15 Hz" in screen_text(app)
            assert "±" not in screen_text(app)

    asyncio.run(act())
