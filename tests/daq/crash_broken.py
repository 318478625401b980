"""R3, R4: one operation of a disk fails, or it runs full, under the whole `bumpbench record`."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daq.control.address import control_address
from daq.control.client import Client
from daq.control.messages import SessionState
from daq.control.orders import Start, Stop
from daq.journal.folder import recordings
from daq.journal.reader import read_journal
from dbc.frames import FrameBatch

from .crash_process import PATIENCE_S, RecorderProcess, Sender, numbers_of, recovered
from .crash_recorder import MORE_ROOM
from .crash_writer import KINDS

_BALLAST_BYTES = 100_000_000
_SMALL_MEMORY = "400000"
"""Memory for blocks that wait, bytes: a second of frames, in place of a minute."""


def fail_once(place: Path, kind: str, nth: int) -> int:
    """Record while one operation fails; return the number of frames sent.

    Raises
    ------
    AssertionError
        If nothing is said, a frame is lost or doubled, or a second later frames still wait.
    """
    place.mkdir(parents=True)
    disk = (kind, str(nth))
    with Sender(hot=False) as sender, RecorderProcess(place / "out", sender, disk) as recorder:
        recorder.wait_open()
        recorder.until(lambda status: bool(status.disk.failed or status.disk.warning))
        recorder.until(lambda status: not (status.disk.failed or status.disk.held_frames))
        time.sleep(0.2)
        return _ended(place, recorder, sender, dropped=0)


def failure(folder: Path, i: int) -> int:
    """Let one operation fail, another kind and place for each `i`; return the frames sent."""
    place = folder / f"failure{i}"
    frames = fail_once(place, KINDS[i % len(KINDS)], 2 + i // len(KINDS) * 5 + i % 3)
    shutil.rmtree(place)
    return frames


@dataclass(frozen=True, slots=True)
class Full:
    """A full disk: frames sent, dropped and reported, and the time from room to recording, s."""

    kind: str
    sent: int
    dropped: int
    resumed_s: float


@dataclass(frozen=True, slots=True)
class _Disk:
    folder: Path
    shim: tuple[str, str]
    give_back: Callable[[], object]
    kind: str


@contextmanager
def _disk(place: Path, size: int, *, mount: bool) -> Iterator[_Disk]:
    """Make a disk with room for `size` bytes: of the kernel's, or where that is refused our own."""
    mounted = place / "disk"
    mounted.mkdir(parents=True)
    options = f"size={(size + _BALLAST_BYTES + 4095) // 4096 * 4096}"
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(mounted)]
    if not mount or subprocess.run(command, capture_output=True, check=False).returncode:
        yield _Disk(place / "out", ("small", str(size)), (place / MORE_ROOM).touch, "our own")
        return
    try:
        ballast = place / "disk" / "ballast"
        with ballast.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, _BALLAST_BYTES)
        yield _Disk(mounted / "out", ("sound", "0"), ballast.unlink, "tmpfs")
    finally:
        subprocess.run(["umount", "-l", str(mounted)], check=True)


def fill_once(place: Path, size: int, *, drops: bool, mount: bool) -> Full:
    """Record until a disk is full, and on when it has room again.

    `drops`: with so little memory for what waits that frames are dropped.  `mount`: a disk of the
    kernel's, at whose reserve the recorder stops, in place of our own, which refuses to write.

    Raises
    ------
    AssertionError
        If a frame is lost that was not counted, or one is doubled or altered.
    """
    held = _SMALL_MEMORY if drops else ""
    with (
        _disk(place, size, mount=mount) as disk,
        Sender(hot=False) as sender,
        RecorderProcess(disk.folder, sender, disk.shim, held, beside=place) as recorder,
    ):
        recorder.wait_open()
        recorder.until(lambda status: bool(status.disk.failed) and status.disk.held_frames > 0)
        if drops:
            recorder.until(lambda status: status.disk.dropped_frames > 0)
        else:
            time.sleep(1.0)
        disk.give_back()
        given_s = time.monotonic()
        recorder.until(lambda status: not (status.disk.failed or status.disk.held_frames))
        resumed_s = time.monotonic() - given_s
        dropped = recorder.status().disk.dropped_frames
        assert (dropped > 0) == drops
        sent = _ended(place, recorder, sender, dropped, disk.folder)
        return Full(disk.kind, sent, dropped, resumed_s)


def fill(folder: Path, i: int) -> Full:
    """Let a disk run full, larger with `i`; every third costs frames, which are counted."""
    place = folder / f"full{i}"
    done = fill_once(place, 60_000 + i * 97_003, drops=i % 3 == 2, mount=i % 2 == 0)
    shutil.rmtree(place)
    return done


def _ended(
    place: Path, recorder: RecorderProcess, sender: Sender, dropped: int, folder: Path | None = None
) -> int:
    """End sender and recorder in order, recover, and compare; return the frames sent."""
    first, stop = sender.openings[-1], sender.pause()
    kept = stop - first - dropped
    recorder.until(lambda status: status.disk.recorded_frames == kept)
    recorder.end()
    found = recovered(folder or place / "out", sender)
    assert len(found.numbers) == kept, f"{kept - len(found.numbers)} frames lost"
    assert (found.numbers[0], found.numbers[-1]) == (first, stop - 1)
    lost = found.lost
    assert lost.frames_dropped == dropped, lost.text
    assert lost.blocks_missing == lost.blocks_corrupt == lost.bytes_cut == 0, lost.text
    return stop - first


# R17: the whole `bumpbench record` as a daemon through three campaigns, in real time ------------


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
