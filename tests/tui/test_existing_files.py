"""No command replaces a file that is there, unless --force says so; and none its own input."""

from __future__ import annotations

from pathlib import Path

import pytest

import daq
from daq.files import refuse_existing
from dbc import InputError
from tui.cli import run

from ..daq.small_campaign import bumps, small_codec
from ..daq.small_session import small_session
from .test_import import BENCH, write_log


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
    ("model.mat", ["identify", "car.h5", "--model", "model.mat"], 2),  # it is refused
    ("curves.csv", ["identify", "car.h5", "--dampers", "curves.csv"], 2),
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
    option = {"model.mat": "--model", "curves.csv": "--dampers", "new.toml": "--propose"}
    advice = f"name another file with {option.get(name, '--out')}, or use --force"
    assert (out, err) == ("", f"bumpbench: error: {name}: exists already ({advice})\n")
    assert there.read_text() == "measured by hand"
    assert run([*words, "--force"]) == code
    if code != 2:
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
