"""From a real session file in the list, through real workers, to report and results."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from textual.pilot import Pilot

import daq
from daq.runs import RunStatus
from daq.vehicle import FORD_GRANADA
from tui.jobs.lines import Outcome
from tui.terminal.app import BenchApp

from ...identify.stress import stress_session
from .conftest import screen_text
from .fake_recorder import FakeRecorder
from .test_results import results_of

_MOST_S = 300.0


async def until(pilot: Pilot[None], condition: Callable[[], bool]) -> None:
    """Wait for something that a process of its own does."""
    for _ in range(int(_MOST_S / 0.1)):
        if condition():
            return
        await pilot.pause(0.1)
    raise AssertionError(screen_text(pilot.app))


def test_real_sessions_from_the_list_to_report_and_results(
    make_app: Callable[..., BenchApp], tmp_path: Path
) -> None:
    whole = stress_session("linear", 2, 100.0)
    runs = tuple(run for run in whole.runs if run.repeat == 1)
    vehicle = replace(whole.vehicle, name="[bold]T5[/]\x1b[31m")
    daq.write_session(tmp_path / "session_0001.h5", replace(whole, runs=runs, vehicle=vehicle))
    unused = tuple(replace(run, status=RunStatus.REJECTED, reasons=("cut",)) for run in runs)
    spoilt = replace(whole, runs=unused, vehicle=replace(vehicle, name="spoilt"))
    daq.write_session(tmp_path / "session_0002.h5", spoilt)  # its report has little to draw
    app = make_app(FakeRecorder())
    found: list[Outcome | None] = []

    async def act() -> None:
        async with app.run_test(size=(140, 40)) as pilot:
            await pilot.pause()
            await app.action_sessions()
            await until(pilot, lambda: "spoilt" in screen_text(app))
            assert "[bold]T5[/]\\x1b[31m" in screen_text(app)
            await pilot.press("r")
            await until(pilot, lambda: "WRITTEN   verdict refused" in screen_text(app))
            await app.action_sessions()
            await until(pilot, lambda: "reported" in screen_text(app))
            await pilot.press("down", "space")
            await until(pilot, lambda: app.screen is app.get_screen("results"))
            await pilot.pause()
            seen = screen_text(app)
            assert "6 of 6 runs used" in seen
            assert "sprung mass" in seen
            found.append(results_of(app).outcome)

    asyncio.run(act())
    _is_the_granada(found[0])
    assert "no accepted run" in (tmp_path / "session_0002.html").read_text("utf-8")
    assert (tmp_path / "session_0002.pdf").read_bytes().startswith(b"%PDF")


def _is_the_granada(outcome: Outcome | None) -> None:
    """Hold what crossed the pipe to the car of the simulation."""
    assert outcome is not None
    result = outcome.result
    for name in ("m_s", "k_sf", "c_sr"):
        e = result.parameters[name]
        assert abs(e.value - getattr(FORD_GRANADA, name)) < 6 * e.std
    assert set(result.modes) == set(result.physical) == {"baseline", "added"}
    assert result.estimation is None
    assert all(run.traces for run in outcome.runs)
