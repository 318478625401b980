"""Parts of a batch by hand: when its table is written, which rows count, and what is missing."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, cast

import pytest

from dbc.errors import InputError
from tui.commands.batch import tally as tally_module
from tui.commands.batch.journal import RowJournal
from tui.commands.batch.newest import newest_rows
from tui.commands.batch.places import session_files
from tui.commands.batch.table import check_outputs, write_outputs
from tui.commands.batch.tally import work_off
from tui.commands.batch.work import Job, row_of_lost
from tui.jobs.executors import Workers, as_finished
from tui.jobs.spread import map_items

from .batches import refused_session, synthetic_rows, write_all, write_journal


class AtOnce:
    """A crew that does each item as it is given, or leaves it undone."""

    ahead = 2

    def __init__(self, does: Callable[[Future[Any], Any], None]) -> None:
        self._does = does

    def submit(self, function: Callable[[Any], Any], item: Any) -> Future[Any]:
        """Do an item."""
        future: Future[Any] = Future()
        self._does(future, item)
        return future

    def check(self) -> None:
        """All are there."""


def ended(future: Future[Any], job: Job) -> None:
    row = {**synthetic_rows(1)[0], "file": job.file, "sha256": job.sha256}
    future.set_result({**row, "verdict": "refused" if "002" in job.file else "ok"})


def silent(done: float, text: str = "") -> None:
    """Say nothing."""


def test_the_table_is_written_every_minute_and_each_session_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = [str(path) for path in write_all(tmp_path, refused_session, 5)]
    clock = iter((0.0, 60.0, 60.1, 100.0, 160.0, 160.1, 170.0, 175.0, 180.0))
    monkeypatch.setattr(tally_module, "monotonic", lambda: next(clock))
    published: list[int] = []
    stages: list[tuple[float, str]] = []
    with RowJournal(tmp_path / "t.jsonl") as journal:
        done = work_off(
            cast(Workers, AtOnce(ended)),
            files,
            journal,
            lambda: published.append(len((tmp_path / "t.jsonl").read_text().splitlines())),
            lambda share, text="": stages.append((share, text)),
        )
        again = work_off(cast(Workers, AtOnce(ended)), files[:2], journal, lambda: None, silent)
    # 60.1 s is the first look after more than a minute; then the minute begins again.
    assert published == [2, 4]
    assert (done.sessions, done.done_now, done.verdicts) == (5, 5, {"ok": 4, "refused": 1})
    assert [case["verdict"] for case in done.bad] == ["refused"]
    assert stages[0] == (0.2, "1 of 5, 0 refused or failed")
    assert stages[-1] == (1.0, "5 of 5, 1 refused or failed")
    assert (again.sessions, again.done_now, again.verdicts) == (2, 0, {"ok": 2})


def test_a_cluster_that_goes_ends_the_batch_in_a_line(tmp_path: Path) -> None:
    files = [str(path) for path in write_all(tmp_path, refused_session, 1)]

    def cancelled(future: Future[Any], _: Any) -> None:
        future.cancel()
        future.set_running_or_notify_cancel()  # as who carries it out does

    with (
        RowJournal(tmp_path / "t.jsonl") as journal,
        pytest.raises(InputError, match="the cluster has gone"),
    ):
        work_off(cast(Workers, AtOnce(cancelled)), files, journal, lambda: None, silent)


def test_a_row_of_a_lost_worker_says_how_it_was_lost() -> None:
    job = Job("/b/a.h5", "77")
    for error, reason in (
        (BrokenProcessPool("gone"), "its worker process died, most likely for want of memory"),
        (ValueError("odd"), "its worker failed: ValueError: odd"),
    ):
        future: Future[Any] = Future()
        future.set_exception(error)
        row = row_of_lost(job, future)
        assert (row["verdict"], row["reasons"]) == ("failed", reason)
        assert (row["file"], row["sha256"], row["seconds"]) == ("/b/a.h5", "77", 0.0)


def test_the_newest_row_of_a_file_and_of_a_content_counts(tmp_path: Path) -> None:
    one, two = synthetic_rows(2)
    changed = {**one, "sha256": "new", "vehicle": "Polo"}
    moved = {**two, "file": "/bench/moved.h5"}
    failed = {**one, "file": "/bench/x.h5", "sha256": "", "verdict": "failed"}
    again = {**failed, "reasons": "twice"}
    journal = write_journal(tmp_path / "j", [one, two, changed, moved, failed, again])
    newest = newest_rows(journal)
    rows = list(newest.rows())
    assert [(row["file"], row["sha256"]) for row in rows] == [
        ("/bench/moved.h5", two["sha256"]),
        (one["file"], "new"),
        ("/bench/x.h5", ""),
    ]
    assert rows[2]["reasons"] == "twice"
    assert list(newest.vehicles.values()) == ["Transit", "Polo", "Golf"]
    assert newest.columns[-3:] == ("seconds", "software", "libraries")
    assert "chi2_per_n" not in newest.texts
    assert "verdict" in newest.texts


def test_only_what_is_done_by_this_version_is_not_done_again(tmp_path: Path) -> None:
    ok, second, third = synthetic_rows(3)
    failed = {**second, "verdict": "failed"}
    old = {**third, "software": "bumpbench 0.0.1"}
    path = write_journal(tmp_path / "j", [ok, failed, old])
    with path.open("a") as stream:
        stream.write('{"torn": ')
    with RowJournal(path) as journal:
        assert journal.verdicts == {ok["sha256"]: "ok"}
        journal.append({**failed, "verdict": "doubtful"})
        assert journal.verdicts[str(failed["sha256"])] == "doubtful"
    assert len(path.read_text().splitlines()) == 4
    assert json.loads(path.read_text().splitlines()[-1])["verdict"] == "doubtful"
    with pytest.raises(InputError, match="choose another --out"):
        RowJournal(tmp_path / "none" / "j")


ROW_KEYS = '"sha256": "1", "verdict": "ok", "software": "x"}'


@pytest.mark.parametrize(
    ("content", "number"),
    [
        ("measured by hand", 1),
        ("line 1\nline 2", 1),
        ('{"car": "Golf"}', 1),
        ('{"file": "a.h5", ' + ROW_KEYS + "\nmine\nand mine", 2),
    ],
)
def test_a_foreign_file_keeps_its_last_line(tmp_path: Path, content: str, number: int) -> None:
    (path := tmp_path / "t.jsonl").write_text(content)
    with pytest.raises(InputError) as raised:
        RowJournal(path)
    assert str(raised.value) == f"{path}:{number}: is not a row of a batch (choose another --out)"
    assert path.read_text() == content


@pytest.mark.parametrize("torn", ["", "{", '{"file": "a.h5", "sha256": "1'])
def test_the_beginning_of_a_first_row_is_cut_off(tmp_path: Path, torn: str) -> None:
    (path := tmp_path / "t.jsonl").write_text(torn)
    with RowJournal(path) as journal:
        assert journal.verdicts == {}
    assert path.read_text() == ""


@pytest.mark.parametrize(
    ("out", "page", "named"),
    [
        ("t.xlsx", None, "is not a table"),
        ("t.csv", "p.pdf", "is not a known form of page"),
        ("t.csv", "full/notes.txt/p.html", "name another folder"),
        ("full/notes.txt/t.csv", None, "name another folder"),
        ("folder.csv", None, "is a directory"),
        ("full", None, "is not a folder of a batch"),
    ],
)
def test_outputs_that_could_not_be_written_are_refused_before(
    tmp_path: Path, out: str, page: str | None, named: str
) -> None:
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=named):
        check_outputs(tmp_path / out, tmp_path / page if page else None)


@pytest.mark.parametrize("name", ["t.csv", "t.CSV", "t.parquet", "new", "old"])
def test_outputs_that_can_be_written_are_taken(tmp_path: Path, name: str) -> None:
    (tmp_path / "old").mkdir()
    check_outputs(tmp_path / name, tmp_path / "p.htm")


@pytest.mark.parametrize("name", ["measured.csv", "set"])
def test_a_table_is_replaced_beside_the_rows_of_its_batch_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / "measured.csv").write_text("time,travel\n0,1\n")
    (tmp_path / "set" / "vehicle=Golf").mkdir(parents=True)
    (rows := tmp_path / f"{name}.jsonl").touch()
    with pytest.raises(InputError, match=r"exists already \(name another .* or use --force\)"):
        check_outputs(tmp_path / name, None)
    check_outputs(tmp_path / name, None, replace=True)
    rows.write_text("{}\n")
    check_outputs(tmp_path / name, None)


def test_libraries_that_are_not_there_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tui.commands.batch.table.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"bumpbench\[data\]"):
        check_outputs(tmp_path / "t.parquet", None)
    check_outputs(tmp_path / "t.csv", None)
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(InputError, match=r"bumpbench\[remote\]"):
        session_files(["memory://bench/"])


def test_a_table_that_cannot_be_written_says_where_the_rows_are(tmp_path: Path) -> None:
    journal = write_journal(tmp_path / "j", synthetic_rows(1))
    (tmp_path / "t.csv").mkdir()
    with pytest.raises(InputError, match="the rows are safe in"):
        write_outputs(tmp_path / "t.csv", None, journal)


def test_items_in_flight_follow_the_room_and_all_come_back() -> None:
    def done(future: Future[Any], item: int) -> None:
        future.set_result(-item)

    crew = cast(Workers, AtOnce(done))
    found = [(item, future.result()) for item, future in as_finished(crew, abs, range(5))]
    assert sorted(found) == [(n, -n) for n in range(5)]


def test_work_over_all_reports_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    class Entered(AtOnce):
        def __enter__(self) -> Entered:
            return self

        def __exit__(self, *_: object) -> None:
            """Leave."""

    asked: list[tuple[int, str | None]] = []

    def workers_of(workers: int, scheduler: str | None) -> Entered:
        asked.append((workers, scheduler))
        return Entered(lambda future, item: future.set_result(item * item))

    monkeypatch.setattr("tui.jobs.spread.workers_of", workers_of)
    stages: list[tuple[float, str]] = []
    squares = map_items(
        abs, [3, 1, 2], 7, lambda s, t="": stages.append((s, t)), "squares", "tcp://x:1"
    )
    assert squares == [9, 1, 4]
    assert asked == [(7, "tcp://x:1")]
    assert [text for _, text in stages] == ["1 of 3", "2 of 3", "3 of 3"]
    assert stages[-1][0] == 1.0
