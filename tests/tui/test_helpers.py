"""Helpers of one identification: they go with their parent, and report in a line what is wrong."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from multiprocessing import active_children
from pathlib import Path

import pytest

from dbc.errors import InputError
from tui.jobs.executors import helpers

LIGHT = ("json",)
PATIENCE_S = 30.0


def test_helpers_work_and_leave_nothing_behind() -> None:
    with helpers(LIGHT) as pool:
        assert pool.submit(abs, -3).result() == 3
    assert active_children() == []


def test_a_helper_that_dies_is_reported_in_a_line() -> None:
    with pytest.raises(InputError, match="a helper process died"), helpers(LIGHT) as pool:
        pool.submit(os._exit, 1).result()
    assert active_children() == []


def test_helpers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "parent.py"
    program.write_text(
        "import os, time\n"
        "from tui.jobs.executors import helpers\n"
        "if __name__ == '__main__':\n"
        "    with helpers(('json',)) as pool:\n"
        "        print(*{pool.submit(os.getpid).result() for _ in range(20)}, flush=True)\n"
        "        time.sleep(60)\n"
    )
    root = Path(__file__).parents[2]
    with subprocess.Popen(
        [sys.executable, str(program)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        text=True, cwd=root,
        env=os.environ | {"PYTHONPATH": str(root)},
    ) as parent:  # fmt: skip
        assert parent.stdout is not None
        pids = [int(pid) for pid in parent.stdout.readline().split()]
        assert pids
        parent.send_signal(signal.SIGKILL)
    until_s = time.monotonic() + PATIENCE_S
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < until_s
        time.sleep(0.05)
