"""Batches as they are run: killed, and on a Dask cluster that loses a worker."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from daq import read_session
from identify.batch import session_row
from tests.tui.batches import paper_session, progress_that, refused_session, write_all
from tui import output
from tui.cli import run

_DASK = [sys.executable, "-m", "dask"]
_HERE = ["--host", "127.0.0.1", "--no-dashboard"]
_SAID = "Scheduler at:"
_SET = {"OPENBLAS_NUM_THREADS": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
"""As docs/engineer.md has workers started."""


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[tuple[str, dict[str, subprocess.Popen[str]]]]:
    """Yield the scheduler's address and the worker processes by name, one thread each.

    The workers have no nanny: one that is killed stays dead.
    """
    with (folder / "dask.log").open("w") as log:
        scheduler = subprocess.Popen(
            [*_DASK, "scheduler", *_HERE, "--port", "0"], stderr=subprocess.PIPE, text=True
        )
        started = [scheduler]
        try:
            assert scheduler.stderr is not None
            line = next(line for line in scheduler.stderr if _SAID in line)
            address = line.split(_SAID)[1].strip()
            options = ["--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]
            command = [*_DASK, "worker", address, *options, *_HERE]
            named = {
                f"worker-{i}": subprocess.Popen(
                    [*command, "--name", f"worker-{i}"],
                    stdout=log,
                    stderr=log,
                    text=True,
                    env=os.environ | _SET,
                )
                for i in range(workers)
            }
            started += named.values()
            yield address, named
        finally:
            for process in reversed(started):
                process.kill()
                process.communicate()


def _table(path: Path) -> dict[str, dict[str, str]]:
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    by_hash = {row["sha256"]: row for row in rows}
    assert len(by_hash) == len(rows)  # each once
    return by_hash


@pytest.mark.long
def test_a_cluster_does_again_what_a_killed_worker_had(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from distributed import Client  # half a second to import, and only the long form needs it

    files = write_all(tmp_path / "s", paper_session, 4)
    lost: list[str] = []
    with cluster(tmp_path, workers=2) as (address, workers):

        def kill_one() -> None:
            connect: Any = Client
            with connect(address, set_as_default=False) as client:
                names = {w["name"]: url for url, w in client.scheduler_info()["workers"].items()}
                busy = client.processing()
            for name, worker in workers.items():
                tasks = busy.get(names.get(name), ())
                if tasks:
                    worker.kill()
                    lost.extend(tasks)
                    return

        monkeypatch.setattr(output, "progress", progress_that(kill_one, rows=1))
        arguments = ["batch", str(tmp_path / "s"), "--scheduler", address]
        assert run([*arguments, "--out", str(tmp_path / "t.csv"), "--json"]) == 0
        assert sum(worker.poll() is not None for worker in workers.values()) == 1
    assert lost
    summary = json.loads(capsys.readouterr().out)
    assert (summary["sessions"], summary["done_now"], summary["bad"]) == (4, 4, [])
    rows = _table(tmp_path / "t.csv")
    assert {row["file"] for row in rows.values()} == {str(file) for file in files}
    assert {row["session"] for row in rows.values()} == {f"paper-{seed}" for seed in range(4)}

    # What a cluster finds is what this process finds, digit for digit.
    row = next(row for row in rows.values() if row["file"] == str(files[0]))
    here = session_row(read_session(files[0]))
    assert {name: row[name] for name in here} == {name: str(cell) for name, cell in here.items()}


def test_a_scheduler_without_workers_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write_all(tmp_path / "s", refused_session, 1)
    with cluster(tmp_path, workers=0) as (address, _):
        out = str(tmp_path / "t.csv")
        assert run(["batch", str(tmp_path / "s"), "--scheduler", address, "--out", out]) == 2
    assert "no workers" in capsys.readouterr().err


def test_a_cluster_does_the_work(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    write_all(tmp_path / "s", refused_session, 1)
    words = ["batch", str(tmp_path / "s"), "--out", str(tmp_path / "t.csv"), "--scheduler"]
    with cluster(tmp_path, workers=1) as (address, _):
        assert run([*words, address, "--json"]) == 1
        assert json.loads(capsys.readouterr().out)["verdicts"] == {"refused": 1}
