"""R8 in small, in a process of its own; the long form is `make soak`."""

from __future__ import annotations

import re
import subprocess
import sys


def test_a_recorder_holds_no_more_after_many_bumps_than_after_few() -> None:
    command = [sys.executable, "-m", "tests.daq.soak", "120000", "2"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    told = re.search(
        r"120,000 frames, (\d+) recordings, (\d+) bumps, (\d+) notes, (\d+) segments: 0 lost",
        done.stdout,
    )
    assert told, done.stdout
    recordings, bumps, notes, segments = map(int, told.groups())
    assert recordings >= 3  # one campaign was complete, and another was begun
    assert bumps >= 15
    assert notes >= 15
    assert segments > recordings
