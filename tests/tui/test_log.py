"""Logging that holds nothing up: a full pipe, a storm of lines, a reader that has gone."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
import warnings
from datetime import UTC, datetime
from pathlib import Path

import pytest

from daq.errors import InputError
from tui.cli import run
from tui.recorders.log import BURST, Log
from tui.recorders.process import start_recorder

STAMP = "2026-11-22T08:30:00.062Z"
STORM = """
import logging, sys, threading, warnings
from tui.recorders.log import Log
with Log(None) as log:
    for i in range(5_000):
        log.line("x" * 100)
        logging.getLogger("can").warning("y %d", i)
        warnings.warn(f"z {i}")
print("went on", flush=True)
"""


def test_a_full_pipe_holds_nothing_up() -> None:
    """R15: plain logging froze the process after 700 lines."""
    reader, writer = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-c", STORM], stdout=subprocess.PIPE, stderr=writer
    ) as process:
        os.close(writer)
        out, _ = process.communicate(timeout=60)
    os.close(reader)
    assert out == b"went on\n"
    assert process.returncode == 0


def test_a_line_is_not_glued_to_a_bar_of_progress() -> None:
    master, terminal = os.openpty()
    script = "from tui.recorders.log import Log\nwith Log(None) as log: log.line('alarm')"
    with subprocess.Popen([sys.executable, "-c", script], stderr=terminal) as process:
        assert process.wait(60) == 0
    assert os.read(master, 1000) == b"\r\x1b[Kbumpbench: alarm\r\n"
    os.close(terminal)
    os.close(master)


def test_what_repeats_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("tui.recorders.log.time.monotonic", lambda: clock[0])
    path = tmp_path / "logs" / "recorder.log"
    with Log(path) as log:
        for _ in range(100):
            log.line("bus silent\x1b[2J", "silent")
        log.line("another")
        clock[0] = 61.0
        log.line("bus silent", "silent")
    lines = [line.partition(" ")[2] for line in path.read_text().splitlines()]
    assert len(lines) == BURST + 2
    assert lines[0] == "bumpbench: bus silent\\x1b[2J"
    assert lines[-2:] == [
        "bumpbench: another",
        f"bumpbench: bus silent (and {100 - BURST} more of these)",
    ]


@pytest.mark.filterwarnings("always")
def test_libraries_warnings_and_dying_threads_come_here(tmp_path: Path) -> None:
    path = tmp_path / "recorder.log"
    with Log(path):
        logging.getLogger("can.slcan").error("no answer")
        warnings.warn("old", DeprecationWarning, stacklevel=1)
        thread = threading.Thread(target=lambda: 1 / 0, name="reader can0")
        thread.start()
        thread.join()
    text = path.read_text()
    assert "can.slcan: no answer" in text
    assert "DeprecationWarning" in text
    assert "reader can0 ended: ZeroDivisionError" in text


@pytest.mark.parametrize(("size", "kept"), [(900_000, False), (1_000_000, True)])
def test_a_full_file_is_kept_beside_the_new_one(tmp_path: Path, size: int, kept: bool) -> None:
    path, before = tmp_path / "recorder.log", tmp_path / "recorder.log.1"
    before.write_text(f"{STAMP} bumpbench: the one before that\n")
    full = f"{STAMP} bumpbench: ".encode().ljust(size, b"x")
    path.write_bytes(full)
    with Log(path) as log:
        log.line("begun anew")
    assert path.read_text().endswith("bumpbench: begun anew\n")
    assert (len(path.read_bytes()) < 100) is kept
    assert (before.read_bytes() == full) is kept
    with pytest.raises(InputError, match="another file for the log"):
        Log(tmp_path)


def test_a_line_in_a_file_has_the_time_in_utc_at_which_it_was_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    path = tmp_path / "recorder.log"
    before = datetime.now(UTC)
    with Log(path) as log:
        log.line("alarm")
    stamp, text = path.read_text().split(" ", 1)
    assert text == "bumpbench: alarm\n"
    assert -0.01 < (datetime.fromisoformat(stamp) - before).total_seconds() < 30


FOREIGN = {
    "car.toml": b'dbc = "car.dbc"\n',
    "report.pdf": b"%PDF-1.7\n\xe2\xe3\xcf\xd3",
    "syslog": b"2026-11-22T08:30:00.250Z sensord: started\n",
    "line": b"\n",
}


@pytest.mark.parametrize(
    ("name", "content"),
    list(zip(["recorder.log", "recorder.log.1"] * 2, FOREIGN.values(), strict=True)),
)
def test_a_file_that_no_log_has_begun_is_neither_continued_nor_replaced(
    tmp_path: Path, name: str, content: bytes
) -> None:
    (foreign := tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as raised:
        Log(tmp_path / "recorder.log")
    what = "is there already and is not a log of bumpbench (name another file for the log)"
    assert str(raised.value) == f"{foreign}: {what}"
    assert foreign.read_bytes() == content


def test_a_pipe_is_refused_without_waiting_for_its_reader(tmp_path: Path) -> None:
    os.mkfifo(path := tmp_path / "recorder.log")
    with pytest.raises(InputError, match="is not an ordinary file"):
        Log(path)


def test_a_recorder_refuses_a_foreign_log_before_it_makes_or_locks_anything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (foreign := tmp_path / "car.toml").write_bytes(FOREIGN["car.toml"])
    out = tmp_path / "today"
    assert run(["record", "--out", str(out), "--log", str(foreign)]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"bumpbench: error: {foreign}: is there already")
    assert err.count("\n") == 1
    assert not out.exists()
    (folder_log := tmp_path / "recorder.log").write_bytes(FOREIGN["syslog"])
    with pytest.raises(InputError, match="is not a log of bumpbench"):
        start_recorder(tmp_path)
    assert folder_log.read_bytes() == FOREIGN["syslog"]
