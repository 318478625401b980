"""A daemon over three campaigns: what is on the bus is on the disk, between them as well.

The recorder takes its time from the frames, so that an hour between two campaigns takes seconds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from daq import read_session
from daq.bench.config import Bench, parse_bench
from daq.control.address import control_address, is_running
from daq.control.exchange import Client, OrderRefusedError
from daq.control.messages import (
    Arm,
    AskStatus,
    Configure,
    Phase,
    SessionState,
    Start,
    Status,
    Stop,
    Until,
)
from daq.journal.reader import recordings
from daq.journal.segment import SyncedFile, segment_number
from daq.runs import RunStatus
from dbc import Codec, FrameBatch
from tui.commands.record import recover
from tui.output import progress
from tui.recorders.daemon import Lifetime, record_campaign
from tui.recorders.log import Log
from tui.recorders.traffic import Traffic

from ..crash_frames import read_journal
from ..recorder_run import ENDED, PATIENCE_S, Gated, Running, Script, sources, stored
from ..small_campaign import LABELS, START_NS, blocks, bumps, frames_at

NUMBERED_ID = 0x7A0
"""A message that no DBC has; its payload is the sender's number of the frame."""
HOUR_FRAMES = 1_200
"""An hour at a frame each 3 s."""


def numbered(first: int, count: int, t_ns: int, step_ns: int) -> FrameBatch:
    data = np.arange(first, first + count, dtype="<u8").view(np.uint8).reshape(count, 8)
    return frames_at(t_ns + np.arange(count) * step_ns, data, NUMBERED_ID)


class Sender(Script):
    """A bus on which numbered frames never end, with the bumps of a campaign now and then."""

    def __init__(self, codec: Codec) -> None:
        super().__init__([])
        self._bumps = bumps(codec, len(LABELS))
        self._planned: list[FrameBatch] = []
        self._lock = threading.Lock()
        self._t_ns = START_NS
        self.sent = self.bumped = 0

    def campaign(self) -> int:
        """Send bumps and after them an hour of frames; return the frames until then."""
        with self._lock:
            frames = replace(self._bumps, t_ns=self._bumps.t_ns - START_NS + self._t_ns)
            self._t_ns = int(frames.t_ns[-1]) + 1_000_000
            hour = numbered(self.sent, HOUR_FRAMES, self._t_ns, 3_000_000_000)
            self._t_ns = int(hour.t_ns[-1]) + 1_000_000
            self.sent += HOUR_FRAMES
            self.bumped += len(frames)
            for part in (frames, hour):
                starts = range(0, len(part), 500)
                self._planned += [part.select(slice(i, i + 500)) for i in starts]
            return self.sent + self.bumped

    def read(self, timeout_s: float) -> FrameBatch:
        time.sleep(0.004)
        with self._lock:
            if self._planned:
                return self._planned.pop(0)
            self.sent += 1
            self._t_ns += 1_000_000
            return numbered(self.sent - 1, 1, self._t_ns, 1)


def lead(folder: Path, sender: Sender, bench: Bench, end: threading.Event) -> str:
    """Lead a daemon through three campaigns, then end it; return why it refused to arm between."""
    refused = ""
    try:
        address = control_address(folder)
        while not is_running(address):
            time.sleep(0.05)
        with closing(Client(address, "Anna", control=True)) as client:
            for vehicle in (bench.vehicle.name, "Second", "Third"):
                if vehicle != bench.vehicle.name:
                    text = bench.text.replace('name = "Ford Granada"', f'name = "{vehicle}"')
                    client.ask(Start(text), PATIENCE_S)
                await_status(client, vehicle, lambda s: s.phase == "waiting")
                sent = sender.campaign()
                await_status(
                    client, vehicle, lambda s: not s.recording and s.session.state == "ready"
                )
                await_status(client, vehicle, partial(has_stored, frames=sent + 1))
                try:
                    client.ask(Arm(), PATIENCE_S)
                except OrderRefusedError as error:
                    refused = str(error)
    finally:
        end.set()
    return refused


