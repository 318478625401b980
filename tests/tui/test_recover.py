"""`bumpbench recover` on folders, whole and torn journals."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from daq import write_session
from daq.journal.reader import segments_in
from tests.daq.crash_frames import journal_of_runs
from tests.daq.small_campaign import LABELS
from tests.daq.small_session import small_session
from tui.cli import run

from .conftest import answered

N_FRAMES = 40_000


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a journal of four runs in several segments, which no test changes."""
    folder = tmp_path_factory.mktemp("recorded") / "journal"
    assert len(journal_of_runs(folder, N_FRAMES)) > 2
    return folder


@pytest.fixture
def journal(recorded: Path, tmp_path: Path) -> Path:
    """Return a copy of the journal, as that of a recorder's folder."""
    return Path(shutil.copytree(recorded, tmp_path / "journal"))


def test_a_folder_is_recovered_beside_its_journal(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reported, _ = answered(capsys, "recover", str(tmp_path))
    assert reported["session"] == str(tmp_path / "session_0001.h5")
    assert [one["label"] for one in reported["runs"]] == LABELS
    assert (reported["frames_recorded"], reported["loss"]) == (N_FRAMES, "")
    segments = list(map(str, segments_in(journal)))
    assert run(["recover", *segments, "--out", str(tmp_path / "same.h5")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"session: {tmp_path / 'same.h5'}"


def _tear(segments: tuple[Path, ...]) -> str:
    """Cut the end off the second segment."""
    segments[1].write_bytes(segments[1].read_bytes()[:-20_000])
    return f"{segments[1].name}: its last "


def _overwrite(segments: tuple[Path, ...]) -> str:
    """Overwrite the last segment whole."""
    segments[-1].write_bytes(b"\xa5" * 80_000)
    return f"{segments[-1].name}: its last 80,000 bytes are no whole block"


def _behead(segments: tuple[Path, ...]) -> str:
    """Overwrite the first bytes of each segment, which reading does not need."""
    for path in segments:
        path.write_bytes(b"\xa5" * 8 + path.read_bytes()[8:])
    return ""


@pytest.mark.parametrize("damage", [_tear, _overwrite, _behead])
def test_a_loss_is_counted_with_its_place_and_is_exit_3(
    damage: Callable[[tuple[Path, ...]], str],
    journal: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    loss = damage(segments_in(journal))
    reported, _ = answered(capsys, "recover", str(tmp_path), code=(3 if loss else 0))
    assert loss in reported["loss"]
    assert bool(reported["loss"]) is bool(loss)
    assert loss or [one["label"] for one in reported["runs"]] == LABELS


def test_two_recordings_make_two_sessions_that_are_not_written_over_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recorders of two folders both begin with session_0001.h5; the second was all that was."""
    for name in ("a", "b"):
        recording = f"{name}d" * 16
        journal_of_runs(tmp_path / name / "journal", 8000, recording=recording)
    both = [str(tmp_path / "a"), str(tmp_path / "b")]
    assert run(["recover", *both, "--out", str(tmp_path)]) == 2
    assert "session_0001.h5: would be the session of two recordings" in capsys.readouterr().err
    assert run(["recover", *both, "--out", str(tmp_path / "s.h5")]) == 2
    assert "would be the session of two recordings" in capsys.readouterr().err
    assert list(tmp_path.glob("*.h5")) == []
    sessions = answered(capsys, "recover", *both)[0]["sessions"]
    assert [session["frames_recorded"] for session in sessions] == [8000, 8000]
    assert [(tmp_path / f / "session_0001.h5").is_file() for f in "ab"] == [True, True]


def _recovered(folder: Path, *more: str) -> int:
    return run(["recover", str(folder), "--out", str(folder / "s.h5"), *more])


def test_a_session_is_kept_where_the_journal_has_less(
    journal: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its end is not missed by the blocks before it, but the last runs are."""
    assert _recovered(tmp_path) == 0
    before = (tmp_path / "s.h5").read_bytes()
    for last in segments_in(journal)[1:]:
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


@pytest.mark.usefixtures("journal")
def test_a_file_of_something_else_is_not_recovered_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "s.h5"
    for write in (
        lambda: target.write_text("my notes"),
        lambda: write_session(target, small_session()),
    ):
        write()
        before = target.read_bytes()
        assert _recovered(tmp_path) == 2
        assert "s.h5: exists already, " in capsys.readouterr().err
        assert target.read_bytes() == before
    assert _recovered(tmp_path, "--force") == 0
