"""From a real session file in the list, through real workers, to results and report."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from textual.pilot import Pilot

import daq
from tui.app import BenchApp

from ...identify.stress import stress_session
from .conftest import screen_text
from .fake_recorder import FakeRecorder

_MOST_S = 90.0


async def until(pilot: Pilot[None], condition: Callable[[], bool]) -> None:
    """Wait for something that a process of its own does."""
    for _ in range(int(_MOST_S / 0.1)):
        if condition():
            return
        await pilot.pause(0.1)
    raise AssertionError(screen_text(pilot.app))


def test_a_real_session_from_the_list_to_its_report(
    make_app: Callable[..., BenchApp], tmp_path: Path
) -> None:
    whole = stress_session("linear", 2, 100.0)
    runs = tuple(run for run in whole.runs if run.repeat == 1)
    vehicle = replace(whole.vehicle, name="[bold]T5[/]\x1b[31m")
    daq.write_session(tmp_path / "session_0001.h5", replace(whole, runs=runs, vehicle=vehicle))
    app = make_app(FakeRecorder())

    async def act() -> None:
        async with app.run_test(size=(140, 40)) as pilot:
            await pilot.pause()
            await app.action_sessions()
            await until(pilot, lambda: "ready" in screen_text(app))
            assert "[bold]T5[/]\\x1b[31m" in screen_text(app)
            await pilot.press("space")
            await until(pilot, lambda: app.screen is app.get_screen("results"))
            await pilot.pause()
            seen = screen_text(app)
            assert "6 of 6 runs used" in seen
            assert "sprung mass" in seen
            await pilot.press("space")
            await pilot.pause()
            await pilot.press("space")
            await until(pilot, lambda: "WRITTEN" in screen_text(app))

    asyncio.run(act())
    assert (tmp_path / "session_0001.html").stat().st_size > 100_000
    assert (tmp_path / "session_0001.pdf").read_bytes().startswith(b"%PDF")
