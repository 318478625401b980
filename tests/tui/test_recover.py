"""`bumpbench recover` on folders, whole and torn journals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from daq import write_session
from daq.journal.reader import read_journal, segments_in
from tests.daq.crash_frames import journal_of_runs
from tests.daq.small_campaign import LABELS
from tests.daq.small_session import small_session
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
    segments = list(map(str, segments_in(tmp_path / "journal")))
    assert run(["recover", *segments, "--out", str(tmp_path / "same.h5")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"session: {tmp_path / 'same.h5'}"


def test_a_loss_is_reported_exactly_and_is_exit_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 40_000)
    first, second, *_ = segments_in(tmp_path / "journal")
    second.write_bytes(second.read_bytes()[:-20_000])
    assert run(["recover", str(tmp_path / "journal")]) == 3
    reported = capsys.readouterr().err
    assert second.name in reported
    assert "are no whole block" in reported
    assert (tmp_path / "session_0001.h5").is_file()
    assert first.is_file()


def test_a_flipped_bit_is_harmless_or_counted_and_whole_blocks_come_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 8000)
    segments = segments_in(tmp_path / "journal")
    recorded = read_journal(segments).frames.t_ns
    command = ["recover", str(tmp_path), "--force", "--json"]
    assert run(command) == 0
    session = (tmp_path / "session_0001.h5").read_bytes()
    capsys.readouterr()
    rng = np.random.default_rng(41)
    for k in range(4):
        path = segments[rng.integers(len(segments))]
        content = path.read_bytes()
        changed = bytearray(content)  # every second in what a segment needs to be read
        changed[rng.integers(9_000 if k % 2 else len(content))] ^= 1 << int(rng.integers(8))
        path.write_bytes(changed)
        code = run(command)
        assert code == (3 if json.loads(capsys.readouterr().out)["loss"] else 0)
        frames = read_journal(segments).frames.t_ns
        assert np.isin(frames, recorded).all()
        assert len(recorded) - len(frames) in ((0,) if code == 0 or k % 2 else (0, 1600))
        if code == 0:
            assert (tmp_path / "session_0001.h5").read_bytes() == session
        path.write_bytes(content)


def test_a_segment_whose_first_bytes_are_overwritten_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 40_000)
    for path in segments_in(tmp_path / "journal"):
        path.write_bytes(b"\xa5" * 8 + path.read_bytes()[8:])
    assert run(["recover", str(tmp_path), "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert [one["label"] for one in reported["runs"]] == LABELS


def test_a_segment_that_cannot_be_read_is_a_counted_loss(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal_of_runs(tmp_path / "journal", 40_000)
    *_, last = segments_in(tmp_path / "journal")
    last.write_bytes(b"\xa5" * 80_000)
    assert run(["recover", str(tmp_path), "--json"]) == 3
    loss = json.loads(capsys.readouterr().out)["loss"]
    assert f"{last.name}: its last 80,000 bytes are no whole block" in loss


def test_two_recordings_make_two_sessions_and_no_single_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = journal_of_runs(tmp_path / "a", 40_000)
    journal_of_runs(tmp_path / "a", 20_000, recording="cd" * 16)
    assert run(["recover", str(tmp_path / "a"), "--out", str(tmp_path / "s.h5")]) == 2
    assert "would be the session of two recordings" in capsys.readouterr().err
    assert run(["recover", str(tmp_path / "a"), "--out", str(tmp_path), "--json"]) == 0
    sessions = json.loads(capsys.readouterr().out)["sessions"]
    assert [session["frames_recorded"] for session in sessions] == [40_000, 20_000]
    assert len(one) > 1
    assert len(list(tmp_path.glob("session_*.h5"))) == 2


def test_two_recordings_whose_sessions_have_one_name_are_not_written_over_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recorders of two folders both begin with session_0001.h5; the second was all that was."""
    journal_of_runs(tmp_path / "a" / "journal", 20_000)
    journal_of_runs(tmp_path / "b" / "journal", 20_000, recording="cd" * 16)
    both = [str(tmp_path / "a"), str(tmp_path / "b")]
    assert run(["recover", *both, "--out", str(tmp_path)]) == 2
    assert "session_0001.h5: would be the session of two recordings" in capsys.readouterr().err
    assert list(tmp_path.glob("*.h5")) == []
    assert run(["recover", *both]) == 0
    assert [(tmp_path / f / "session_0001.h5").is_file() for f in "ab"] == [True, True]


def test_a_folder_without_a_journal_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["recover", str(tmp_path)]) == 2
    assert "has no journal_*.bbj" in capsys.readouterr().err


def test_a_journal_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["recover", str(tmp_path / "absent")]) == 2
    text = capsys.readouterr().err
    assert "absent: there is no such file or folder" in text
    assert text.count("\n") == 1


def _recovered(folder: Path, *more: str) -> int:
    return run(["recover", str(folder), "--out", str(folder / "s.h5"), *more])


@pytest.mark.parametrize("spoilt", [0, -1], ids=["torn", "without its end"])
def test_a_session_is_kept_where_the_journal_has_less(
    tmp_path: Path, spoilt: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its end is not missed by the blocks before it, but the last runs are."""
    journal_of_runs(tmp_path / "journal", 40_000)
    assert _recovered(tmp_path) == 0
    before = (tmp_path / "s.h5").read_bytes()
    segment = segments_in(tmp_path / "journal")[spoilt]
    if spoilt == 0:
        segment.write_bytes(segment.read_bytes()[:-20_000])
    else:
        for last in segments_in(tmp_path / "journal")[1:]:
            last.unlink()
    capsys.readouterr()
    assert _recovered(tmp_path) == 2
    said = capsys.readouterr().err
    assert "s.h5: exists already, and has more of " in said
    assert "_1 than the journal now (name another file with --out, or use --force)" in said
    assert said.count("\n") == 1
    assert (tmp_path / "s.h5").read_bytes() == before
    assert _recovered(tmp_path, "--force") in (0, 3)
    assert (tmp_path / "s.h5").read_bytes() != before
    assert _recovered(tmp_path) in (0, 3), "this one is all that is left"


@pytest.mark.parametrize("other", ["session", "text"])
def test_a_file_of_something_else_is_not_recovered_over(
    tmp_path: Path, other: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (target := tmp_path / "s.h5").write_text("my notes")
    if other == "session":
        write_session(target, small_session())
    before = target.read_bytes()
    journal_of_runs(tmp_path / "journal", 40_000)
    assert _recovered(tmp_path) == 2
    assert "s.h5: exists already, " in capsys.readouterr().err
    assert target.read_bytes() == before
    assert _recovered(tmp_path, "--force") == 0
