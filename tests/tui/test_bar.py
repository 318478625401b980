"""The bar of progress at a terminal, and the planner's process of the terminal."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from daq.bench.config import default_bench_text
from daq.journal.format import JournalHead
from daq.journal.writer import JournalWriter
from dbc import shipped_dbc
from tui.cli import run
from tui.jobs import gain
from tui.jobs.gain import GAIN, Gain

from ..daq.crash_frames import journal_of_runs

# The planner's process ----------------------------------------------------------------------------


@pytest.fixture
def planned(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Return the benches whose gain was asked for."""
    benches: list[Any] = []

    def expected(bench: Any) -> Gain:
        benches.append(bench)
        return Gain(worst=0.5, widest="m_s")

    monkeypatch.setattr(gain, "expected_gain", expected)
    return benches


def answered(
    text: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Gain:
    question = json.dumps({"bench": text, "folder": str(folder)})
    monkeypatch.setattr(sys, "stdin", io.StringIO(question))
    assert gain.main() == 0
    return GAIN.validate_json(capsys.readouterr().out)


def test_the_planner_reads_the_database_of_the_newest_recording(
    planned: list[Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = answered(default_bench_text(), tmp_path, monkeypatch, capsys)
    assert answer == Gain(worst=0.5, widest="m_s")
    assert planned[0].dbc_text == shipped_dbc()
    one, two = (f'{shipped_dbc()}CM_ "{n}";\n' for n in (1, 2))
    for recording, dbc_text in (("a", one), ("b", two)):
        head = JournalHead("", dbc_text, "test", 0, 0, recording * 32)
        JournalWriter(tmp_path / "journal", head).close()
    (tmp_path / "journal" / "journal_0003.bbj").write_bytes(b"cut off in its head")
    answered(default_bench_text(), tmp_path, monkeypatch, capsys)
    assert planned[1].dbc_text == two, "the third segment was cut off in its head"


def test_the_planner_says_what_is_wrong_with_the_bench(
    planned: list[Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    answer = answered("[campaign]\nrepeats = 0\n", tmp_path, monkeypatch, capsys)
    assert answer.error.startswith("bench.toml:2")
    assert planned == []


def test_segments_that_are_named_one_by_one_are_recovered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    segments = journal_of_runs(tmp_path / "journal", 8_000)
    assert run(["recover", *map(str, sorted((tmp_path / "journal").glob("*.bbj"))), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["frames_recorded"] == 8_000
    assert document["session"] == str(tmp_path / "session_0001.h5")
    assert segments
    assert run(["recover", str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"session: {tmp_path / 'session_0001.h5'}"
