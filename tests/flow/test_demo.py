"""The demo as its users run it, and what can be done with what it leaves behind."""

from __future__ import annotations

import os
import shlex
import time
from pathlib import Path

import numpy as np
import pytest

import daq
from daq.bench.config import default_bench_text
from daq.control.address import control_address, is_running
from daq.control.exchange import Client
from daq.journal.reader import recordings, segments_in
from tui.commands.demo import next_commands

from ..daq.crash_frames import read_journal
from ..tui.conftest import answered
from .bench_terminal import PATIENCE_S, PtyTerminal, end_recorder


def test_demo(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    once = default_bench_text().replace("repeats = 2", "repeats = 1")
    monkeypatch.setattr("daq.bench.config.default_bench_text", lambda: once)
    out = tmp_path / "a demo"
    result = answered(capsys, "demo", "--seed", "11", "--out", str(out))[0]
    assert result["verdict"] == "ok", result["reasons"]
    assert 0.9 < result["chi2_per_n"] < 1.1
    assert len(result["parameters"]) == 15
    for name, estimate in result["parameters"].items():
        assert abs(estimate["value"] / result["truth"][name] - 1) < 0.02
        assert estimate["low"] < estimate["value"] < estimate["high"]
        assert estimate["std"] > 0
        assert estimate["unit"]
    # docs/method.md, "The vehicle": of the car without and with the shipped weights.
    frequencies = [mode["frequency_hz"] for mode in result["modes"]["baseline"]]
    expected = [1.0511, 1.3078, 1.6516, 10.7678, 10.7712, 11.2859, 11.2881]
    np.testing.assert_allclose(frequencies, expected, rtol=0.005)
    assert len(result["modes"]["added"]) == 7

    session = Path(result["session"])
    again = answered(capsys, "identify", str(session))[0]
    assert again == {key: result[key] for key in again}  # digit for digit

    runs = answered(capsys, "inspect", str(session))[0]["runs"]
    assert len(runs) == 6
    assert all(not any(run["losses"].values()) for run in runs)

    # Every frame that the car sent is in the journal, and those of a run are in the session.
    campaign, *_ = recordings(out / "journal")  # what follows it is on the bus afterwards
    journal = read_journal(campaign.segments)
    assert not journal.lost.any
    first = daq.read_session(session).runs[0].frames
    start = int(np.searchsorted(journal.frames.t_ns, first.t_ns[0]))
    same = journal.frames.select(slice(start, start + len(first)))
    np.testing.assert_array_equal(same.data, first.data)

    # The commands with which it ends can be pasted, also where no shell knows the program.
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", os.defpath)
    *desk, bench = next_commands(session)
    for command in desk:
        program, *words = shlex.split(command)
        assert os.access(program, os.X_OK)
        assert str(session) in words
    # A terminal on the demonstration is started below.
    assert shlex.split(bench)[1:] == ["tui", "--demo", "--out", "bumpbench-tui"]


# The last terminal goes ---------------------------------------------------------------------------

LEFT_S = 10.0
"""Seconds without any client after which it ends."""


@pytest.mark.parametrize("looks_on_s", [0.5, pytest.param(LEFT_S + 2.0, marks=pytest.mark.long)])
def test_after_a_kill_of_the_last_terminal_the_demonstration_ends(
    tmp_path: Path, looks_on_s: float
) -> None:
    folder = tmp_path / "demo"
    address = control_address(folder)
    terminal = PtyTerminal("--demo", "--out", str(folder))
    try:
        terminal.until(b"Ford Granada")
        onlooker = Client(address, "onlooker", control=False)
        terminal.kill()
        looks_on_until_s = time.monotonic() + looks_on_s
        while time.monotonic() < looks_on_until_s:
            assert is_running(address)
            time.sleep(0.2)
        onlooker.close()
        alone_s = time.monotonic()
        while is_running(address) or any("open" in s.name for s in segments_in(folder / "journal")):
            assert time.monotonic() - alone_s < PATIENCE_S
            time.sleep(0.2)
        assert time.monotonic() - alone_s > LEFT_S - 1.0
        assert "the last terminal has gone" in (folder / "recorder.log").read_text()
    finally:
        end_recorder(folder)
