"""One way to name things, near misses, and JSON from every command that prints a result."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

from daq.bench.config import default_bench_text
from tui.bench import bench_and_log, log_and_bench, named_once
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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["tui", "--demoo"],
            ": --demoo. Did you mean --demo? (bumpbench tui --help lists what there is)",
        ),
        (
            ["tui", "--speed", "fast"],
            "'--speed': must be a valid number (bumpbench tui --help lists what there is)",
        ),
        (["study", "tabel2"], "(bumpbench study --help lists what there is)"),
        (["recrod"], "(bumpbench --help lists what there is)"),
        (
            ["check", "--interface", "socketcn", "--channel", "can0"],
            "no interface 'socketcn' (did you mean socketcan?",
        ),
    ],
)
def test_a_mistake_names_the_nearest_and_the_help_that_lists_it(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    run(words)
    assert said in capsys.readouterr().err


def test_a_channel_without_signal_is_named_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bench, log = tmp_path / "b.toml", tmp_path / "a.log"
    bench.write_text(default_bench_text().replace("IMU_Accel.acc_z", "IMU_Accel.acc_zz"), "utf-8")
    log.write_text("(1.0) can0 100#00\n", "ascii")
    number = default_bench_text().splitlines().index('signal = "IMU_Accel.acc_z"') + 1
    for words in (["check", str(bench), str(log)], ["plan", str(bench)]):
        assert run(words) == 2
        shown = capsys.readouterr().err
        assert f"{bench}:{number}: signal of channel body_acc_z: " in shown
        assert "has no signal 'IMU_Accel.acc_zz' (did you mean IMU_Accel.acc_z?)" in shown


@pytest.mark.parametrize("key", ["counter", "crc", "time_signal"])
def test_a_signal_that_a_message_does_not_have_is_named_with_file_and_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str
) -> None:
    bench = tmp_path / "b.toml"
    table = f'\n[[message]]\nname = "IMU_Accel"\n{key} = "nope"\n'
    bench.write_text(default_bench_text() + table, "utf-8")
    (log := tmp_path / "a.log").write_text("(1.0) can0 100#00\n", "ascii")
    assert run(["check", str(bench), str(log)]) == 2
    shown = capsys.readouterr().err
    assert f"{bench}: message IMU_Accel: has no signal nope, which {key} names (" in shown


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
