"""R17: the whole `bumpbench record` as a daemon through three campaigns, in real time."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from daq.control.address import control_address
from daq.control.client import Client
from daq.control.messages import SessionState
from daq.control.orders import Start, Stop
from daq.journal.folder import recordings
from daq.journal.reader import read_journal
from dbc.frames import FrameBatch

from .crash_process import PATIENCE_S, RecorderProcess
from .crash_sender import Sender, numbers_of

CAMPAIGNS = 3


def daemon(folder: Path, seconds: float) -> int:
    """Lead a daemon through three campaigns with as long between; return the number of frames.

    Raises
    ------
    AssertionError
        If a frame that was sent is not stored, within a campaign or between two, or is doubled or
        altered, or a recording was said not to go on.
    """
    out = folder / "out"
    with Sender(hot=False) as sender, RecorderProcess(out, sender) as recorder:
        recorder.wait_open()
        recorder.status()  # from here on it listens
        began_s = time.monotonic()
        with_control = Client(control_address(out), "Anna", control=True)
        for campaign in range(1, CAMPAIGNS + 1):
            if campaign > 1:
                with_control.ask(Start(), PATIENCE_S)
            _sleep_until(began_s + (campaign - 0.5) / CAMPAIGNS * seconds)
            with_control.ask(Stop(), PATIENCE_S)
            recorder.until(
                lambda status: not status.recording and status.session.state is SessionState.READY
            )
            _sleep_until(began_s + campaign / CAMPAIGNS * seconds)
        stop = sender.pause()
        sent = np.arange(sender.openings[-1], stop)
        recorder.until(lambda status: status.storage.stored_frames == len(sent))
        with_control.close()
        recorder.end()
        said = [line for line in (recorder.place / "log").open() if "not_recording" in line]
    assert not said, said
    found = recordings(out / "journal")
    contents = [read_journal(each.segments) for each in found]
    spans = [each.head.campaign for each in contents]
    assert spans == [True, False] * CAMPAIGNS, spans
    assert not any(each.lost.any for each in contents)
    frames = FrameBatch.concatenate([each.frames for each in contents])
    assert np.array_equal(numbers_of(frames), sent), "a frame is missing or doubled"
    return len(sent)


def _sleep_until(deadline_s: float) -> None:
    time.sleep(max(deadline_s - time.monotonic(), 0.0))
