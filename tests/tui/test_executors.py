"""Work on many items: processes that die, and a cluster that is of no use."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import pytest

from dbc.errors import InputError
from tui.jobs.executors import as_finished, helpers, map_items, processes


def _dies_of_three(item: int) -> int:
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return -item


def _refuses(item: int) -> int:
    raise InputError(f"item {item}", "is odd", "give an even one")


def test_only_the_item_that_kills_its_worker_fails() -> None:
    results = dict(as_finished(_dies_of_three, range(12), 2))
    assert isinstance(results.pop(3).exception(), BrokenProcessPool)
    assert {item: future.result() for item, future in results.items()} == {
        item: -item for item in range(12) if item != 3
    }
    assert active_children() == []


def test_no_more_items_are_taken_than_the_workers_need() -> None:
    taken: list[int] = []

    def items() -> Any:
        for item in range(100):
            taken.append(item)
            yield item

    work = as_finished(abs, items(), 2)
    next(work)
    assert len(taken) <= 5
    work.close()
    assert active_children() == []


def test_an_error_crosses_from_a_worker_whole_and_ends_the_work() -> None:
    with pytest.raises(InputError) as caught:
        map_items(_refuses, [7], 1, lambda done, text="": None, "study")
    error = caught.value
    assert (error.where, error.what, error.advice) == ("item 7", "is odd", "give an even one")


def test_results_are_in_the_order_of_the_items_and_the_share_is_reported() -> None:
    shares: list[tuple[float, str]] = []
    work = map_items(abs, [-3, -1, -2], 2, lambda done, text="": shares.append((done, text)), "x")
    assert work == [3, 1, 2]
    assert shares[-1] == (1.0, "3 of 3")


def test_no_process_to_be_had_is_reported_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.ForkServerProcess._Popen", refused)
    with pytest.raises(InputError, match="no process can be started"), processes(1) as pool:
        pool.submit(abs, -3)


def test_a_scheduler_that_does_not_answer_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(InputError, match="no Dask scheduler answers") as caught:
        list(as_finished(abs, [1], 1, address))
    assert caught.value.where == f"--scheduler {address}"


def test_a_cluster_needs_dask(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="needs Dask, which is not installed"):
        list(as_finished(abs, [1], 1, "tcp://host:8786"))


# Helpers of one identification: they go with their parent ----------------------------------------

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
