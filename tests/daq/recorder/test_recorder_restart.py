"""The recorder on a disk that is slow or refuses, and a recording that is taken up again."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq import read_session
from daq.bench.config import Bench, parse_bench
from daq.control.messages import Phase, SessionState
from daq.control.orders import (
    Arm,
    Configure,
    Start,
    Stop,
    Until,
)
from daq.journal.segment import SyncedFile
from daq.runlog.run_log import LoggedStatus
from dbc import Codec, FrameBatch

from ..quick_bench import Gated, quick, stored
from ..recorder_run import ENDED, PATIENCE_S, Running, Script, sources
from ..small_campaign import blocks, bumps

__all__ = ["quick"]  # a fixture


def test_a_consumer_that_sleeps_costs_no_frame(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = bumps(codec, 1)
    script = Script(blocks(frames, 2), None, 0.001)
    decode, slept = Codec.decode, threading.Event()

    def sleepy(codec: Codec, batch: FrameBatch) -> object:
        if not slept.is_set():
            slept.set()
            assert script.exhausted.wait(PATIENCE_S)
        return decode(codec, batch)

    monkeypatch.setattr(Codec, "decode", sleepy)
    with Running(quick, tmp_path, sources(script)) as running:
        running.until(lambda s: s.disk.recorded_frames == len(frames))
    np.testing.assert_array_equal(stored(tmp_path).frames.data, frames.data)


def test_a_disk_that_takes_a_second_for_a_block_loses_nothing(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    slow = iter([1.0] * 4)

    class Slow(SyncedFile):
        def sync(self) -> None:
            time.sleep(next(slow, 0.0))
            super().sync()

    frames = bumps(codec, 2)
    script = Script(blocks(frames, 10), None, 0.01)
    with Running(quick, tmp_path, sources(script), create=Slow) as running:
        running.until(lambda s: s.disk.recorded_frames == len(frames))
    assert running.last.losses.queue_dropped == 0
    assert running.last.queue.high > 20
    np.testing.assert_array_equal(stored(tmp_path).frames.data, frames.data)


def test_a_disk_that_refuses_is_waited_for(quick: Bench, codec: Codec, tmp_path: Path) -> None:
    full = threading.Event()

    class Full(SyncedFile):
        def sync(self) -> None:
            if full.is_set():
                raise OSError(28, "No space left on device")
            super().sync()

    frames = bumps(codec, 2)
    script = Script(blocks(frames, 10), None, 0.01)
    with Running(quick, tmp_path, sources(script), create=Full) as running:
        running.until(lambda s: s.disk.recorded_frames > 0)
        full.set()
        status = running.until(lambda s: any(a.code == "journal_failed" for a in s.alarms))
        assert "No space left" in status.disk.failed
        full.clear()
        running.until(lambda s: s.disk.recorded_frames == len(frames))
    np.testing.assert_array_equal(stored(tmp_path).frames.data, frames.data)


def test_a_killed_recorder_is_taken_up_again(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = bumps(codec, 3)
    gate = threading.Event()
    killed = Running(
        quick, tmp_path, sources(Gated(gate, blocks(frames.select(slice(0, 1900)), 50)))
    )
    os_gone = threading.Event()
    finish = killed.recorder._finish
    monkeypatch.setattr(killed.recorder, "_finish", lambda publish: None)  # as SIGKILL does
    with killed:
        killed.order(Arm(Until.COMPLETE))
        killed.order(Configure(quick.text.replace('name = "Ford Granada"', 'name = "Mine"')))
        gate.set()
        before = killed.until(lambda s: s.disk.recorded_frames == 1900)
    assert before.phase in (Phase.TRIGGERED, Phase.DECAY)

    rest = Gated(os_gone, blocks(frames.select(slice(1900, None)), 50))
    with Running(quick, tmp_path, sources(rest)) as running:
        status = running.until(lambda s: s.recording != "")
        assert status.recording == before.recording
        assert status.vehicle == "Mine"
        assert [(run.label, run.status) for run in status.runs] == [
            ("baseline_bounce_1", LoggedStatus.ACCEPTED),
            ("baseline_roll_1", LoggedStatus.REJECTED),
        ]
        assert status.runs[1].reasons == ("cut: the recorder was stopped in mid-run",)
        assert status.phase is Phase.IDLE
        running.order(Arm(Until.COMPLETE))
        os_gone.set()
        running.until(lambda s: s.disk.recorded_frames == len(frames))
        running.order(Stop())
        done = running.until(lambda s: s.session.state in ENDED)
    assert done.session.state is SessionState.READY
    contents = stored(tmp_path)
    np.testing.assert_array_equal(contents.frames.t_ns, frames.t_ns)
    assert not contents.lost.any
    assert [e.code for e in contents.events].count("resumed") == 1
    runs = {run.label: run.reasons for run in read_session(done.session.path).runs}
    assert list(runs) == ["baseline_bounce_1", "baseline_roll_1", "baseline_roll_2"]
    assert [label for label in runs if runs[label][0].startswith("cut: ")] == ["baseline_roll_1"]
    finish(lambda *_: None)


def test_a_recording_that_was_ended_or_has_another_dbc_is_left_alone(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    names = []
    other = replace(quick, dbc_text=quick.dbc_text + "\n")
    for k, (bench, end) in enumerate(
        [(quick, False), (quick, False), (other, True), (other, False)]
    ):
        script = Script(blocks(bumps(codec, 1)))
        with Running(bench, tmp_path, sources(script)) as running:
            running.until(lambda s: s.disk.recorded_frames in (1200, 2400))
            names.append(running.last.recording)
            if k == 2:  # what was left without a session file gets it
                running.until(lambda _: (tmp_path / "session_0001.h5").exists())
            if end:
                running.order(Stop())
    assert names[0] == names[1]
    assert len(set(names)) == 3


def test_after_a_campaign_that_goes_on_over_another_bus_a_new_one_can_be_begun(
    quick: Bench, tmp_path: Path
) -> None:
    """Its own bench.toml names the bus of before; nobody asks for another one by repeating it."""
    with Running(quick, tmp_path, sources(Script([]))) as running:
        first = running.until(lambda s: s.recording != "").recording
    moved = quick.text.replace('channel = "bumpbench"', 'channel = "elsewhere"')
    assert moved != quick.text
    bench = replace(parse_bench(moved, "bench.toml", Path(), quick.dbc_text), buses=quick.buses)
    with Running(bench, tmp_path, sources(Script([]))) as running:
        assert running.until(lambda s: s.recording != "").recording == first
        running.order(Start())
        assert running.until(lambda s: s.recording != first).vehicle == "Ford Granada"
