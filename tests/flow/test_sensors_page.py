"""The page for unknown sensors, followed as it stands, with its commands in a shell.

What the page runs in a second terminal, `simulate`, runs beside the rest.  The multicast groups are
others than the page's, so that no other reader who follows it at the moment is heard.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path

import can
import numpy as np
import pytest

import identify
from daq.bench.config import bench_codec, load_bench, parse_bench
from daq.bench.sensors import stored_text
from daq.channels import Quantity
from daq.check.propose import propose_sensors
from daq.control.messages import Phase
from daq.journal.reader import HopCounts
from daq.runs import RunStatus
from daq.session.build import build_session
from daq.sim.bench import Fault
from daq.sim.car import SimulatedCar
from dbc import FrameBatch

from ..daq.sim.test_bench import record
from ..daq.wild_bench import DATABASES, NODES, rest_and_pushes, wild_bench

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "sensors.md").read_text("utf-8")
PATIENCE_S = 300.0
GROUP = f"239.79.{64 + os.getpid() % 128}.2"
_BLOCK = re.compile(r"(?:^    .*\n|^\n(?=    ))+", re.MULTILINE)


def steps() -> list[str]:
    """Return the scripts of the numbered sections, in the page's order."""
    walk = PAGE[PAGE.index("\n## 1. ") : PAGE.index("\n## What bench.toml says")]
    blocks = [re.sub(r"^    ", "", each, flags=re.MULTILINE) for each in _BLOCK.findall(walk)]
    return [block.strip().replace("239.74.163.2", GROUP) for block in blocks]


class Reader:
    """Somebody who follows the page with two terminals."""

    def __init__(self, folder: Path) -> None:
        (folder / "docs").symlink_to(ROOT / "docs")
        self.folder = folder
        self.second: subprocess.Popen[str] | None = None
        self.started: list[subprocess.Popen[str]] = []
        tools = Path(sys.executable).parent
        self.environment = {**os.environ, "PATH": f"{tools}:{os.environ['PATH']}", "COLUMNS": "80"}

    def runs(self, script: str) -> subprocess.Popen[str]:
        """Start a script of the page."""
        process = subprocess.Popen(
            ["bash", "-e", "-c", script],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        self.started.append(process)
        return process

    def done(self, script: str) -> str:
        """Run a script of the page to its end and return what it showed."""
        process = self.runs(script)
        shown, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, shown
        return shown

    def in_second_terminal(self, script: str) -> None:
        """Start a script beside the others, in place of the one before."""
        self.leave()
        script = script.replace("car.toml", "played.toml")
        car = (self.folder / "car.toml").read_text("utf-8")
        (self.folder / "played.toml").write_text(car.replace("239.74.163.2", GROUP), "utf-8")
        self.second = self.runs(script)

    def leave(self) -> None:
        """End what runs in the second terminal."""
        if self.second is not None:
            with suppress(ProcessLookupError):
                os.killpg(self.second.pid, signal.SIGTERM)
            self.second.communicate(timeout=PATIENCE_S)
            self.second = None


@pytest.fixture
def reader(tmp_path: Path) -> Iterator[Reader]:
    made = Reader(tmp_path)
    yield made
    made.leave()
    for process in made.started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def until_checked(reader: Reader) -> list[str]:
    """Follow the page as far as the check, and return the steps behind it."""
    folder, push, propose, edits, weights, check, *rest = steps()
    # A busy machine needs up to 25 s to start `check`; the page gives a person 10.
    push = push.replace("--push 15", "--push 45")
    propose = propose.replace("--push 22", "--seconds 20 --push 60")
    reader.done(folder)
    reader.folder = reader.folder / "first"
    reader.in_second_terminal(push)
    with can.Bus(interface="udp_multicast", channel=f"{GROUP}1", fd=False) as bus:
        assert bus.recv(PATIENCE_S) is not None, "the car stands still from now on"
    assert "0 FAIL" in reader.done(propose)
    reader.done(edits)
    reader.done(weights)
    assert "0 FAIL" in reader.done(check)
    return rest


def test_a_proposed_bench_records_to_its_end_although_a_run_is_rejected(tmp_path: Path) -> None:
    """Steps 2 to 6 of the page without its buses: its edits, weights, a bump struck twice."""
    proposed = propose_sensors(DATABASES, wild_bench().buses, *rest_and_pushes())
    (tmp_path / "bench.toml").write_text(proposed.text, "utf-8")
    for script in steps()[3:5]:
        subprocess.run(["bash", "-e", "-c", script], cwd=tmp_path, check=True)
    text = (tmp_path / "bench.toml").read_text("utf-8")
    assert not re.findall(r"^[^#\n].*(?:FILL IN|ASK: ).*$", text, re.MULTILINE)
    bench = parse_bench(text, "bench.toml", Path(), stored_text(DATABASES))
    bench = replace(bench, campaign=replace(bench.campaign, repeats=1))
    kept, status = record(bench, 3, Fault.DOUBLE_BUMP)
    assert status.phase is Phase.COMPLETE
    assert [run.status is RunStatus.ACCEPTED for run in status.runs] == [
        True, False, *[True] * 5,
    ]  # fmt: skip
    none = HopCounts(np.zeros(0, np.int64), np.zeros((0, 4), np.int64))
    frames = FrameBatch.concatenate(kept.frames)
    session = build_session(bench, bench_codec(bench), frames, kept.events, none, {})
    result = identify.identify(session)
    assert result.quality.verdict == "ok"
    for name, value in asdict(SimulatedCar().parameters).items():
        assert result.parameters[name].value == pytest.approx(value, rel=0.05), name


@pytest.mark.long
def test_the_page_leads_on_to_an_identified_campaign(reader: Reader) -> None:
    record, play, identify = until_checked(reader)
    text = (reader.folder / "bench.toml").read_text("utf-8")
    assert re.findall(r"^[^#\n].*(?:FILL IN|ASK: ).*$", text, re.MULTILINE) == []
    bench = load_bench(reader.folder / "bench.toml")
    travels = [c for c in bench.channels if c.quantity is Quantity.SUSPENSION_TRAVEL]
    corners = {channel.signal: channel.corner for channel in travels}
    assert corners == {f"pot_{i}.TPDO1.Position_Value": corner for i, corner in NODES.items()}
    (added,) = (state for state in bench.mass_states if state.name == "added")
    assert sum(weight.mass_kg for weight in added.added.weights) == 148.0
    recorder = reader.runs(record)
    reader.in_second_terminal(play)
    shown, _ = recorder.communicate(timeout=600.0)  # a busy machine spoils bumps: repeated
    assert recorder.returncode == 0, shown
    shown = reader.done(identify)
    assert "verdict: ok" in shown, shown
    found = json.loads(reader.done("bumpbench identify today/session_0001.h5 --json"))["parameters"]
    for name, value in asdict(SimulatedCar().parameters).items():
        assert abs(found[name]["value"] / value - 1) < 0.05, name
