"""The campaigns of `make crash` against the whole `bumpbench record`, short."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..daq.crash_broken import fail_once, fill_once
from ..daq.crash_kills import kill_series


def test_a_killed_recorder_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    done = kill_series(tmp_path / "kills", 1, np.random.default_rng(8), hot=False)
    assert done.read > done.acknowledged > 0


def test_a_failing_operation_costs_the_recorder_no_frame(tmp_path: Path) -> None:
    assert fail_once(tmp_path / "failure", "short", 9) > 0


def test_a_full_disk_costs_the_recorder_only_what_it_says(tmp_path: Path) -> None:
    full = fill_once(tmp_path / "full", 100_000, drops=True, mount=False)
    assert full.sent > full.dropped > 0
    assert full.resumed_s < 5.0
