"""`bumpbench batch`: rows, tables, going on where it stopped, workers that die, mistakes."""

from __future__ import annotations

import csv
import errno
import fcntl
import json
import os
import shutil
import signal
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import pytest

from dbc.errors import InputError
from tui import output
from tui.cli import run
from tui.jobs.executors import Processes, as_finished

from .batches import progress_that, refused_session, write_all


def _batch(capsys: pytest.CaptureFixture[str], *arguments: str, code: int = 1) -> dict[str, Any]:
    assert run(["batch", "--workers", "1", "--json", *arguments]) == code
    document = json.loads(capsys.readouterr().out)
    assert isinstance(document, dict)
    return document


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def _interrupt() -> None:
    raise KeyboardInterrupt


def _dies_of_three(item: int) -> int:
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return -item


def test_a_row_for_each_and_then_no_more(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder, out = tmp_path / "sessions", tmp_path / "table.csv"
    write_all(folder / "monday", refused_session, 3)
    shutil.copy(folder / "monday" / "car000.h5", folder / "copy.h5")  # the same session
    (folder / "bad.h5").write_text("no session\x1b[31m")
    summary = _batch(capsys, str(folder), "--out", str(out))
    assert summary["verdicts"] == {"refused": 3, "failed": 1}
    assert (summary["sessions"], summary["done_now"]) == (4, 4)
    assert "not an HDF5" in next(b["reasons"] for b in summary["bad"] if b["verdict"] == "failed")
    rows = _table(out)
    assert len(rows) == len({row["sha256"] for row in rows}) == 4
    assert all("added mass" in row["reasons"] for row in rows if row["verdict"] == "refused")
    assert all(row["software"].startswith("bumpbench ") for row in rows)
    assert out.read_text().isascii()

    again = _batch(capsys, str(folder), "--out", str(out))
    assert (again["sessions"], again["done_now"]) == (4, 1)  # what failed is tried again
    assert len(_table(out)) == 4

    # Another day's sessions come into the same table; a file with new content has its row replaced.
    write_all(folder / "monday", lambda seed: refused_session(seed + 50), 1)
    (folder / "bad.h5").unlink()
    later = _batch(capsys, str(folder / "monday" / "*.h5"), "--out", str(out))
    assert (later["sessions"], later["done_now"]) == (3, 1)
    newest = {row["file"]: row["sha256"] for row in _table(out)}
    before = {row["file"]: row["sha256"] for row in rows}
    changed = {file for file in newest if newest[file] != before.get(file)}
    assert str(folder / "monday" / "car000.h5") in changed


def test_parquet_says_what_csv_says(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    from pyarrow import parquet

    write_all(tmp_path / "s", refused_session, 2)
    _batch(capsys, str(tmp_path / "s"), "--out", str(tmp_path / "t.csv"))
    shutil.copy(tmp_path / "t.csv.jsonl", tmp_path / "t.parquet.jsonl")
    done = _batch(capsys, str(tmp_path / "s"), "--out", str(tmp_path / "t.parquet"))
    assert done["done_now"] == 0
    rows = parquet.read_table(tmp_path / "t.parquet").to_pylist()
    texts = [{k: "" if v is None else str(v) for k, v in row.items()} for row in rows]
    numbers = {"runs_accepted", "seconds"}
    for parquet_row, csv_row in zip(texts, _table(tmp_path / "t.csv"), strict=True):
        assert parquet_row.keys() == csv_row.keys()
        for key, value in csv_row.items():
            same = float(value) == float(parquet_row[key]) if key in numbers else None
            assert same if key in numbers else value == parquet_row[key]


def test_rows_of_another_version_and_half_rows_are_made_again(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    write_all(tmp_path / "s", refused_session, 3)
    out, journal = tmp_path / "t.csv", tmp_path / "t.csv.jsonl"
    _batch(capsys, str(tmp_path / "s"), "--out", str(out))
    first, second, third = journal.read_text().splitlines()
    old = json.dumps({**json.loads(first), "software": "bumpbench 0.0.1"})
    journal.write_text("\n".join([old, second, third[:-20]]))
    assert _batch(capsys, str(tmp_path / "s"), "--out", str(out))["done_now"] == 2
    assert len(_table(out)) == 3
    assert "bumpbench 0.0.1" not in out.read_text()


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
    rest = _batch(capsys, *map(str, files), "--out", str(out))
    assert (rest["sessions"], rest["done_now"]) == (6, 4)
    assert len(_table(out)) == 6


def test_a_row_that_the_disk_refuses_ends_the_batch_and_is_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The table, which the full disk refuses next, does not say that the rows are safe."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    (file,) = map(str, write_all(tmp_path / "s", refused_session, 1))
    monkeypatch.setattr("tui.commands.batch.journal.os.fsync", full)
    assert run(["batch", "--workers", "1", file, "--out", str(tmp_path / "t.csv")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "t.csv.jsonl: No space left on device (make room, and run the same command" in line


def test_only_the_item_that_kills_its_worker_fails() -> None:
    with Processes(2) as crew:
        outcomes = dict(as_finished(crew, _dies_of_three, range(8)))
    failed = [item for item, future in outcomes.items() if future.exception()]
    assert failed == [3]
    assert all(outcomes[i].result() == -i for i in range(8) if i != 3)
    assert active_children() == []


def test_no_more_in_flight_than_the_workers_need() -> None:
    taken = 0

    def items() -> Any:
        nonlocal taken
        for i in range(40):
            taken += 1
            yield i

    with Processes(1) as crew:
        for finished, _ in enumerate(as_finished(crew, abs, items())):
            assert taken - finished <= crew.ahead
    assert taken == 40


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["absent.h5"], "absent.h5"),
        (["no/such/*.h5"], "no/such/*.h5"),
        (["."], "no session file"),
        ([], "files"),
        (["car.h5", "--out", "table.xlsx"], ".parquet"),
        (["car.h5", "--out", "car.h5/t.csv"], "car.h5: is not a folder"),
        (["car.h5", "--workers", "0"], "--workers"),
        (["car.h5", "--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "--scheduler"),
        (["car.h5", "--scheduler", "nonsense"], "nonsense"),
        (["car.h5", "--scheduler", ""], "port"),
    ],
)
def test_mistakes_are_named_in_one_line(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    arguments: list[str],
    named: str,
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "car.h5").touch()
    monkeypatch.chdir(tmp_path / "empty" if arguments == ["."] else tmp_path)
    assert run(["batch", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    assert line.startswith("bumpbench: error: ")
    assert named in line


def test_a_missing_library_is_named_with_its_extra(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    import sys

    (tmp_path / "car.h5").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert run(["batch", "car.h5", "--scheduler", "tcp://127.0.0.1:8786"]) == 2
    assert "bumpbench[cluster]" in capsys.readouterr().err


def test_two_batches_do_not_write_to_one_table(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (file,) = write_all(tmp_path, refused_session, 1)
    with (tmp_path / "t.csv.jsonl").open("ab") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        assert run(["batch", str(file), "--out", str(tmp_path / "t.csv")]) == 2
    assert "another batch" in capsys.readouterr().err


def test_a_journal_of_something_else_is_left_alone(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (file,) = write_all(tmp_path, refused_session, 1)
    journal = tmp_path / "t.csv.jsonl"
    journal.write_text('{"my": "notes"}\n')
    assert run(["batch", str(file), "--out", str(tmp_path / "t.csv")]) == 2
    assert ".jsonl:1" in capsys.readouterr().err
    assert journal.read_text() == '{"my": "notes"}\n'


def test_an_error_crosses_from_a_worker_whole() -> None:
    with Processes(1) as crew:
        ((_, future),) = as_finished(crew, _refuses, [7])
    error = future.exception()
    assert isinstance(error, InputError)
    assert (error.where, error.what, error.advice) == ("item 7", "is odd", "give an even one")


def _refuses(item: int) -> int:
    raise InputError(f"item {item}", "is odd", "give an even one")
