"""No command writes through a link that somebody laid, or over a file that was not named to it.

Each command is run once while the names of all files that it opens for writing, or moves, are
noted.  Then somebody lays a link to a file of the user's under each of these names, and under the
names that can be guessed, and the command is run again.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import daq
from daq.files import refuse_existing
from dbc import InputError
from tests.daq.crash_frames import journal_of_runs
from tui.cli import run

from ..daq.small_campaign import bumps, small_codec
from ..daq.small_session import small_session
from .test_import import BENCH, write_drive, write_log
from .test_report import session as identified

identified = identified  # a fixture of the module of that name
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT
_noted: list[set[str]] = []


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if not _noted or event not in ("open", "os.rename", "os.link"):
        return
    path, _, flags = (*arguments, None, None)[:3]
    if isinstance(path, str | bytes | os.PathLike) and (
        event != "open" or (isinstance(flags, int) and flags & _WRITES)
    ):
        _noted[-1].add(os.fsdecode(path))


@pytest.fixture(scope="module", autouse=True)
def _hook() -> None:
    sys.addaudithook(_note)


@contextmanager
def _names_written() -> Iterator[set[str]]:
    _noted.append(set())
    try:
        yield _noted[-1]
    finally:
        _noted.pop()


COMMANDS = {
    "import": ("s.h5", ["import", "all.log", "bench.toml", "--out", "s.h5"]),
    "redecode": ("s.h5", ["redecode", "imported.h5", "bench.toml", "--out", "s.h5"]),
    "mat": ("s.mat", ["export", "car.h5", "--format", "mat", "--out", "s.mat"]),
    "csv": ("s.json", ["export", "car.h5", "--format", "csv", "--out", "s.csv"]),
    "parquet": ("s.parquet", ["export", "car.h5", "--format", "parquet", "--out", "s.parquet"]),
    "mf4": ("s.mf4", ["export", "car.h5", "--format", "mf4", "--out", "s.mf4"]),
    "candump": ("s.log", ["export", "imported.h5", "--format", "log", "--out", "s.log"]),
    "uff": ("s.uff", ["export", "car.h5", "--format", "uff", "--out", "s.uff"]),
    "asc": ("s.asc", ["export", "imported.h5", "--format", "asc", "--out", "s.asc"]),
    "blf": ("s.blf", ["export", "imported.h5", "--format", "blf", "--out", "s.blf"]),
    "notebook": ("s.ipynb", ["notebook", "--out", "s.ipynb"]),
    "check": ("s.toml", ["check", "bench.toml", "--propose", "s.toml"]),
    "map": ("s.h5", ["import", "drive.csv", "--channels", "map.toml", "--out", "s.h5"]),
    "batch": ("s.csv", ["batch", "car.h5", "--workers", "1", "--out", "s.csv"]),
    "page": ("s.html", ["batch", "car.h5", "--workers", "1", "--page", "s.html"]),
    "recover": ("s.h5", ["recover", "journal", "--out", "s.h5"]),
    "report": (
        "s.pdf",
        ["report", "identified.h5", "--out", "s.html", "--pdf", "s.pdf", "--figures", "figures"],
    ),
    "study": ("s.svg", ["study", "fig2", "--figure", "s.svg"]),
    "compare": ("s.html", ["compare", "identified.h5", "identified.h5", "--page", "s.html"]),
}
_FORCED = {"report", "compare", "study"}
"""Commands that replace a page without a word."""

_SLOW = {"report", "compare"}
"""Commands that identify a whole car, twice."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory, identified: Path) -> Path:
    """Return a folder with what the commands read."""
    folder = tmp_path_factory.mktemp("inputs")
    daq.write_session(folder / "car.h5", small_session())
    shutil.copy(identified, folder / "identified.h5")
    (folder / "bench.toml").write_text(BENCH)
    write_log(folder / "all.log", bumps(small_codec(), 4))
    words = ["import", str(folder / "all.log"), str(folder / "bench.toml")]
    assert run([*words, "--out", str(folder / "imported.h5")]) == 0
    journal_of_runs(folder / "journal", 20_000)
    write_drive(folder)
    rows = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(400))
    (folder / "table.csv").write_text("time [s],z_acc [m/s2],roll rate [rad/s]\n" + rows)
    return folder


