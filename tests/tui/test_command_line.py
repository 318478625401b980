"""One way to name things, near misses, and JSON from every command that prints a result."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock
from typer.core import TyperGroup
from typer.main import get_command

from tui.bench import bench_and_log, log_and_bench
from tui.cli import app, run


def test_version_and_short_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.split()[0] == "bumpbench"
    assert run(["-h"]) == 0
    whole = capsys.readouterr().out
    assert "At the bench" in whole
    assert run(["status", "-h"]) == 0
    assert "The recorder's folder" in capsys.readouterr().out


def test_bench_and_log_are_named_in_either_order() -> None:
    bench, log, other = Path("b.TOML"), Path("a.pcapng"), Path("mine")
    assert log_and_bench(log, bench) == log_and_bench(bench, log) == (log, bench)
    assert log_and_bench(log, None) == (log, None)
    assert log_and_bench(log, other) == (log, other)
    assert bench_and_log(bench, log) == bench_and_log(log, bench) == (bench, log)
    assert bench_and_log(log, None) == (None, log)
    assert bench_and_log(bench, None) == (bench, None)
    assert bench_and_log(other, None) == (other, None)
    assert bench_and_log(None, log) == (None, log)
    assert bench_and_log(None, None) == (None, None)


def test_a_reader_of_stdout_that_has_gone_is_no_refusal() -> None:
    """`bumpbench ... | head -1` under pipefail."""
    script = "from tui.cli import run; raise SystemExit(run(['simulate', '--help']))"
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 0


def test_status_says_why_there_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["status", str(tmp_path / "absent")]) == 1
    assert "absent: there is no such folder" in capsys.readouterr().err
    assert run(["status", str(tmp_path)]) == 1
    assert list(tmp_path.iterdir()) == [], "who asks leaves nothing"
    with FileLock(tmp_path / "recorder.lock"):
        (tmp_path / "recorder.pid").write_text("4711", "ascii")
        assert run(["status", str(tmp_path)]) == 1
    said = "a recorder (pid 4711) writes there, but does not answer here"
    assert said in capsys.readouterr().err


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


@pytest.mark.parametrize("arguments", [[], ["study"]])
def test_saying_nothing_asks_for_help(
    capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    assert run(arguments) == 0
    assert "Usage: bumpbench" in capsys.readouterr().out


def test_help_of_every_command_is_on_stdout(capsys: pytest.CaptureFixture[str]) -> None:
    top = get_command(app)
    assert isinstance(top, TyperGroup)
    names = [[name] for name in top.commands if name != "study"]
    for words in ([], *names, ["study", "noise"]):
        assert run([*words, "--help"]) == 0
        out, err = capsys.readouterr()
        assert out.startswith("Usage: bumpbench")
        assert err == ""
