"""`--car` of `demo` and `simulate`: what is offered, what is refused, what is compared."""

from __future__ import annotations

import json
import math
import re
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import pytest

from daq.bench.campaign import Step
from daq.bench.config import default_bench_text, parse_bench
from daq.control.messages import Due
from daq.runlog.runlog import LoggedRun, LoggedStatus
from daq.runs import Excitation
from daq.sessions import Session
from daq.sim.cars import car_names
from identify import Identification
from identify.trust.finding import Judgement
from tui.cli import run
from tui.commands import demo
from tui.diagnostics import ExitCode


@pytest.mark.parametrize("command", ["demo", "simulate"])
def test_help_lists_every_car(capsys: pytest.CaptureFixture[str], command: str) -> None:
    assert run([command, "--help"]) == 0
    text = re.sub(r"\s+", "", capsys.readouterr().out)
    listed = re.search(r"Whichcar:(.*?)\.", text)
    assert listed is not None
    assert tuple(listed[1].replace("(linear)", "").split(",")) == car_names()


@pytest.mark.parametrize("command", ["demo", "simulate"])
def test_an_unknown_car_is_one_line(
    capsys: pytest.CaptureFixture[str],
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run([command, "--car", "vanagn"]) == ExitCode.BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert "--car vanagn: is unknown (did you mean vanagon" in line
    assert not list(tmp_path.iterdir())


def test_a_real_car_is_recorded_and_its_friction_stands_in_the_truth(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nothing(session: Session, progress: object) -> Identification:
        assert len(session.runs) == 2
        assert session.vehicle.name == "Ford Escort with the front right damper worn to half"
        return Identification(Judgement((), math.nan), session.provenance)

    short = default_bench_text().replace('["bounce", "pitch", "roll"]', '["bounce"]')
    short = short.replace("repeats = 2", "repeats = 1")
    monkeypatch.setattr("daq.load_bench", lambda _: parse_bench(short, "bench.toml", Path()))
    monkeypatch.setattr("identify.identify", nothing)
    run(["demo", "--car", "escort-worn", "--out", str(tmp_path / "demo"), "--json"])
    truth = json.loads(capsys.readouterr().out)["truth"]
    assert truth["m_s"] == 1094.5427
    assert truth["F_cf"] == 45.0
    assert truth["c_sf"] == pytest.approx(0.75 * 1459.39)
    assert "k_ar" not in truth  # it has no bar there


@dataclass(frozen=True)
class Shown:
    """The fields of a status that the driver of the simulated car reads."""

    t_ns: int
    runs: tuple[LoggedRun, ...] = ()
    due: Due | None = None
    halted: str = ""


def logged(step: Step, repeat: int, status: LoggedStatus) -> LoggedRun:
    return LoggedRun(step.label, step.mass_state, step.excitation, repeat, 0, status)


def bumped(statuses: list[Shown], monkeypatch: pytest.MonkeyPatch) -> list[Step]:
    """Return the bumps of a recorder that shows these statuses, the last one for ever."""
    monkeypatch.setattr(demo, "_LOOK_S", 1e-4)
    monkeypatch.setattr(demo, "_PATIENCE_S", 1e-3)
    left = list(statuses)

    def latest() -> Any:
        return left.pop(0) if len(left) > 1 else left[0]

    return list(demo.due_bumps(latest, threading.Event()))


BOUNCE, ROLL = (Step("baseline", kind, 1) for kind in (Excitation.BOUNCE, Excitation.ROLL))
TO_BOUNCE = Due(BOUNCE, 0, 1, 0, "")
REJECTED = logged(BOUNCE, 1, LoggedStatus.REJECTED)
OPEN = logged(BOUNCE, 2, LoggedStatus.OPEN)
AGAIN = logged(BOUNCE, 2, LoggedStatus.ACCEPTED)
LAST = logged(ROLL, 1, LoggedStatus.ACCEPTED)


def test_the_simulated_car_repeats_a_rejected_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits for the verdict on each run, however long the recorder lags behind."""
    shown = [
        Shown(1, (), TO_BOUNCE),
        Shown(2, (), TO_BOUNCE),
        Shown(3, (REJECTED,), TO_BOUNCE),
        Shown(4, (REJECTED, OPEN), TO_BOUNCE),
        Shown(5, (REJECTED, AGAIN), Due(ROLL, 0, 1, 0, "")),
        Shown(6, (REJECTED, AGAIN, LAST)),
    ]
    assert bumped(shown, monkeypatch) == [BOUNCE, BOUNCE, ROLL]


def test_the_simulated_car_rests_when_the_recorder_goes_on_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    halted = Shown(2, (REJECTED,), TO_BOUNCE, "wrong_mode")
    assert bumped([Shown(1, (), TO_BOUNCE), halted], monkeypatch) == [BOUNCE]
    unseen = Shown(2, (), TO_BOUNCE)  # a bump that nothing triggered
    assert bumped([Shown(1, (), TO_BOUNCE), unseen], monkeypatch) == [BOUNCE]
    stopped = threading.Event()
    stopped.set()
    steps = demo.due_bumps(lambda: cast(Any, Shown(1, (OPEN,), TO_BOUNCE)), stopped)
    assert next(steps) == BOUNCE
    assert list(steps) == []
