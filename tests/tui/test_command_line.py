"""One way to name things, near misses, and JSON from every command that prints a result."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from daq.bench.config import default_bench_text
from tui.bench import named_once
from tui.cli import run
from tui.diagnostics import unknown_value


def test_version_and_short_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.split()[0] == "bumpbench"
    assert run(["-h"]) == 0
    whole = capsys.readouterr().out
    assert "At the bench" in whole
    assert run(["status", "-h"]) == 0
    assert "The recorder's folder" in capsys.readouterr().out


def test_a_mistyped_value_is_answered_by_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["export", "x.h5", "--format", "mf5"]) == 2
    assert "Did you mean mf4?" in capsys.readouterr().err
    assert run(["export", "x.h5", "--format", "zzzzzz"]) == 2
    assert "Did you mean" not in capsys.readouterr().err
    assert run(["tui", "--demo", "--fault", "double-bum"]) == 2
    assert "did you mean double-bump?" in capsys.readouterr().err
    assert "mean" not in str(unknown_value("--theme", "zzz", "theme", ["bench-dark"]))


def test_status_of_a_folder_without_a_recorder_is_a_document(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["status", str(tmp_path), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document == {
        "folder": str(tmp_path),
        "running": False,
        "error": "no recorder is running there",
    }


def test_notebook_as_a_document(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "a.ipynb"
    assert run(["notebook", "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"files": [str(out)]}


@pytest.mark.parametrize(
    "words",
    [
        ["plan", "BENCH", "--bench", "BENCH"],
        ["decode", "a.blf", "BENCH", "--config", "BENCH"],
        ["redecode", "a.h5", "BENCH", "--config", "BENCH"],
        ["replay", "a.blf", "BENCH", "--config", "BENCH"],
        ["import", "a.blf", "BENCH", "--config", "BENCH"],
        ["check", "BENCH", "a.blf", "--log", "a.blf"],
    ],
)
def test_a_bench_is_an_argument_and_the_earlier_option_still_works(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench = tmp_path / "my-bench.toml"
    bench.write_text(default_bench_text(), "utf-8")
    assert run([str(bench) if word == "BENCH" else word for word in words]) == 2
    assert "is named twice" in capsys.readouterr().err
    assert run([words[0], "--help"]) == 0
    shown = capsys.readouterr().out
    assert not {"--config", "--bench ", "--log "}.intersection(shown.split())


def test_a_log_named_alone_is_no_bench(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "absent.blf"]) == 2
    assert "TOML" not in capsys.readouterr().err


def test_named_once() -> None:
    one = Path("one")
    assert named_once(one, None, "x") == named_once(None, one, "x") == one
    assert named_once(None, None, "x") is None
