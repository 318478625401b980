"""R8 in small, in a process of its own; the long form is `make soak`."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest


@pytest.mark.long  # half a minute; `make soak` has the whole of it
def test_a_recorder_holds_no_more_after_many_bumps_than_after_few() -> None:
    command = [sys.executable, "-m", "tests.daq.soak", "30000", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    reported = re.search(
        r"30,000 frames, (\d+) recordings, (\d+) bumps, (\d+) notes, (\d+) segments: 0 lost",
        done.stdout,
    )
    assert reported, done.stdout
    recordings, bumps, notes, segments = map(int, reported.groups())
    assert recordings >= 2  # one was stopped
    assert bumps >= 3
    assert notes >= 3
    assert segments > recordings