@pytest.mark.parametrize(
    "command",
    [pytest.param(c, marks=pytest.mark.long) if c in _SLOW else c for c in COMMANDS],
)
def test_a_link_in_a_shared_folder_leads_nowhere(
    command: str, inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, words = COMMANDS[command]
    shutil.copytree(inputs, folder := tmp_path / "shared")
    monkeypatch.chdir(folder)
    mine = tmp_path / "mine"
    mine.write_text("somebody's work")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with _names_written() as names:
        first = run(words)
    written = {path for path in folder.rglob("*") if path.is_file()} - before.keys()
    assert folder / name in written or command == "csv"
    stem, _, suffix = name.partition(".")
    guessed = {f".{name}.tmp", f".{stem}.{os.getpid()}.tmp.{suffix}"}
    laid = written | {folder / each for each in names | guessed}
    for place in laid - before.keys():
        if place.is_relative_to(folder) and not place.is_dir():
            place.unlink(missing_ok=True)
            place.symlink_to(mine)
    assert run([*words, *([] if command in _FORCED else ["--force"])]) == first
    assert mine.read_text() == "somebody's work"
    assert {path: path.read_bytes() for path in before} == before
    for place in written:
        assert place.is_file()
        assert not place.is_symlink()


def test_no_recorder_logs_through_a_link(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (mine := tmp_path / "mine").write_text("")
    (tmp_path / "log").symlink_to(mine)
    words = ["record", "--log", str(tmp_path / "log"), "--out", str(tmp_path / "out")]
    assert run(words) == 2
    assert "is not an ordinary file" in capsys.readouterr().err
    assert mine.read_text() == ""


# Files that are there -----------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the working directory, with a session, a log and its bench."""
    monkeypatch.chdir(tmp_path)
    daq.write_session(tmp_path / "car.h5", small_session())
    (tmp_path / "bench.toml").write_text(BENCH)
    write_log(tmp_path / "all.log", bumps(small_codec(), 4))
    assert run(["import", "all.log", "bench.toml", "--out", "imported.h5"]) == 0
    return tmp_path


WRITERS = [
    ("session.h5", ["import", "all.log", "bench.toml"], 0),
    ("again.h5", ["redecode", "imported.h5", "bench.toml", "--out", "again.h5"], 0),
    ("imported_redecoded.h5", ["redecode", "imported.h5", "bench.toml"], 0),
    ("car.mat", ["export", "car.h5", "--format", "mat"], 0),
    ("bump_test.ipynb", ["notebook"], 0),
    ("new.toml", ["check", "bench.toml", "--propose", "new.toml"], 0),
    ("rows.csv", ["batch", "car.h5", "--workers", "1", "--out", "rows.csv"], 1),
]


@pytest.mark.parametrize(("name", "words", "code"), WRITERS)
def test_an_existing_file_is_replaced_after_a_word_alone(
    folder: Path, name: str, words: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    (there := folder / name).write_text("measured by hand")
    capsys.readouterr()
    assert run(words) == 2
    out, err = capsys.readouterr()
    option = "--propose" if name == "new.toml" else "--out"
    advice = f"name another file with {option}, or use --force"
    assert (out, err) == ("", f"bumpbench: error: {name}: exists already ({advice})\n")
    assert there.read_text() == "measured by hand"
    assert run([*words, "--force"]) == code
    assert there.read_bytes() != b"measured by hand"


@pytest.mark.parametrize(
    ("words", "target"),
    [
        (["import", "all.log", "bench.toml", "--out", "all.log"], "all.log"),
        (["import", "--run", "baseline:roll:all.log", "--out", "all.log"], "all.log"),
        (["redecode", "imported.h5", "bench.toml", "--out", "imported.h5"], "imported.h5"),
        (["redecode", "imported.h5", "bench.toml", "--out", "bench.toml"], "bench.toml"),
        (["export", "car.h5", "--format", "mat", "--out", "car.h5"], "car.h5"),
        (["check", "bench.toml", "--propose", "bench.toml"], "bench.toml"),
        (["check", "bench.toml", "all.log", "--propose", "all.log"], "all.log"),
    ],
)
def test_no_word_lets_a_command_replace_what_it_reads(
    folder: Path, words: list[str], target: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / target).read_bytes()
    capsys.readouterr()
    assert run([*words, "--force"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"bumpbench: error: {target}: is read here (name another file with --")
    assert err.count("\n") == 1
    assert (folder / target).read_bytes() == before


def test_a_folder_and_a_link_are_not_replaced_either(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(InputError, match="is a directory"):
        refuse_existing(tmp_path, replace=True)
    with pytest.raises(InputError, match="exists already"):
        refuse_existing(tmp_path / "link", replace=False)
    refuse_existing(tmp_path / "new", replace=False, inputs=[tmp_path / "old"])
