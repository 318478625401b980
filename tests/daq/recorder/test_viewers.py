"""Fifty viewers and one that never reads cost a recorder no frame, and each sees a small status."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import zmq

from daq.bench.config import Bench
from daq.control.address import Address, control_address
from daq.control.messages import STATUS, Live, Status
from daq.control.server import Server
from daq.journal.folder import segments_in
from daq.journal.reader import read_journal

from ..crash_frames import block, numbers
from ..quick_bench import quick
from ..recorder_run import PATIENCE_S, Running, Script, sources

__all__ = ["quick"]  # a fixture

VIEWERS, BLOCKS, FRAMES = 50, 60, 500


class Served(Running):
    """A recorder whose statuses are published as by the command."""

    server: Server

    def _publish(self, status: Status, live: Live | None) -> None:
        self.server.publish(status, live)
        super()._publish(status, live)


def viewer(
    context: zmq.Context[zmq.Socket[bytes]], address: Address, held: int = 100
) -> zmq.Socket[bytes]:
    end = context.socket(zmq.SUB)
    end.linger = 0
    end.rcvhwm = held
    end.connect(address.news)
    end.subscribe(b"status")
    return end


def test_fifty_viewers_and_a_dead_one_cost_no_frame(tmp_path: Path, quick: Bench) -> None:
    sent = [block(k * FRAMES, FRAMES) for k in range(BLOCKS)]
    script = Script(sent, pause_s=0.02)
    running = Served(quick, tmp_path, sources(script))
    address = control_address(tmp_path)
    running.server = Server(running.recorder.submit, address)
    with zmq.Context() as context:
        dead = viewer(context, address, held=1)  # it never reads
        viewers = [viewer(context, address) for _ in range(VIEWERS)]
        try:
            with running:
                seen = dict.fromkeys(viewers, 0)
                deadline_s = time.monotonic() + PATIENCE_S
                while min(seen.values()) < BLOCKS * FRAMES:
                    assert time.monotonic() < deadline_s
                    for end in viewers:
                        message = b""
                        while end.poll(0):
                            message = b"".join(end.recv_multipart()[1:])
                        if message:
                            status = STATUS.validate_json(message)
                            seen[end] = status.disk.recorded_frames
                    time.sleep(0.05)
                last = running.last
        finally:
            for end in (dead, *viewers):
                end.close()
            running.server.close()
    assert last.losses.queue_dropped == last.losses.bus_dropped == 0
    stored = numbers(read_journal(segments_in(tmp_path / "journal")).frames)
    assert np.array_equal(stored, np.arange(BLOCKS * FRAMES))
