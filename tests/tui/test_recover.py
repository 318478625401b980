"""`bumpbench recover` on folders, whole and torn journals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from daq.journal.folder import segments_in
from tests.daq.crash_derive import journal_of_runs
from tests.daq.small_campaign import LABELS
from tui.cli import run


def test_a_folder_is_recovered_beside_its_journal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 40_000)
    assert run(["recover", str(tmp_path), "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["session"] == str(tmp_path / "session_0001.h5")
    assert [one["label"] for one in reported["runs"]] == LABELS
    assert (reported["frames_recorded"], reported["loss"]) == (40_000, "")


def test_a_loss_is_reported_exactly_and_is_exit_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 40_000)
    first, second, *_ = segments_in(tmp_path / "journal")
    second.write_bytes(second.read_bytes()[:-1000])
    assert run(["recover", str(tmp_path / "journal")]) == 3
    reported = capsys.readouterr().err
    assert second.name in reported
    assert "bytes torn" in reported
    assert (tmp_path / "session_0001.h5").is_file()
    assert first.is_file()


def test_two_recordings_make_two_sessions_and_no_single_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = journal_of_runs(tmp_path / "a", 40_000)
    journal_of_runs(tmp_path / "b", 20_000, recording="cd" * 16)
    for path in segments_in(tmp_path / "b"):
        path.rename(tmp_path / "a" / path.name.replace("_0", "_1"))
    assert run(["recover", str(tmp_path / "a"), "--out", str(tmp_path / "s.h5")]) == 2
    assert "2 recordings for one file" in capsys.readouterr().err
    assert run(["recover", str(tmp_path / "a"), "--out", str(tmp_path), "--json"]) == 0
    sessions = json.loads(capsys.readouterr().out)["sessions"]
    assert [session["frames_recorded"] for session in sessions] == [40_000, 20_000]
    assert len(one) > 1


def test_a_folder_without_a_journal_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["recover", str(tmp_path)]) == 2
    assert "has no journal_*.mcap" in capsys.readouterr().err


def test_a_journal_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["recover", str(tmp_path / "absent")]) == 2
    text = capsys.readouterr().err
    assert "absent: there is no such file or folder" in text
    assert text.count("\n") == 1
