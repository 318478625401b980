"""Helpers of one identification: they go with their parent, and report in a line what is wrong."""

from __future__ import annotations

import os
import shutil
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


def test_no_process_to_be_had_is_reported_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.ForkServerProcess._Popen", refused)
    with pytest.raises(InputError, match="no process can be started"), helpers(LIGHT) as pool:
        pool.submit(abs, -3).result()


@pytest.mark.parametrize("length", [70, 71, 200])
def test_helpers_work_where_the_folder_of_temporary_files_has_a_long_path(
    length: int, tmp_path: Path
) -> None:
    """A Unix socket has a path of 107 bytes at most."""
    short = tmp_path.parents[-2] / f"helpers-{os.getpid()}"
    folder = short / ("t" * (length - len(str(short)) - 1))
    folder.mkdir(parents=True)
    program = (
        "import tempfile; from tui.jobs.executors import helpers\n"
        "from multiprocessing.util import get_temp_dir\n"
        "with helpers(('json',)) as pool:\n"
        "    print(pool.submit(abs, -3).result())\n"
        "print(tempfile.gettempdir())\n"
        "print(get_temp_dir())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"TMPDIR": str(folder)},
    )
    left = [path.name for path in folder.iterdir()]
    shutil.rmtree(short)
    assert done.returncode == 0, done.stderr
    result, temporary, sockets = done.stdout.splitlines()
    assert (result, temporary) == ("3", str(folder))
    assert sockets.startswith(str(folder) if length == 70 else "/tmp/pymp-")
    assert left == []


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
