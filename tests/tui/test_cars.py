"""`--car` of `demo` and `simulate`: what is offered, what is refused, what is compared."""

from __future__ import annotations

import json
import math
import re
import threading
from pathlib import Path

import pytest

from daq.bench.config import default_bench_text, parse_bench
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


def test_a_recorder_that_lags_behind_the_car_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo, "_PATIENCE_S", 0.001)
    stamps = [100, 200, 300, 300, 400]
    left = list(stamps)
    demo._wait_for_the_last(lambda: left.pop(0), threading.Event())
    assert left == [400]  # two alike: no frame came in between
    stopped = threading.Event()
    stopped.set()
    left = list(stamps)
    demo._wait_for_the_last(lambda: left.pop(0), stopped)
    assert left == stamps[1:]