def has_stored(status: Status, frames: int) -> bool:
    return status.storage.stored_frames >= frames


def await_status(client: Client, vehicle: str, condition: Callable[[Status], bool]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        status = client.ask(AskStatus(), PATIENCE_S).status
        if status is not None and status.vehicle == vehicle and condition(status):
            return
        assert time.monotonic() < deadline_s, status.session if status else None
        time.sleep(0.02)


@pytest.mark.usefixtures("built_at_once")
def test_no_frame_is_lost_over_three_campaigns_and_between_them(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a Unix socket's path is short
    sender, end = Sender(codec), threading.Event()
    log = tmp_path / "recorder.log"
    traffic = Traffic(quick, lambda *_: sender)
    lifetime = Lifetime(arm=True, keep_on=True, end=end)
    with ThreadPoolExecutor(1) as operator, Log(log) as lines, progress("test") as stage:
        refused = operator.submit(lead, tmp_path, sender, quick, end)
        last = record_campaign(traffic, tmp_path, lifetime, lines, stage)
    assert refused.result() == "no campaign is under way: begin one first"
    assert last.recording == ""
    assert last.storage.stored_frames == sender.sent + sender.bumped
    assert "not_recording" not in log.read_text()

    found = recordings(tmp_path / "journal")
    contents = [read_journal(each.segments) for each in found]
    spans = [(each.head.campaign, info.bumps) for each, info in zip(contents, found, strict=True)]
    assert spans == [(True, 4), (False, 0)] * 3
    assert all(info.ended for info in found)
    assert not any(each.lost.any for each in contents)
    frames = FrameBatch.concatenate([each.frames for each in contents])
    own = frames.select(frames.can_id == NUMBERED_ID)
    np.testing.assert_array_equal(own.data.view("<u8").ravel(), np.arange(sender.sent))
    assert len(frames) == sender.sent + sender.bumped
    sessions = {path.name: read_session(path) for path in sorted(tmp_path.glob("*.h5"))}
    # A session has the number of its campaign's first segment; on a busy machine, where the order
    # to end comes late, a campaign may have two.
    firsts = [segment_number(info.segments[0]) for info in found[::2]]
    assert list(sessions) == [f"session_{number:04d}.h5" for number in firsts]
    for session in sessions.values():
        assert [run.label for run in session.runs] == LABELS
    names = [session.vehicle.name for session in sessions.values()]
    assert names == ["Ford Granada", "Second", "Third"]
    # Only campaigns are recovered, and to the same files.
    grown = {path.name: path.read_bytes() for path in tmp_path.glob("*.h5")}
    for path in tmp_path.glob("*.h5"):
        path.unlink()
    assert recover([tmp_path]) == 0
    assert {path.name: path.read_bytes() for path in tmp_path.glob("*.h5")} == grown
    assert not list(tmp_path.glob(".session*"))


# The recorder on a disk that is slow or refuses, and a recording that is taken up again -----------


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
    slow = iter([1.0] * 2)

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


@pytest.mark.usefixtures("built_at_once")
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
            ("baseline_bounce_1", RunStatus.ACCEPTED),
            ("baseline_roll_1", RunStatus.REJECTED),
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


def test_after_a_campaign_that_goes_on_over_another_bus_a_new_one_can_be_begun(
    quick: Bench, tmp_path: Path
) -> None:
    """Its own bench.toml names the bus of before; no order that repeats it asks for another one."""
    with Running(quick, tmp_path, sources(Script([]))) as running:
        first = running.until(lambda s: s.recording != "").recording
    moved = quick.text.replace('channel = "bumpbench"', 'channel = "elsewhere"')
    assert moved != quick.text
    bench = replace(parse_bench(moved, "bench.toml", Path(), quick.dbc_text), buses=quick.buses)
    with Running(bench, tmp_path, sources(Script([]))) as running:
        assert running.until(lambda s: s.recording != "").recording == first
        running.order(Start())
        assert running.until(lambda s: s.recording != first).vehicle == "Ford Granada"
