"""The campaigns of `make crash` against the whole `bumpbench record`, short."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ..daq.crash import CAMPAIGNS, fail_once, fill_once
from ..daq.crash_process import kill_series


def test_a_killed_recorder_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    done = kill_series(tmp_path / "kills", 1, np.random.default_rng(8), hot=False)
    assert done.read > done.acknowledged > 0


def test_a_failing_operation_costs_the_recorder_no_frame(tmp_path: Path) -> None:
    assert fail_once(tmp_path / "failure", "short", 9) > 0


def test_a_full_disk_costs_the_recorder_only_what_it_says(tmp_path: Path) -> None:
    full = fill_once(tmp_path / "full", 100_000, drops=True, mount=False)
    assert full.sent > full.dropped > 0
    assert full.resumed_s < 5.0


@pytest.mark.long
def test_a_campaign_that_is_killed_leaves_no_recorder_behind(tmp_path: Path) -> None:
    sizes = {f"--{name}": "0" for name in CAMPAIGNS} | {"--R17": "60"}  # one recorder, for a minute
    command = [sys.executable, "-m", "tests.daq.crash", "--jobs", "1"]
    command += [word for size in sizes.items() for word in size]
    with subprocess.Popen(command, env={**os.environ, "TMPDIR": str(tmp_path)}) as campaign:
        _wait(lambda: bool(_recorders(tmp_path)), 60.0)
        campaign.send_signal(signal.SIGKILL)
    _wait(lambda: not _recorders(tmp_path), 60.0)  # one that is still starting ends itself


def _recorders(folder: Path) -> list[str]:
    """Return the command lines of the recorders of a campaign in a folder."""
    command = ["pgrep", "--full", "--list-full", f"crash_process.*{folder}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.splitlines()


def _wait(condition: Callable[[], bool], seconds: float) -> None:
    deadline_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)
