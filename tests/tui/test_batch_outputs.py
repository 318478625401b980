"""Outputs of a batch: a data set by vehicle, a page, outliers; and sessions at addresses."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import fsspec
import numpy as np
import pytest

from dbc.errors import InputError
from identify.batch import Row
from tui import output
from tui.cli import run
from tui.commands.batch.outliers import outliers
from tui.commands.batch.places import session_files
from tui.commands.batch.table import check_outputs, write_outputs
from tui.commands.batch.work import job_of, row_of

from .batches import progress_that, refused_session, synthetic_rows, write_all, write_journal


def _dataset(folder: Path) -> list[dict[str, Any]]:
    from pyarrow import dataset

    table = dataset.dataset(folder, partitioning="hive").to_table()
    return sorted(table.to_pylist(), key=lambda row: str(row["file"]))


def _data(page: Path) -> dict[str, Any]:
    found = re.search(r'id="data">(.*?)</script>', page.read_text(), re.DOTALL)
    assert found
    document = json.loads(found[1])
    assert isinstance(document, dict)
    return document


def test_a_data_set_has_each_row_in_the_folder_of_its_vehicle(tmp_path: Path) -> None:
    rows = [*synthetic_rows(5), {**synthetic_rows(6)[5], "vehicle": "A/b c"}]
    write_outputs(tmp_path / "set", None, write_journal(tmp_path / "j", rows))
    names = {"vehicle=Golf", "vehicle=Transit", "vehicle=A%2Fb c"}
    assert {folder.name for folder in (tmp_path / "set").iterdir()} == names
    assert _dataset(tmp_path / "set") == rows


def test_only_vehicles_with_other_rows_are_written_again(tmp_path: Path) -> None:
    out, journal = tmp_path / "set", tmp_path / "j"
    rows = synthetic_rows(5)
    write_outputs(out, None, write_journal(journal, rows))
    golf, transit = (out / f"vehicle={name}" / "rows.parquet" for name in ("Golf", "Transit"))
    before = golf.stat().st_ino, transit.stat().st_ino
    write_outputs(out, None, write_journal(journal, synthetic_rows(6)))
    assert golf.stat().st_ino == before[0]
    assert transit.stat().st_ino != before[1]
    # A column that only one row has is in every file: the first says which there are.
    more: Row = {**rows[1], "sha256": "new", "file": "/bench/new.h5", "front_friction": 40.0}
    write_outputs(out, None, write_journal(journal, [*rows, more]))
    assert golf.stat().st_ino != before[0]
    assert [row["front_friction"] for row in _dataset(out)] == [None] * 5 + [40.0]
    # The session of that file was of another vehicle after all.
    write_outputs(out, None, write_journal(journal, [{**rows[0], "vehicle": "Polo"}]))
    assert [row["vehicle"] for row in _dataset(out)] == ["Polo"]


def test_failed_sessions_have_no_vehicle(tmp_path: Path) -> None:
    failed: Row = {
        "file": "/x.h5", "sha256": "", "verdict": "failed", "reasons": "no", "software": "s",
    }  # fmt: skip
    journal = write_journal(tmp_path / "j", [*synthetic_rows(1), failed])
    write_outputs(tmp_path / "set", tmp_path / "p.html", journal)
    assert [row["vehicle"] for row in _dataset(tmp_path / "set")] == ["Golf", None]
    assert _data(tmp_path / "p.html")["rows"][1][5] == "failed"


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(InputError, match="not a folder of a batch"):
        check_outputs(tmp_path / "mine", None)
    with pytest.raises(InputError, match=r"\.html"):
        check_outputs(tmp_path / "t.csv", tmp_path / "page.pdf")


def test_the_page_has_rows_parameters_outliers_and_reports(tmp_path: Path) -> None:
    rows = synthetic_rows(40)
    (tmp_path / "my car.html").touch()
    rows[3] = {**rows[3], "file": str(tmp_path / "my car.h5"), "m_s": 1700.0}
    rows[4] = {**rows[4], "verdict": "refused", "m_s": 9000.0, "origin": "simulated"}
    rows[5] = {**rows[5], "vehicle": "</script><script>alert(1)"}
    (tmp_path / "out").mkdir()
    page = tmp_path / "out" / "page.html"
    write_outputs(tmp_path / "t.csv", page, write_journal(tmp_path / "j", rows))
    data = _data(page)
    assert data["parameters"] == [["m_s", "kg"]]  # modes are none
    assert data["rows"][3][1] == "../my%20car.html"
    assert data["rows"][2][1] == ""
    assert data["rows"][4][4:6] == ["simulated", "refused"]
    assert data["rows"][5][2] == "</script><script>alert(1)"
    assert "alert(1)" not in page.read_text().replace("\\u003cscript\\u003ealert(1)", "")
    (apart,) = data["outliers"]  # not the refused one
    assert apart[:2] == [3, 0]
    assert apart[2] == pytest.approx(1500.0, abs=5.0)
    assert 3.5 < apart[3] == round(apart[3], 1)
    assert "http" not in page.read_text().replace("http://www.w3.org", "")


@pytest.mark.parametrize(("value", "n", "found"), [(3.4, 5, 0), (3.6, 5, 1), (3.6, 4, 0)])
def test_a_value_is_apart_beyond_three_and_a_half_deviations(
    value: float, n: int, found: int
) -> None:
    # Equal values but one: the deviation is that of the one itself, 2.
    values = np.full((n, 1), 10.0)
    values[0] += 2.0 * value
    apart = outliers(["car"] * n, values, np.full((n, 1), 2.0))
    assert len(apart) == found
    if found:
        assert (apart[0].row, apart[0].usual) == (0, 10.0)
        assert apart[0].apart == pytest.approx(3.6)


def test_scatter_of_the_sessions_counts_with_their_own_uncertainty() -> None:
    # Median 0, median absolute deviation 2: a standard deviation of 2.9652; with 4 it is 4.979.
    values = np.array([[-2.0], [-2.0], [0.0], [2.0], [17.0], [np.nan]])
    assert len(outliers(["car"] * 6, values, np.full((6, 1), 4.0))) == 0
    (one,) = outliers(["car"] * 6, values, np.full((6, 1), np.nan))
    assert one.apart == pytest.approx(17.0 / 2.9652)
    assert outliers(["a", "b", "a", "b", "a", "b"], values, np.zeros((6, 1))) == []


def test_sessions_are_read_at_addresses(tmp_path: Path) -> None:
    system = fsspec.filesystem("memory")
    (file,) = write_all(tmp_path, refused_session, 1)
    for name in ("/bench7/monday/a.h5", "/bench7/b.h5"):
        system.pipe_file(name, file.read_bytes())
    system.pipe_file("/bench7/notes.txt", b"none")
    found = session_files(["memory://bench7", "memory://bench7/*.h5"])
    assert found == ["memory:///bench7/b.h5", "memory:///bench7/monday/a.h5"]
    job = job_of(found[0])
    assert job.sha256 == job_of(str(file)).sha256
    row = row_of(job)
    assert (row["file"], row["verdict"]) == (found[0], "refused")
    gone = job_of("memory://bench7/gone.h5")
    assert gone.sha256 == ""
    assert "gone.h5" in str(row_of(gone)["reasons"])


def test_a_session_in_an_archive_or_through_a_cache_keeps_its_whole_address(tmp_path: Path) -> None:
    (file,) = write_all(tmp_path, refused_session, 1)
    archive = tmp_path / "all.zip"
    with ZipFile(archive, "w") as packed:
        packed.write(file, "monday/a.h5")
    inside = session_files([f"zip://*/*.h5::file://{archive}"])
    assert inside == [f"zip://monday/a.h5::file://{archive}"]
    cached = session_files([f"simplecache::file://{tmp_path}"])
    assert cached == [f"simplecache::file://{file}"]
    for address in (*inside, *cached):
        job = job_of(address)
        assert job.sha256 == job_of(str(file)).sha256
        assert row_of(job)["verdict"] == "refused"


def test_a_file_that_is_no_session_is_named_once(tmp_path: Path) -> None:
    """Of an address the reason named the copy, which is gone."""
    broken = tmp_path / "broken.h5"
    broken.write_text("no HDF5")
    for name in (str(broken), f"file://{broken}"):
        row = row_of(job_of(name))
        assert row["verdict"] == "failed"
        assert str(row["reasons"]).startswith("is not an HDF5 file")


@pytest.mark.parametrize("name", ["memory://none/", "nosuch://x/y.h5", "memory://none/*.h5"])
def test_an_address_without_sessions_is_named(name: str) -> None:
    with pytest.raises(InputError, match=r"no session file there|cannot be reached") as error:
        session_files([name])
    assert "\n" not in str(error.value)


def test_sigterm_keeps_the_rows_and_leaves_no_half_file(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    files = write_all(tmp_path / "s", refused_session, 4)
    before = signal.getsignal(signal.SIGTERM)
    stop = progress_that(lambda: os.kill(os.getpid(), signal.SIGTERM), rows=2)
    monkeypatch.setattr(output, "progress", stop)
    arguments = [
        "--workers",
        "1",
        "--out",
        str(tmp_path / "set"),
        "--page",
        str(tmp_path / "p.html"),
    ]
    with pytest.raises(SystemExit) as ended:
        run(["batch", *map(str, files), *arguments])
    assert ended.value.code == 143
    assert signal.getsignal(signal.SIGTERM) is before
    assert capsys.readouterr().err.splitlines()[-1].startswith("bumpbench: stopped; the rows")
    assert len(_dataset(tmp_path / "set")) == len(_data(tmp_path / "p.html")["rows"]) == 2
    assert {path.name for path in tmp_path.iterdir()} == {"s", "set", "set.jsonl", "p.html"}


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_whose_name_is_not_utf_8_has_its_row(ending: str, tmp_path: Path) -> None:
    row = row_of(job_of(str(tmp_path / "a\udcff.h5")))
    assert row["file"] == str(tmp_path / "a\\udcff.h5")
    out = tmp_path / f"t.{ending}"
    write_outputs(out, tmp_path / "p.html", write_journal(tmp_path / "j", [row]))
    assert b"a\\udcff.h5" in out.read_bytes()


def test_a_link_that_leads_nowhere_is_one_session_that_fails(tmp_path: Path) -> None:
    """It hid all others of its folder: "holds no session file"."""
    for name in ("a.h5", "c.h5"):
        (tmp_path / name).touch()
    (tmp_path / "b.h5").symlink_to("gone.h5")
    (tmp_path / "folder.h5").mkdir()
    files = [str(tmp_path / name) for name in ("a.h5", "b.h5", "c.h5")]
    assert session_files([str(tmp_path)]) == files
    assert session_files([str(tmp_path / "*.h5")]) == files
    assert "no such file" in str(row_of(job_of(files[1]))["reasons"])
    with pytest.raises(InputError, match="no such file"):
        session_files([files[1]])
    for path in map(Path, files):
        path.unlink()
    with pytest.raises(InputError, match="holds no session file"):
        session_files([str(tmp_path)])
