"""Recorders of demonstrations: what they record, how they live, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daq import write_session
from daq.bench.origin import Origin
from tui.cli import run
from tui.invocation import invoke
from tui.recorders import demo, replay
from tui.recorders.daemon import Lifetime

from ..daq.a_status import a_status
from ..daq.crash_derive import journal_of_runs
from .batches import refused_session

Recorded = list[tuple[Any, Any, Path, Lifetime]]


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """Return bench, opener of buses, folder and lifetime of what would be recorded."""
    seen: Recorded = []

    def record_campaign(
        bench: Any, open_source: Any, out: Path, lifetime: Lifetime, *_: object
    ) -> None:
        seen.append((bench, open_source, out, lifetime))

    monkeypatch.setattr("tui.recorders.recording.record_campaign", record_campaign)
    return seen


def lives(lifetime: Lifetime) -> tuple[bool, bool, bool, bool]:
    return lifetime.arm, lifetime.keep_on, lifetime.stay, lifetime.attended


def test_a_demonstration_is_a_simulated_bench_that_a_terminal_arms(
    tmp_path: Path, recorded: Recorded
) -> None:
    words = [str(tmp_path / "demo"), "--speed", "2", "--log", str(tmp_path / "a.log")]
    assert invoke([*words, "--fault", "unplug"], demo.commands) == 0
    ((bench, _, folder, lifetime),) = recorded
    assert folder == tmp_path / "demo"
    assert bench.origin is Origin.SIMULATED
    assert lifetime.reread().origin is Origin.SIMULATED
    assert lives(lifetime) == (False, True, False, True)
    assert lifetime.follow is not None


def test_a_replay_is_armed_goes_on_and_stays_for_its_terminal(
    tmp_path: Path, recorded: Recorded
) -> None:
    journal_of_runs(tmp_path / "journal", 8_000)
    assert run(["recover", str(tmp_path)]) == 0
    words = [
        str(tmp_path / "replay"),
        str(tmp_path / "session_0001.h5"),
        "--log",
        str(tmp_path / "a.log"),
    ]
    assert invoke(words, replay.commands) == 0
    ((bench, open_source, folder, lifetime),) = recorded
    assert folder == tmp_path / "replay"
    assert bench.origin is Origin.REPLAYED
    assert lifetime.reread() is bench
    assert [(bus.interface, bus.channel) for bus in bench.buses] == [("virtual", "session0")]
    assert lives(lifetime) == (True, True, True, True)
    source = open_source(bench.buses[0], 0)
    assert source.read(0.0) is not None
    source.close()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fault", "wheels-off"], "--fault wheels-off: is unknown"),
        (["--speed", "0.09"], "--speed"),
        (["--speed", "20.1"], "--speed"),
    ],
)
def test_a_demonstration_refuses_what_it_does_not_know(
    options: list[str],
    said: str,
    tmp_path: Path,
    recorded: Recorded,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert invoke([str(tmp_path), *options], demo.commands) == 2
    assert said in capsys.readouterr().err
    assert recorded == []


def test_a_session_that_no_recorder_made_is_not_replayed(
    tmp_path: Path, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "s.h5"
    write_session(session, refused_session(1))
    assert invoke([str(tmp_path), str(session)], replay.commands) == 2
    said = capsys.readouterr().err
    assert f"{session}: does not hold its bench.toml and DBC" in said
    for speed in ("0.09", "20.1"):
        assert invoke([str(tmp_path), str(session), "--speed", speed], replay.commands) == 2
        assert "--speed" in capsys.readouterr().err
    assert recorded == []


def test_a_demonstration_simulates_what_was_asked_for(
    tmp_path: Path, recorded: Recorded, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[tuple[Any, ...]] = []

    class Simulated:
        def __init__(self, *given: Any) -> None:
            made.append(given)

        def open(self) -> str:
            return "the car's"

        def other(self, number: int) -> str:
            return f"other {number}"

    monkeypatch.setattr("daq.sim.SimulatedBench", Simulated)
    bench = tmp_path / "bench.toml"
    bench.write_text('[vehicle]\nname = "T5"\n')
    words = [str(tmp_path / "demo"), "--bench", str(bench), "--log", str(tmp_path / "a.log")]
    assert invoke([*words, "--speed", "2", "--fault", "unplug"], demo.commands) == 0
    ((described, _, _, seed, speed, latest, fault, _),) = made
    assert (described.vehicle.name, described.origin) == ("T5", Origin.SIMULATED)
    assert (seed, speed, fault) == (1, 2.0, "unplug")
    ((_, open_source, _, lifetime),) = recorded
    assert open_source(described.bus, 0) == "the car's"
    assert open_source(described.bus, 2) == "other 2"
    assert latest() is None
    assert lifetime.follow is not None
    for status in (a_status(1), a_status(2)):
        lifetime.follow(status)
        assert latest() is status
    assert lifetime.reread().vehicle.name == "T5"
    assert invoke(words, demo.commands) == 0
    assert (made[1][4], made[1][6]) == (1.0, None)
