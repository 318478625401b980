"""A daemon over three campaigns: what is on the bus is on the disk, between them as well.

The recorder takes its time from the frames, so that an hour between two campaigns takes seconds.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daq import read_session
from daq.bench.config import Bench
from daq.bus.source import SourceLosses
from daq.control.address import control_address, is_running
from daq.control.client import Client
from daq.control.messages import SessionState, Status
from daq.control.orders import Arm, AskStatus, Start
from daq.journal.folder import recordings
from daq.journal.format import segment_number
from daq.journal.reader import read_journal
from dbc import Codec, FrameBatch
from tui.commands.recover import recover
from tui.output import progress
from tui.recorders.daemon import Lifetime
from tui.recorders.log import Log
from tui.recorders.recording import record_campaign

from ..quick_bench import quick
from ..recorder_run import PATIENCE_S
from ..small_campaign import LABELS, START_NS, bumps

__all__ = ["quick"]  # a fixture

NUMBERED_ID = 0x7A0
"""A message that no DBC has; its payload is the sender's number of the frame."""
HOUR_FRAMES = 72_000
"""An hour at 20 frames/s."""


def numbered(first: int, count: int, t_ns: int, step_ns: int) -> FrameBatch:
    return FrameBatch(
        t_ns + np.arange(count) * step_ns,
        np.full(count, NUMBERED_ID, np.uint32),
        np.zeros(count, np.uint16),
        np.zeros(count, np.uint8),
        np.full(count, 8, np.uint8),
        np.arange(first, first + count, dtype="<u8").view(np.uint8).reshape(count, 8),
    )


class Sender:
    """A bus on which numbered frames never end, with the bumps of a campaign now and then."""

    name = "sender"

    def __init__(self, codec: Codec) -> None:
        self._bumps = bumps(codec, len(LABELS))
        self._planned: list[FrameBatch] = []
        self._lock = threading.Lock()
        self._t_ns = START_NS
        self.sent = self.bumped = 0

    def campaign(self) -> int:
        """Send bumps and after them an hour of frames 50 ms apart; return the frames until then."""
        with self._lock:
            frames = replace(self._bumps, t_ns=self._bumps.t_ns - START_NS + self._t_ns)
            self._t_ns = int(frames.t_ns[-1]) + 1_000_000
            hour = numbered(self.sent, HOUR_FRAMES, self._t_ns, 50_000_000)
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

    def losses(self) -> SourceLosses:
        return SourceLosses()

    def close(self) -> None: ...


class Operator(threading.Thread):
    """Leads a daemon through three campaigns; ends it with `end`."""

    def __init__(self, folder: Path, sender: Sender, bench: Bench, file: list[Bench]) -> None:
        super().__init__()
        self._folder, self._sender, self._bench, self._file = folder, sender, bench, file
        self.end = threading.Event()
        self.error: BaseException | None = None
        self.refused = ""

    def run(self) -> None:
        try:
            address = control_address(self._folder)
            while not is_running(address):
                time.sleep(0.05)
            client = Client(address, "Anna", control=True)
            try:
                self._lead(client)
            finally:
                client.close()
        except BaseException as error:
            self.error = error
        finally:
            self.end.set()

    def _lead(self, client: Client) -> None:
        self._through_campaign(client, self._bench.vehicle.name)
        try:
            client.ask(Arm(), PATIENCE_S)
        except Exception as error:
            self.refused = str(error)
        client.ask(Start(self._named("Second").text), PATIENCE_S)
        self._through_campaign(client, "Second")
        os.kill(os.getpid(), signal.SIGHUP)  # the file is as it was: no campaign begins
        log = self._folder / "recorder.log"
        deadline_s = time.monotonic() + PATIENCE_S
        while "bench.toml reloaded" not in log.read_text():
            assert time.monotonic() < deadline_s
            time.sleep(0.02)
        self._file[:] = [self._named("Third")]
        os.kill(os.getpid(), signal.SIGHUP)
        self._through_campaign(client, "Third")

    def _through_campaign(self, client: Client, vehicle: str) -> None:
        def until(what: Callable[[Status], bool]) -> None:
            deadline_s = time.monotonic() + PATIENCE_S
            while True:
                status = client.ask(AskStatus(), PATIENCE_S).status
                if status is not None and status.vehicle == vehicle and what(status):
                    return
                assert time.monotonic() < deadline_s, status
                time.sleep(0.02)

        until(lambda s: s.phase == "waiting")
        total = self._sender.campaign()
        until(lambda s: not s.recording and s.session.state is SessionState.READY)
        until(lambda s: s.storage.stored_frames > total)

    def _named(self, vehicle: str) -> Bench:
        text = self._bench.text.replace('name = "Ford Granada"', f'name = "{vehicle}"')
        assert text != self._bench.text
        return replace(self._bench, text=text, vehicle=replace(self._bench.vehicle, name=vehicle))


def test_no_frame_is_lost_over_three_campaigns_and_between_them(
    quick: Bench, codec: Codec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a Unix socket's path is short
    sender, file = Sender(codec), [quick]
    operator = Operator(tmp_path, sender, quick, file)
    log = tmp_path / "recorder.log"
    lifetime = Lifetime(True, True, None, lambda: file[0], end=operator.end)
    operator.start()
    with Log(log) as lines, progress("test") as stage:
        last = record_campaign(quick, lambda *_: sender, tmp_path, lifetime, lines, stage)
    operator.join()
    if operator.error:
        raise operator.error
    assert operator.refused == "no campaign is under way: begin one first"
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
