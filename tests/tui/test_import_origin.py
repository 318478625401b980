"""A journal that was simulated or replayed stays marked when it is imported."""

from __future__ import annotations

from pathlib import Path

import pytest

import daq
from daq.bench.origin import Origin
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
    command = ["import", *logs, "--config", str(tmp_path / "bench.toml"), "--out", str(target)]
    assert run(command) == 0, capsys.readouterr().err
    assert daq.read_session(target).provenance["origin"] == imported
