"""A recorder that a terminal started for a demonstration ends with its last terminal."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from daq.control.address import control_address, is_running
from daq.control.exchange import Client
from daq.journal.reader import segments_in

from .bench_terminal import PATIENCE_S, PtyTerminal, end_recorder

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
        terminal.until(b"]2;")
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
