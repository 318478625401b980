"""How a campaign is recorded with and without a person; by which names sessions are compared."""

from __future__ import annotations

import json
import threading
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import pytest

from daq.bench.config import default_bench_text, parse_bench
from daq.errors import InputError
from dbc import shipped_dbc
from tui.cli import run
from tui.jobs import comparing
from tui.recorders import recording
from tui.recorders.daemon import Lifetime
from tui.recorders.log import Log
from tui.recorders.recording import record_campaign

from ..daq.a_status import a_status
from .test_tables import comparison

BENCH = parse_bench(default_bench_text(), "bench.toml", Path(), shipped_dbc())


@pytest.mark.parametrize(("arm", "pause_s"), [(True, 0.0), (False, 3.0)])
def test_runs_are_accepted_at_once_where_nobody_looks_at_them(
    arm: bool, pause_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Any] = []
    ran: list[Any] = []

    def recorder(*given: Any, **options: Any) -> str:
        made.extend((*given, options))
        return "recorder"

    def run_recorder(*given: Any) -> Any:
        ran.extend(given)
        return a_status()

    monkeypatch.setattr("daq.recorder.recorder.Recorder", recorder)
    monkeypatch.setattr(recording, "run_recorder", run_recorder)
    lifetime = Lifetime(arm, False, tmp_path / "a.prom", lambda: BENCH, stay=True)
    log = cast(Log, "log")

    def stage(done: float, text: str = "") -> None:
        """Show nothing."""

    def open_source(*_: object) -> Any:
        """Open nothing."""

    assert record_campaign(BENCH, open_source, tmp_path, lifetime, log, stage) == a_status()
    bench, folder, opener, options = made
    assert BENCH.campaign.accept_after_s == 3.0
    assert bench.campaign.accept_after_s == pause_s
    assert (folder, opener) == (tmp_path, open_source)
    assert options == {"software": f"bumpbench {version('bumpbench')}"}
    assert ran[0] == "recorder"
    assert ran[1] is bench
    assert (ran[2], ran[4], ran[5]) == (tmp_path, "log", stage)
    assert ran[3].reread().campaign.accept_after_s == pause_s
    assert (ran[3].arm, ran[3].figures, ran[3].stay) == (arm, tmp_path / "a.prom", True)
    assert isinstance(ran[3].end, threading.Event)


def test_a_channel_without_a_signal_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    wrong = default_bench_text().replace("IMU_Accel.acc_z", "IMU_Accel.acc_zz")
    bench = parse_bench(wrong, "bench.toml", Path(), shipped_dbc())
    lifetime = Lifetime(False, False, None, lambda: bench)
    with pytest.raises(InputError, match="acc_zz"):
        record_campaign(
            bench, cast(Any, None), tmp_path / "day", lifetime, cast(Any, None), cast(Any, None)
        )
    assert list(tmp_path.iterdir()) == []


def test_messages_of_the_dbc_that_cannot_be_used_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = '\nBO_ 1999 Broken: 8 X\n SG_ wide : 0|65@1+ (1,0) [0|0] "" X\n'
    bench = parse_bench(default_bench_text(), "bench.toml", Path(), shipped_dbc() + broken)
    monkeypatch.setattr("daq.recorder.recorder.Recorder", lambda *_, **__: None)
    monkeypatch.setattr(recording, "run_recorder", lambda *_: a_status())
    lifetime = Lifetime(False, False, None, lambda: bench)
    record_campaign(bench, cast(Any, None), tmp_path, lifetime, cast(Any, None), cast(Any, None))
    assert "left out: " in capsys.readouterr().err


# Comparing ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("paths", "labels"),
    [
        (["one.h5", "day/two.h5"], ["one", "two"]),
        (["mon/car.h5", "tue/car.h5"], ["mon/car", "tue/car"]),
        (["a/mon/car.h5", "b/mon/car.h5"], ["a/mon/car.h5", "b/mon/car.h5"]),
        (["mon/car.h5", "mon/car.h5"], ["mon/car.h5", "mon/car.h5"]),
    ],
)
def test_sessions_are_named_as_shortly_as_tells_them_apart(
    paths: list[str],
    labels: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    given: list[Any] = []

    def compare(names: list[str], results: list[Any]) -> Any:
        given.extend((names, results))
        return comparison(2)

    monkeypatch.setattr("identify.compare.compare", compare)
    monkeypatch.setattr(comparing, "identified", lambda files, _: files)
    assert run(["compare", *paths, "--json"]) == 0
    assert given == [labels, paths]
    assert json.loads(capsys.readouterr().out)["verdicts"] == ["ok", "doubtful"]


def test_a_comparison_with_a_session_that_is_refused_is_exit_1(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = comparison(2, verdicts=("ok", "refused"))
    monkeypatch.setattr("identify.compare.compare", lambda *_: made)
    monkeypatch.setattr(comparing, "identified", lambda *_: [])
    assert run(["compare", "a.h5", "b.h5"]) == 1
