"""The recorder where it is easy to lose something: refusing disks, restarts, changed benches."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from daq.bench.config import Bench
from daq.bus.source import STEADY_CLOCK, HopLosses
from daq.control.address import control_address
from daq.control.exchange import Client, Server
from daq.control.messages import (
    PROTOCOL,
    Arm,
    Build,
    Live,
    Mark,
    Phase,
    SessionState,
    Start,
    Status,
    Stop,
    Until,
)
from daq.journal.reader import last_recording, recordings, segments_in
from daq.journal.segment import end_of
from daq.recorder.recorder import Derivation
from daq.recorder.run_loop import OrderError
from dbc import Codec
from tui.recorders.lines import status_lines

from ..crash_frames import SmallDisk, block, numbers, read_journal
from ..recorder_run import (
    ENDED,
    PATIENCE_S,
    Gated,
    Running,
    Script,
    sources,
    stored,
)
from ..small_campaign import LABELS, blocks, bumps

ROOM_BYTES = 10**9


@pytest.mark.parametrize("order", [Stop(), Start()])
def test_no_recording_is_ended_while_its_frames_wait_for_the_disk(
    quick: Bench, codec: Codec, tmp_path: Path, order: Stop | Start
) -> None:
    disk, frames = SmallDisk(ROOM_BYTES), bumps(codec, 2)
    gate = threading.Event()
    script = Gated(gate, blocks(frames, 10))
    with Running(quick, tmp_path, sources(script), create=disk.create) as running:
        first = running.until(lambda s: s.recording != "").recording
        disk.free = 0
        gate.set()
        running.until(lambda s: s.disk.held_frames > 0)
        with pytest.raises(OrderError, match="frames wait in memory"):
            running.order(order)
        assert running.order(Mark("still here")).status is not None
        assert running.last.recording == first
        disk.free = ROOM_BYTES
        running.until(lambda s: s.disk.recorded_frames == len(frames))
        running.order(order)
    np.testing.assert_array_equal(stored_first(tmp_path, first), frames.t_ns)


def stored_first(folder: Path, recording: str) -> NDArray[np.int64]:
    """Return the stamps of one recording of a folder."""
    own = []
    for path in segments_in(folder / "journal"):
        contents = read_journal([path])
        if contents.head.recording == recording:
            own.append(contents.frames.t_ns)
    return np.concatenate(own)


def test_what_a_disk_did_not_take_at_the_end_is_said(
    quick: Bench, codec: Codec, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    disk, gate = SmallDisk(ROOM_BYTES), threading.Event()
    script = Gated(gate, blocks(bumps(codec, 1)))
    with Running(quick, tmp_path, sources(script), create=disk.create) as running:
        running.until(lambda s: s.recording != "")
        disk.free = 0
        gate.set()
        running.until(lambda s: s.disk.held_frames == 1200)
    assert "1,200 frames were in memory" in caplog.text
    assert running.last.disk.held_frames == 1200


@pytest.mark.usefixtures("built_at_once")
def test_a_session_built_in_mid_recording_reads_no_file_that_is_written(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[tuple[Path, ...]] = []
    begin = Derivation.begin

    def noted(
        self: Derivation, target: Path, segments: tuple[Path, ...], recording: str, revision: int
    ) -> None:
        given.append(tuple(segments))
        begin(self, target, segments, recording, revision)

    monkeypatch.setattr(Derivation, "begin", noted)
    script = Script(blocks(bumps(codec, 2), 10), None, 0.002)
    with Running(quick, tmp_path, sources(script)) as running:
        for _ in range(2):
            running.order(Arm(Until.COMPLETE))
            running.until(lambda s: s.disk.recorded_frames > 0)
            running.order(Build())
            assert all(end_of(path) is not None for path in given[-1])
        running.until(lambda s: s.disk.recorded_frames == 2400)
        status = running.until(lambda s: s.session.state in ENDED)
        assert (status.session.state, status.session.text) == (SessionState.READY, "")
    assert not stored(tmp_path).lost.any
    assert [path.name for path in tmp_path.glob("*.h5")] == ["session_0001.h5"]


@pytest.mark.usefixtures("built_at_once")
def test_a_recording_keeps_its_session_file_when_its_first_segment_has_gone(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    small = replace(quick, recorder=replace(quick.recorder, segment_bytes=5_000.0))
    journal = tmp_path / "journal"
    with Running(small, tmp_path, sources(Script(blocks(bumps(codec, 1), 50)))) as running:
        first = running.until(lambda s: s.disk.recorded_frames == 1200)
    (journal / "journal_0001.bbj").unlink()  # as retention does
    for _ in range(2):  # the second time, the head is one that was written after a restart
        with Running(small, tmp_path, sources(Script([]))) as running:
            assert running.until(lambda s: s.recording != "").recording == first.recording
    with Running(small, tmp_path, sources(Script([]))) as running:
        status = running.order(Stop()).status
    assert status is not None
    assert Path(status.session.path).name == "session_0001.h5"
    info, *_ = recordings(journal)  # by which `recover` and the terminal go
    assert (info.head.recording, info.head.session_name) == (first.recording, "session_0001.h5")


def test_losses_before_a_recording_are_not_its_own(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    script = Script(blocks(bumps(codec, 2), 10), None, 0.002, HopLosses(bus_dropped=7))
    with Running(quick, tmp_path, sources(script)) as running:
        before = running.until(lambda s: s.losses.bus_dropped == 7).recording
        running.order(Start())
        status = running.until(lambda s: s.recording != before and s.disk.recorded_frames > 0)
        assert status.losses.bus_dropped == 0
        script.published = HopLosses(bus_dropped=9)
        running.until(lambda s: s.losses.bus_dropped == 2)
        running.order(Stop())
        assert running.until(lambda s: s.recording == "").losses.bus_dropped == 0


def test_a_complete_recording_that_was_not_ended_is_complete_when_taken_up(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    gate = threading.Event()
    script = Gated(gate, blocks(bumps(codec, len(LABELS))))
    with Running(quick, tmp_path, sources(script)) as running:
        running.order(Arm(Until.COMPLETE))
        gate.set()
        running.until(lambda s: s.phase is Phase.COMPLETE)
    with Running(quick, tmp_path, sources(Script([]))) as running:
        assert running.until(lambda s: s.recording != "").phase is Phase.COMPLETE


def test_whose_bench_toml_holds_is_said(
    quick: Bench, codec: Codec, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with Running(quick, tmp_path, sources(Script(blocks(bumps(codec, 1))))) as running:
        first = running.until(lambda s: s.disk.recorded_frames == 1200)
    assert (caplog.text, first.begun) == ("", "")
    text = quick.text.replace('name = "Ford Granada"', 'name = "Changed"')
    limits = replace(quick.recorder, keep_bytes=5e9)
    changed = replace(quick, text=text, recorder=limits)
    with Running(changed, tmp_path, sources(Script([]))) as running:
        status = running.until(lambda s: s.recording != "")
        assert (status.recording, status.vehicle) == (first.recording, "Ford Granada")
        assert status.begun == "it was interrupted, and continues after 1,200 frames"
        assert f"campaign: {status.begun}" in list(status_lines(status))
        writer = running.recorder._writer
        assert writer.limits == limits  # the disk is the host's affair
        running.order(Start())  # keeps the present one
        assert running.until(lambda s: s.recording != first.recording).vehicle == "Ford Granada"
    assert "to use that, end the campaign and start the recorder again" in caplog.text
    caplog.clear()
    other = replace(quick, dbc_text=quick.dbc_text + "\n")
    with Running(other, tmp_path, sources(Script([]))) as running:
        status = running.until(lambda s: s.recording not in ("", first.recording))
        assert "(it has another DBC): a new one is begun" in status.begun
        running.order(Start())
        assert running.until(lambda s: s.recording != status.recording).begun == ""
    assert "cannot be resumed (it has another DBC): a new one is begun" in caplog.text


def test_a_recording_taken_up_never_goes_back_in_time(
    quick: Bench, codec: Codec, tmp_path: Path
) -> None:
    with Running(quick, tmp_path, sources(Script(blocks(bumps(codec, 1))))) as running:
        running.until(lambda s: s.disk.recorded_frames == 1200)
    tail = last_recording(tmp_path / "journal")
    assert tail is not None
    ahead_ns = time.time_ns() + 3_600_000_000_000  # the host's clock has fallen back by an hour
    shift_ns = ahead_ns - tail.last_ns
    later = [replace(each, t_ns=each.t_ns + shift_ns) for each in blocks(bumps(codec, 1))]
    with Running(quick, tmp_path, sources(Script(later))) as running:
        running.until(lambda s: s.disk.recorded_frames == 2400)
    try:
        with Running(quick, tmp_path, sources(Script([]))) as running:
            running.until(lambda s: s.recording != "")
            assert STEADY_CLOCK.now_ns() >= ahead_ns
            running.order(Start())
            assert STEADY_CLOCK.now_ns() < ahead_ns
    finally:
        STEADY_CLOCK.begin()


def test_a_status_that_fails_stops_nothing(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = Script(blocks(bumps(codec, 1)), None, 0.001)
    with Running(quick, tmp_path, sources(script)) as running:
        running.until(lambda s: s.recording != "")
        with monkeypatch.context() as patch:
            patch.setattr("daq.recorder.recording.Recording.status", lambda *_: 1 / 0)
            deadline_s = time.monotonic() + PATIENCE_S
            while "publish" not in running.recorder._barrier._failed:
                assert time.monotonic() < deadline_s
                time.sleep(0.01)
        running.until(lambda s: s.disk.recorded_frames == 1200)
        running.until(lambda s: any(a.subject == "publish" for a in s.alarms))


# Fifty viewers and one that never reads cost a recorder no frame, and each sees a small status ----

VIEWERS, BLOCKS, FRAMES = 50, 60, 500


class Served(Running):
    """A recorder whose statuses are published as by the command."""

    server: Server

    def _publish(self, status: Status, live: Live | None) -> None:
        self.server.publish(status, live)
        super()._publish(status, live)


def test_fifty_viewers_and_a_dead_one_cost_no_frame(tmp_path: Path, quick: Bench) -> None:
    sent = [block(k * FRAMES, FRAMES) for k in range(BLOCKS)]
    running = Served(quick, tmp_path, sources(Script(sent, pause_s=0.02)))
    address = control_address(tmp_path)
    running.server = Server(running.recorder.submit, address)
    with contextlib.ExitStack() as stack:
        stack.callback(running.server.close)
        dead = stack.enter_context(socket.socket(socket.AF_UNIX))  # it never reads
        dead.connect(str(address))
        dead.sendall(b'%d 1 Hello {"name": "dead"}\n' % PROTOCOL)
        viewers = [Client(address, f"viewer {n}", control=False) for n in range(VIEWERS)]
        for client in viewers:
            stack.callback(client.close)
        with running:
            running.until(lambda s: s.disk.recorded_frames == BLOCKS * FRAMES)
            for client in viewers:
                recorded = 0
                while recorded < BLOCKS * FRAMES:
                    news = client.news(PATIENCE_S)
                    recorded = news.disk.recorded_frames if isinstance(news, Status) else recorded
            last = running.last
    assert last.losses.queue_dropped == last.losses.bus_dropped == 0
    stored = numbers(read_journal(segments_in(tmp_path / "journal")).frames)
    assert np.array_equal(stored, np.arange(BLOCKS * FRAMES))
