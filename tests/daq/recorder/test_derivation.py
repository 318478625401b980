"""The process that derives a session file, where the host allows it little."""

from __future__ import annotations

import io
import json
import os
import threading
from pathlib import Path

import pytest

from daq.control.messages import SessionState, SessionStatus
from daq.derive.build_session import BAD_INPUT, DONE, main
from daq.journal.folder import segments_in
from daq.recorder import derivation
from daq.recorder.derivation import Derivation

from ..crash_derive import journal_of_runs


def refused(_: int) -> int:
    raise PermissionError(1, "Operation not permitted")


def test_a_service_that_may_not_be_nice_derives_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "nice", refused)
    journal_of_runs(tmp_path, 160_000)
    said = io.StringIO()
    target = tmp_path / "session.h5"
    gone = tmp_path / "journal_9999.mcap"  # retention was faster
    code = main([str(target), *map(str, segments_in(tmp_path)), str(gone)], said)
    assert (code, json.loads(said.getvalue())["loss"]) == (DONE, "")
    assert target.exists()
    score = Path("/proc/self/oom_score_adj")  # it ends before the recorder if the memory runs out
    assert not score.exists() or int(score.read_text("ascii")) >= 500


def test_a_reason_names_its_file_once(tmp_path: Path) -> None:
    """The status has the path of the session beside the reason; other files are in the reason."""
    (journal := tmp_path / "journal").mkdir()
    journal_of_runs(journal, 160_000)
    segments = list(map(str, segments_in(journal)))
    no_folder = tmp_path / "none" / "session.h5"
    said = io.StringIO()
    assert main([str(no_folder), *segments], said) == BAD_INPUT
    assert json.loads(said.getvalue())["error"] == "cannot be written: No such file or directory"
    (foreign := tmp_path / "journal_0001.mcap").write_text("mine")
    said = io.StringIO()
    assert main([str(tmp_path / "session.h5"), str(foreign)], said) == BAD_INPUT
    assert json.loads(said.getvalue())["error"].startswith(f"{foreign}: ")


def test_a_process_that_hangs_is_ended_and_the_next_one_has_its_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal_of_runs(tmp_path, 160_000)
    hanging = tmp_path / "hanging"
    hanging.write_text("#!/bin/sh\nexec sleep 1000\n", "ascii")
    hanging.chmod(0o700)
    first, second = tmp_path / "first.h5", tmp_path / "second.h5"
    under_way = Derivation()
    with monkeypatch.context() as patch:
        patch.setattr("sys.executable", str(hanging))
        patch.setattr(derivation, "PATIENCE_S", 0.0)
        patch.setattr(derivation, "SLOWEST_BYTES_PER_S", float("inf"))
        under_way.begin(first, segments_in(tmp_path), "one", 7)
    assert under_way.status == SessionStatus(SessionState.BUILDING, str(first), "", "one", 7)
    under_way.poll()
    text = "it took too long and was ended: check the disk"
    assert under_way.status == SessionStatus(SessionState.FAILED, str(first), text, "one", 7)
    under_way.begin(second, segments_in(tmp_path), "one", 7)
    seen = [under_way.status]
    pause = threading.Event()
    while under_way.status.state is SessionState.BUILDING:
        under_way.poll()
        pause.wait(0.01)
        if under_way.status != seen[-1]:
            seen.append(under_way.status)
    assert [status.state for status in seen] == [SessionState.BUILDING, SessionState.READY]
    assert second.exists()
