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


def test_an_exported_log_keeps_its_origin_with_another_bench(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = tmp_path / "bench.toml"
    bench.write_text(BENCH)
    first, log, second = (str(tmp_path / name) for name in ("first.h5", "car.log", "second.h5"))
    assert (
        run(["import", journal(tmp_path, Origin("simulated"), 0), str(bench), "--out", first]) == 0
    )
    assert run(["export", first, "--out", log]) == 0
    bench.write_text(BENCH + "sign = -1\n")
    assert run(["import", log, str(bench), "--out", second]) == 0, capsys.readouterr().err
    assert daq.read_session(Path(second)).provenance["origin"] == "simulated"
