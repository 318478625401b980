"""A batch with its table and page, and the processes that do long work."""

from __future__ import annotations

import asyncio
import csv
import errno
import gc
import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from threading import enumerate as enumerate_threads
from typing import Any

import pytest

import daq
from dbc.words import InputError
from tui import output
from tui.cli import run
from tui.jobs.executors import as_finished, map_items, processes
from tui.jobs.reporting import batch_page
from tui.jobs.worker import START, Outcome, answer_of, identify_session
from tui.output import Stage

from .batches import progress_that, refused_session, synthetic_rows, write_all
from .conftest import answered, said

BATCH = ("batch", "--workers", "1")


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def _interrupt() -> None:
    raise KeyboardInterrupt


def test_a_row_for_each_and_no_more(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    folder, out = tmp_path / "sessions", tmp_path / "table.csv"
    write_all(folder / "monday", refused_session, 3)
    (folder / "bad.h5").write_text("no session\x1b[31m")
    summary, _ = answered(capsys, *BATCH, str(folder), "--out", str(out), code=1)
    assert summary["verdicts"] == {"refused": 3, "failed": 1}
    assert (summary["sessions"], summary["done_now"]) == (4, 4)
    assert "not an HDF5" in next(b["reasons"] for b in summary["bad"] if b["verdict"] == "failed")
    rows = _table(out)
    assert len(rows) == len({row["sha256"] for row in rows}) == 4
    assert all("added mass" in row["reasons"] for row in rows if row["verdict"] == "refused")
    assert all(row["software"].startswith("bumpbench ") for row in rows)
    assert out.read_text().isascii()

    again, _ = answered(capsys, *BATCH, str(folder), "--out", str(out), code=1)
    assert (again["sessions"], again["done_now"]) == (4, 1)  # what failed is tried again
    assert len(_table(out)) == 4

    # Another day's sessions come into the same table; a file with new content has its row replaced.
    write_all(folder / "monday", lambda seed: refused_session(seed + 50), 1)
    (folder / "bad.h5").unlink()
    later, _ = answered(capsys, *BATCH, str(folder / "monday" / "*.h5"), "--out", str(out), code=1)
    assert (later["sessions"], later["done_now"]) == (3, 1)
    newest = {row["file"]: row["sha256"] for row in _table(out)}
    before = {row["file"]: row["sha256"] for row in rows}
    changed = {file for file in newest if newest[file] != before.get(file)}
    assert str(folder / "monday" / "car000.h5") in changed


def test_foreign_text_in_a_table_is_no_formula(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write_all(tmp_path / "sessions", refused_session, 1)
    out = tmp_path / "table.csv"
    answered(capsys, *BATCH, str(tmp_path / "sessions"), "--out", str(out), code=1)
    rows = _table(out)
    rows[0] |= {"vehicle": "=1+1", "reasons": "-1e-3"}
    with out.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    for _ in range(2):
        answered(capsys, *BATCH, str(tmp_path / "sessions"), "--out", str(out), code=1)
        assert _table(out)[0]["vehicle"] == "'=1+1"
        assert _table(out)[0]["reasons"] == "-1e-3"


def test_rows_of_another_version_are_made_again(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write_all(tmp_path / "s", refused_session, 3)
    out = tmp_path / "t.csv"
    answered(capsys, *BATCH, str(tmp_path / "s"), "--out", str(out), code=1)
    out.write_text(out.read_text().replace("bumpbench ", "bumpbench 0.0.", 1))
    again, _ = answered(capsys, *BATCH, str(tmp_path / "s"), "--out", str(out), code=1)
    assert again["done_now"] == 1
    assert len(_table(out)) == 3
    assert "bumpbench 0.0." not in out.read_text()


def test_ctrl_c_keeps_the_rows(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    files = write_all(tmp_path / "s", refused_session, 6)
    out = tmp_path / "t.csv"
    with monkeypatch.context() as patch:
        patch.setattr(output, "progress", progress_that(_interrupt, rows=2))
        assert run(["batch", "--workers", "1", *map(str, files), "--out", str(out)]) == 130
    assert "kept" in capsys.readouterr().err
    assert active_children() == []
    assert len(_table(out)) == 2
    rest, _ = answered(capsys, *BATCH, *map(str, files), "--out", str(out), code=1)
    assert (rest["sessions"], rest["done_now"]) == (6, 4)
    assert len(_table(out)) == 6


def test_a_table_that_the_disk_refuses_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (file,) = map(str, write_all(tmp_path / "s", refused_session, 1))
    monkeypatch.setattr("daq.files.sync_data", full)
    assert run(["batch", "--workers", "1", file, "--out", str(tmp_path / "t.csv")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "t.csv: No space left on device (name another file" in line


# The page -----------------------------------------------------------------------------------------


def test_the_page_has_rows_parameters_and_reports(tmp_path: Path) -> None:
    rows = synthetic_rows(40)
    (tmp_path / "my car.html").touch()
    rows[3] = {**rows[3], "file": str(tmp_path / "my car.h5"), "m_s": "1700.0"}  # as a CSV has it
    rows[4] = {**rows[4], "verdict": "refused", "m_s": 9000.0, "origin": "simulated"}
    rows[5] = {**rows[5], "vehicle": "</script><script>alert(1)"}
    page = batch_page(list(rows[0]), rows, tmp_path / "out")
    data = json.loads(
        page.split('<script type="application/json" id="data">')[1].split("</script>")[0]
    )
    assert data["parameters"] == [["m_s", "kg"]]  # modes are none
    assert data["rows"][3][1] == "../my%20car.html"
    assert data["rows"][2][1] == ""
    assert data["rows"][4][4:6] == ["simulated", "refused"]
    assert data["rows"][5][2] == "</script><script>alert(1)"
    assert "alert(1)" not in page.replace("\\u003cscript\\u003ealert(1)", "")
    assert "http" not in page.replace("http://www.w3.org", "")


def test_a_batch_counts_names_and_ends_with_1(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    files = write_all(tmp_path / "s", refused_session, 1)
    bad = [tmp_path / f"bad{i:02}.h5" for i in range(21)]
    for number, path in enumerate(bad):
        path.write_text(f"no session {number}")
    out_file = tmp_path / "t.csv"
    page = tmp_path / "t.html"
    words = ["batch", "--workers", "1", "--out", str(out_file), "--page", str(page)]
    out, _ = said(capsys, *words, *map(str, (*files, *bad)), code=1)
    lines = out.splitlines()
    assert lines[0] == "22 sessions: 21 failed, 1 refused"
    assert lines[1].startswith("22 of them done now in ")
    assert lines[1].endswith(f": {out_file}, {page}")
    assert len([line for line in lines if line.startswith("  - ")]) == 21
    assert lines[-1] == "  - and 2 more in the table"
    table = out_file.read_bytes()
    assert table.count(b"\n") == 23, "a head and a line for each session, on every system"
    assert b"\r" not in table


# The processes that do the work -------------------------------------------------------------------


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
        map_items(_refuses, [7], 1, lambda done, text: None)
    error = caught.value
    assert (error.where, error.what, error.advice) == ("item 7", "is odd", "give an even one")


def test_results_are_in_the_order_of_the_items_and_the_share_is_reported() -> None:
    shares: list[tuple[float, str]] = []
    work = map_items(abs, [-3, -1, -2], 2, lambda done, text: shares.append((done, text)))
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
    with pytest.raises(InputError, match="needs distributed"):
        list(as_finished(abs, [1], 1, "tcp://host:8786"))


# Helpers of one identification: they go with their parent ----------------------------------------

LIGHT = ("json",)
PATIENCE_S = 30.0


def test_helpers_work_and_leave_nothing_behind() -> None:
    with processes(2, LIGHT) as pool:
        assert pool.submit(abs, -3).result() == 3
    assert active_children() == []


def test_a_helper_that_dies_is_reported_in_a_line() -> None:
    with pytest.raises(InputError, match="processes: one died"), processes(2, LIGHT) as pool:
        pool.submit(os._exit, 1).result()
    assert active_children() == []


def test_helpers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "parent.py"
    program.write_text(
        "import os, time\n"
        "from tui.jobs.executors import processes\n"
        "if __name__ == '__main__':\n"
        "    with processes(2, ('json',)) as pool:\n"
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


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bench") / "session_0001.h5"
    daq.write_session(path, refused_session(1))
    return path


def answer(path: Path, stage: Stage = lambda share, text: None) -> Any:
    """Return the answer of a real child."""
    return asyncio.run(
        answer_of(partial(identify_session, str(path)), "the work", stage, asyncio.Event())
    )


def test_a_broken_file_is_one_kind_line(session: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(session.read_bytes()[:-2000])
    with pytest.raises(InputError, match=r"bad\.h5: .*cut off") as raised:
        answer(bad)
    assert "\n" not in str(raised.value)


def test_a_child_says_what_it_does_and_sends_the_outcome(session: Path) -> None:
    stages: list[tuple[float, str]] = []
    outcome = answer(session, lambda share, text: stages.append((share, text)))
    assert stages[0] == (0.05, "reading")
    assert isinstance(outcome, Outcome)
    assert outcome.result.quality.verdict == "refused"
    assert outcome.session == str(session)


def test_a_killed_child_is_reported(session: Path) -> None:
    killed: list[int] = []

    def kill(*_: object) -> None:
        if not killed:
            children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text()
            for pid in map(int, children.split()):
                if b"tui.jobs.worker" in Path(f"/proc/{pid}/cmdline").read_bytes():
                    os.kill(pid, signal.SIGKILL)
                    killed.append(pid)

    with pytest.raises(InputError, match="signal 9"):
        answer(session, kill)
    assert killed


@pytest.mark.parametrize("turns", [0, 2])
def test_a_screen_closed_twice_in_a_row_leaves_nothing_open(session: Path, turns: int) -> None:
    async def closed() -> None:
        task = partial(identify_session, str(session))
        work = asyncio.create_task(answer_of(task, "work", lambda *_: None, asyncio.Event()))
        for _ in range(turns):
            await asyncio.sleep(0)
        for _ in range(2):
            work.cancel()
            await asyncio.sleep(0)

    asyncio.run(closed())
    for thread in enumerate_threads():
        if thread.name == "worker":
            thread.join(10.0)
            assert not thread.is_alive()
    gc.collect()  # what is still open says so here, and that is an error


def test_the_child_ends_when_its_terminal_does(session: Path) -> None:
    command = [sys.executable, "-c", START]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        pickle.dump((partial(identify_session, str(session)), "work"), child.stdin)
        child.stdin.flush()
        assert pickle.load(child.stdout).text == "reading"
        child.stdin.close()
        assert child.wait(20.0) == 1
        assert b"Outcome" not in child.stdout.read()
