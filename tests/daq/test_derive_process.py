"""The process that derives a session file, where the host allows it little."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path

import pytest

from daq.journal.derive import DONE, main
from daq.journal.folder import segments_in

from .crash_derive import journal_of_runs


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
