"""What was simulated or replayed stays marked when its journal or its exported log is imported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import daq
from daq.bench.campaign import Origin
from daq.bus.source import HopLosses
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from tui.cli import run

from ..daq.crash_disk import QuickFile
from ..daq.small_campaign import START_NS, blocks, bumps, small_codec
from .test_import import BENCH, write_log


def journal(folder: Path, origin: Origin, bump: int) -> str:
    frames = bumps(small_codec(), 2)
    head = JournalHead("", "", "test", START_NS, 0, str(bump) * 32, origin=origin)
    with JournalWriter(folder, head, create=QuickFile) as writer:
        for part in blocks(frames.select(slice(1200 * bump, 1200 * (bump + 1)))):
            writer.append(part, HopLosses())
    return str(writer.paths[0])


@pytest.mark.parametrize(
    ("origins", "imported"),
    [
        (["real"], "real"),
        (["simulated"], "simulated"),
        (["log", "replayed"], "replayed"),
    ],
)
def test_the_origin_of_a_journal_is_that_of_the_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], origins: list[str], imported: str
) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    logs = []
    for bump, origin in enumerate(origins):
        if origin == "log":
            logs.append(str(write_log(tmp_path / "a.log", bumps(small_codec(), 1))))
        else:
            logs.append(journal(tmp_path / str(bump), Origin(origin), bump))
    target = tmp_path / "out.h5"
    command = ["import", *logs, str(tmp_path / "bench.toml"), "--out", str(target)]
    assert run(command) == 0, capsys.readouterr().err
    assert daq.read_session(target).provenance["origin"] == imported


@pytest.mark.parametrize("form", ["log", "asc", "blf", "mf4"])
def test_the_origin_of_an_exported_log_is_that_of_its_session(tmp_path: Path, form: str) -> None:
    (tmp_path / "bench.toml").write_text(BENCH)
    bench, first = str(tmp_path / "bench.toml"), tmp_path / "first.h5"
    log = str(write_log(tmp_path / "all.log", bumps(small_codec(), 2)))
    assert run(["import", log, bench, "--out", str(first)]) == 0
    measured = daq.read_session(first)
    for origin in Origin:
        session = replace(measured, provenance={**measured.provenance, "origin": str(origin)})
        daq.write_session(tmp_path / f"{origin}.h5", session)
        exported, again = str(tmp_path / f"{origin}.{form}"), tmp_path / f"{origin}_again.h5"
        assert run(["export", str(tmp_path / f"{origin}.h5"), "--out", exported]) == 0
        assert run(["import", exported, bench, "--out", str(again)]) == 0
        returned = daq.read_session(again)
        assert returned.provenance["origin"] == origin
        assert len(returned.runs) == len(measured.runs)
