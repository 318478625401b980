"""The terminal on the real recorder: a campaign by SPACE alone, its replay, and faults."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import pytest

from daq import read_session
from daq.control.messages import Phase, SessionState
from daq.replay import whole_frames
from daq.runs import RunStatus
from dbc.words import InputError
from tui.recorders.process import start_recorder
from tui.terminal.app import BenchApp
from tui.terminal.campaign import BenchStep, progress

from .bench_terminal import (
    demo_bench,
    seat,
    terminal_on,
    wait_for_recorder,
)

KINDS = 6
SPEED = 2.0
"""Seconds of the car in one of ours: each costs CPU, also while the operator reads."""
RECORDING = ["Vehicle", "Check", "Home", "Masses", "Home", "Identify"]
RESULTS = ["Identify", "Results"]


def _has_session_of_all_runs(app: BenchApp) -> bool:
    """Return True if the last file is built; the one of the runs before may be ready already."""
    status = app.status
    return status is not None and status.session.state is SessionState.READY and not status.outdated


def campaign_by_space(folder: Path, runs: int, bumps: str = "") -> Path:
    """Record a campaign, pressing SPACE whenever the screen says so; return the session."""

    async def act() -> Path:
        app = terminal_on(bench.folder)
        async with seat(app) as operator:
            await operator.until(
                lambda: operator.went_through()[-1:] == RECORDING[-1:], operator.space_if_offered
            )
            await operator.until(operator.sees(f"{runs} runs accepted"))
            met = operator.went_through()
            assert (met[1:] if met[0] == "Home" else met) == RECORDING  # home while it connects
            status = app.status
            assert status is not None
            assert [run.status for run in status.runs].count(RunStatus.ACCEPTED) == runs
            await operator.until(lambda: _has_session_of_all_runs(app), operator.space_if_offered)
            assert app.status is not None
            return Path(app.status.session.path)

    with demo_bench(folder, SPEED, bumps=bumps) as bench:
        bench.started()
        return asyncio.run(act())


def results_by_space(folder: Path, session: Path) -> Path:
    """Play a session to a terminal, then press SPACE until its report is there; return that."""

    async def act() -> Path:
        app = terminal_on(folder)
        async with seat(app, (140, 40)) as operator:
            await operator.until(lambda: app.status is not None and not app.status.due)
            assert app.status is not None
            assert len(app.status.runs) == KINDS
            await operator.until(operator.sees("SPACE = step 6 Identify"))
            # The recording stays with the terminal: its runs are there to be identified.
            await operator.until(lambda: app.step is BenchStep.IDENTIFY, operator.space_if_offered)
            await operator.until(operator.sees(f"{KINDS} runs accepted"))
            await operator.until(
                lambda: "WRITTEN   verdict ok" in operator.text, operator.space_if_offered
            )
            await operator.until(lambda: progress(app.status).done == frozenset(BenchStep))
            assert app.step is BenchStep.REPORT
            assert operator.went_through()[-2:] == RESULTS
            return Path(app.status.session.path).with_suffix(".html")

    player = start_recorder(folder, "--replay", str(session), "--speed", f"{10.0 * SPEED:g}")
    try:
        wait_for_recorder(player, folder)
        return asyncio.run(act())
    finally:
        player.kill()
        player.wait()


def test_a_campaign_by_space_alone(tmp_path: Path) -> None:
    session = campaign_by_space(tmp_path, 2, '["bounce"]')
    assert [run.label for run in read_session(session).runs] == [
        "baseline_bounce_1",
        "added_bounce_1",
    ]
    alone = tmp_path / "alone.h5"  # what lay between the runs is in the journal only
    shutil.copy(session, alone)
    with pytest.raises(InputError, match="next to its journal"):
        whole_frames(read_session(alone), alone)


@pytest.mark.long
def test_a_campaign_by_space_and_from_its_replay_to_the_report(tmp_path: Path) -> None:
    session = campaign_by_space(tmp_path, KINDS)
    recorded = read_session(session)
    assert len(recorded.runs) == KINDS
    report = results_by_space(tmp_path / "replayed", session)
    assert recorded.vehicle.name in report.read_text("utf-8")


SAID = {
    "double-bump": ("DOUBLE BUMP", "bump once"),
    "lost-frames": ("LOST FRAMES", "cable and plugs"),
    "unplug": ("BUS LOST", "plug the bus in"),
}
"""Words of the banner, and a word of its advice."""


@pytest.mark.parametrize(
    "fault",
    [
        "unplug",
        pytest.param("double-bump", marks=pytest.mark.long),
        pytest.param("lost-frames", marks=pytest.mark.long),
    ],
)
def test_a_fault_is_named_and_the_campaign_goes_on(fault: str, tmp_path: Path) -> None:
    why, todo = SAID[fault]

    async def act() -> None:
        app = terminal_on(bench.folder)
        async with seat(app, (140, 40)) as operator:

            def is_rejected() -> bool:
                return app.status is not None and app.status.phase is Phase.REJECTED

            await operator.until(operator.sees("SPACE starts"))
            await operator.pilot.press("space")
            await operator.until(lambda: is_rejected() and "REJECTED" in operator.text)
            banner = operator.text
            assert f"{why}: " in banner
            assert todo in banner.lower()
            await operator.until(lambda: bool(app.status and app.status.tallies[0].accepted >= 2))
            assert app.status is not None
            assert app.status.runs[1].status is RunStatus.REJECTED
            await operator.until(operator.sees("baseline bounce 2  rejected"))

    with demo_bench(tmp_path, SPEED, 3, fault) as bench:
        bench.started()
        bench.skip_to_bumps()
        asyncio.run(act())
