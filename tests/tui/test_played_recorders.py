"""Recorders of demonstrations: what they record, how they live, and what they refuse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from daq import write_session
from daq.bench.campaign import Origin
from daq.bench.config import RecorderConfig
from daq.bus.source import HopLosses
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from tui.cli import run
from tui.commands.demo import begun_anew
from tui.invocation import invoke
from tui.recorders.daemon import Lifetime
from tui.recorders.played import commands

from ..daq.crash_derive import journal_of_runs
from ..daq.crash_frames import QuickFile
from ..daq.small_campaign import bumps, small_bench, small_codec
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


def test_a_replay_is_armed_goes_on_and_stays_for_its_terminal(
    tmp_path: Path, recorded: Recorded
) -> None:
    journal_of_runs(tmp_path / "journal", 8_000)
    assert run(["recover", str(tmp_path)]) == 0
    paths = (tmp_path / "replay", tmp_path / "session_0001.h5", "--log", tmp_path / "a.log")
    assert invoke(["replay", *map(str, paths)], commands) == 0
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
    assert invoke(["demo", str(tmp_path), *options], commands) == 2
    assert said in capsys.readouterr().err
    assert recorded == []


def test_a_session_that_no_recorder_made_is_not_replayed(
    tmp_path: Path, recorded: Recorded, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "s.h5"
    write_session(session, refused_session(1))
    assert invoke(["replay", str(tmp_path), str(session)], commands) == 2
    said = capsys.readouterr().err
    assert f"{session}: does not hold its bench.toml and DBC" in said
    for speed in ("0.09", "20.1"):
        words = ["replay", str(tmp_path), str(session), "--speed", speed]
        assert invoke(words, commands) == 2
        assert "--speed" in capsys.readouterr().err
    assert recorded == []


@pytest.mark.parametrize("ended", [True, False])
def test_a_demonstration_does_not_go_on_with_one_that_was_interrupted(
    ended: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = small_bench()
    head = JournalHead(bench.text, bench.dbc_text, "test", 1, 0, "ab" * 16)
    folder = tmp_path / "demo"
    writer = JournalWriter(folder / "journal", head, RecorderConfig(), QuickFile)
    writer.append(bumps(small_codec(), 1), HopLosses())
    writer.close(ended=ended)
    again = tmp_path / "demo-2"
    assert begun_anew(folder) == (folder if ended else again)
    assert (str(again) in capsys.readouterr().err) is not ended
