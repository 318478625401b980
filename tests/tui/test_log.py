"""A recorder's log, which holds nothing up, and its status in words."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import warnings
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from daq.bench.campaign import Origin, Step
from daq.control.messages import (
    Alarm,
    Due,
    Phase,
    SessionState,
    SessionStatus,
    Status,
    StorageStatus,
    Tally,
)
from daq.runlog import LoggedRun
from daq.runs import Excitation, Losses, RunStatus
from dbc.words import Finding, InputError, Severity
from tui.recorders.lines import news, progress_words, status_lines
from tui.recorders.log import BURST, Log

from ..daq.a_status import a_status

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


def test_of_what_repeats_only_the_first_lines_of_a_minute_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    assert lines[:BURST] == ["bumpbench: bus silent\\x1b[2J"] * BURST
    assert lines[BURST:] == ["bumpbench: another", "bumpbench: bus silent"]


@pytest.mark.filterwarnings("always")
def test_warnings_of_libraries_come_here(tmp_path: Path) -> None:
    path = tmp_path / "recorder.log"
    with Log(path):
        logging.getLogger("can.slcan").error("no answer")
        warnings.warn("old", DeprecationWarning, stacklevel=1)
    text = path.read_text()
    assert "can.slcan: no answer" in text
    assert "DeprecationWarning" in text


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


# The status in words ------------------------------------------------------------------------------

SILENT = Alarm("bus_silent", "can0", "no frame for 2 s", "check the cable", 7)
FULL = Alarm("disk_full", "", "1 GB left", "make room", 7)
RUN = LoggedRun("baseline_roll_1", "baseline", Excitation.ROLL, 1, 5)
TALLIES = (
    Tally("baseline", Excitation.BOUNCE, 3, 2, 1),
    Tally("baseline", Excitation.ROLL, 1, 2, 0),
)


def said(before: Status | None, status: Status) -> list[tuple[str, str]]:
    return list(news(before, status))


def test_a_recorder_begins_its_log_with_vehicle_origin_and_folder() -> None:
    status = a_status()
    assert said(None, status) == [("recording Granada into /var/lib/bumpbench", "")]
    simulated = replace(status, origin=Origin.SIMULATED)
    assert said(None, simulated)[0][0] == "recording Granada (simulated) into /var/lib/bumpbench"
    assert said(status, status) == []


def test_an_alarm_is_logged_when_it_comes_and_when_it_is_over() -> None:
    quiet, loud = a_status(), a_status(alarms=(SILENT, FULL))
    assert said(quiet, loud) == [
        ("alarm bus_silent can0: no frame for 2 s (check the cable)", "bus_silent can0"),
        ("alarm disk_full: 1 GB left (make room)", "disk_full"),
    ]
    assert said(loud, loud) == []
    assert said(loud, replace(loud, alarms=(replace(SILENT, text="for 3 s"), FULL))) == []
    assert said(loud, quiet) == [
        ("over: bus_silent can0", "over bus_silent can0"),
        ("over: disk_full", "over disk_full"),
    ]
    assert [key for _, key in said(None, loud)] == ["", "bus_silent can0", "disk_full"]
    ended = replace(quiet, recording="")
    assert said(loud, ended) == [("campaign of Granada ended", "")], "the cause may go on"
    assert ("over: disk_full", "over disk_full") in said(replace(loud, recording=""), ended)


def test_each_verdict_is_logged_once() -> None:
    before = replace(a_status(), runs=(RUN,))
    rejected = replace(RUN, status=RunStatus.REJECTED, by="MK", reason="wind")
    after = replace(before, runs=(rejected, replace(RUN, label="baseline_roll_2")))
    assert said(before, after) == [
        ("baseline_roll_1 rejected: rejected by MK: wind", ""),
        ("baseline_roll_2 open", ""),
    ]
    assert said(after, replace(after, runs=(*after.runs,))) == []
    assert said(None, after) == [said(None, a_status())[0]]


def test_a_rejection_names_the_cause_to_look_for() -> None:
    weak = Finding("too_weak", Severity.ERROR, "peak 4 m/s2", advice="use a higher bump")
    rejected = replace(RUN, status=RunStatus.REJECTED, findings=(weak,))
    before = replace(a_status(), runs=(RUN,))
    lines = said(before, replace(before, runs=(rejected,)))
    assert lines == [("baseline_roll_1 rejected: peak 4 m/s2 (use a higher bump)", "")]


def test_a_session_file_that_failed_is_logged_once() -> None:
    before = a_status()
    failed = replace(before, session=SessionStatus(SessionState.FAILED, "a.h5", "no room"))
    advice = "the journal has it all: make room if the disk is full, then `bumpbench recover`"
    assert said(before, failed) == [(f"session a.h5: no room ({advice})", "")]
    assert said(None, failed)[0] == (f"session a.h5: no room ({advice})", "")
    assert said(failed, replace(failed)) == []
    ready = replace(before, session=SessionStatus(SessionState.READY, "a.h5"))
    assert said(before, ready) == []


def test_progress_counts_the_planned_runs_and_not_those_beyond() -> None:
    due = Due(Step("baseline", Excitation.ROLL, 2), 1, 2, 0, "roll")
    status = replace(a_status(), tallies=TALLIES, due=due, losses=Losses())
    assert progress_words(status) == (0.75, "3 of 4 runs, waiting for baseline_roll_2")
    for phase in (Phase.TRIGGERED, Phase.DECAY):
        running = progress_words(replace(status, phase=phase))[1]
        assert running == "3 of 4 runs, baseline_roll_2 running"
    armed = progress_words(replace(status, phase=Phase.ARMED))[1]
    assert armed.endswith("waiting for baseline_roll_2")
    assert progress_words(replace(status, due=None)) == (0.75, "3 of 4 runs")
    assert progress_words(replace(status, tallies=(), due=None)) == (0.0, "0 of 0 runs")


def test_progress_says_what_is_wrong_with_the_frames() -> None:
    status = replace(a_status(), losses=Losses(counter_gaps=4))
    assert progress_words(status)[1] == "0 of 0 runs, 4 frames lost"
    spoilt = replace(status, losses=Losses(counter_gaps=4, crc_bad=100))
    assert progress_words(spoilt)[1] == "0 of 0 runs, 4 frames lost, 100 unusable"
    spoilt = replace(status, losses=Losses(wrong_length=1))
    assert progress_words(spoilt)[1] == "0 of 0 runs, 1 frame unusable"
    # can0 and can1 have 12345 and 6000 frames.
    strange = replace(status, losses=Losses(unknown_id=18_345))
    assert progress_words(strange)[1] == "0 of 0 runs, none of 18,345 frames is in the DBC"
    assert progress_words(replace(status, losses=Losses(unknown_id=18_344)))[1] == "0 of 0 runs"
    silent = replace(status, buses=status.buses[2:], losses=Losses())
    assert progress_words(silent)[1] == "0 of 0 runs, no frame yet"


def test_a_status_has_a_line_for_each_of_its_parts() -> None:
    storage = StorageStatus(received_frames=18_400, stored_frames=18_345, late_s=2.5)
    status = replace(
        a_status(alarms=(SILENT, FULL)), tallies=TALLIES, storage=storage, begun="it goes on",
        controller="MK", viewers=2, losses=Losses(),
    )  # fmt: skip
    head, *lines = status_lines(status)
    assert head.startswith("Granada, into /var/lib/bumpbench: ")
    assert lines == [
        "idle: 3 of 4 runs",
        "campaign: it goes on",
        "bus can0: ok, 9,000 frames/s, load 50%, 12,345 frames, 2 error frames",
        "bus can1: ok, 3,031 frames/s, load 25%, 6,000 frames, 0 error frames",
        "bus can2: disconnected, 0 frames/s, load 0%, 0 frames, 0 error frames",
        "recording: 18,345 of 18,400 frames stored since the start, 18,345 frames on the disk; "
        "journal 5 MB",
        "in control: MK; 2 viewers",
        "ALARM bus_silent can0: no frame for 2 s (check the cable)",
        "ALARM disk_full: 1 GB left (make room)",
    ]
    stuck = replace(status, alarms=(Alarm("not_recording", "", "x", "y", 1),), controller="")
    lines = list(status_lines(stuck))
    assert any(line.startswith("NOT RECORDING for 2.5 s: 18,345 of 18,400") for line in lines)
    assert "in control: no terminal; 2 viewers" in lines
    plain = replace(status, begun="", origin=Origin.REPLAYED)
    assert next(status_lines(plain)).startswith("Granada (replayed), into ")
    assert not any(line.startswith("campaign") for line in status_lines(plain))
