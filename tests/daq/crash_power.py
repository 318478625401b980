"""R5: the disk of a `bumpbench record` as a power cut leaves it, without what the kernel held."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from .crash_process import RecorderProcess, assert_gapless, recovered
from .crash_sender import Sender

_IMAGE_BYTES = 256_000_000


@contextmanager
def mounted(image: Path, folder: Path) -> Iterator[bool]:
    """Mount an image; False where that is not allowed."""
    folder.mkdir()
    mount = ["mount", "-o", "loop", str(image), str(folder)]
    allowed = not subprocess.run(mount, capture_output=True, check=False).returncode
    try:
        yield allowed
    finally:
        if allowed:
            subprocess.run(["umount", str(folder)], check=True)


def cut_once(folder: Path, after_s: float, *, hot: bool) -> tuple[int, int] | None:
    """Copy a disk in mid-write and recover what is on it; None where that is not possible.

    The recorder is halted for the copy, so that the image is of one moment: all that had only
    reached the kernel's cache is not on it.

    Returns
    -------
    (int, int)
        Frames acknowledged, and read from the copy after the file system's own recovery.

    Raises
    ------
    AssertionError
        If an acknowledged frame is lost, or a frame is not what was sent.
    """
    folder.mkdir()
    image, copy = folder / "disk", folder / "copy"
    with image.open("wb") as file:
        file.truncate(_IMAGE_BYTES)
    made = subprocess.run(["mkfs.ext4", "-q", str(image)], capture_output=True, check=False)
    if made.returncode:
        return None
    with mounted(image, folder / "live") as allowed, Sender(hot=hot) as sender:
        if not allowed:
            return None
        with RecorderProcess(folder / "live" / "out", sender, beside=folder) as recorder:
            recorder.wait_open()
            acknowledged, deadline_s = 0, time.monotonic() + after_s
            while time.monotonic() < deadline_s:
                acknowledged = recorder.status().disk.recorded_frames
            recorder.process.send_signal(signal.SIGSTOP)
            os.waitpid(recorder.process.pid, os.WUNTRACED)
            shutil.copyfile(image, copy)
        recorder.wait_builders()
        with mounted(copy, folder / "after") as again:
            assert again, "the copy cannot be mounted"
            found = recovered(folder / "after" / "out", sender)
    n, lost = found.numbers, found.lost
    assert len(n) >= acknowledged, f"{acknowledged - len(n)} acknowledged frames lost"
    assert_gapless(n, sender)
    assert lost.blocks_missing == lost.blocks_corrupt == lost.frames_dropped == 0, lost.text
    return acknowledged, len(n)


def cut(folder: Path, i: int, seed: int = 5) -> tuple[int, int] | None:
    """Cut the power, every other time of an unthrottled one; None where nothing can be mounted."""
    place = folder / f"cut{i}"
    done = cut_once(place, np.random.default_rng([seed, i]).uniform(0.5, 3.0), hot=i % 2 == 1)
    shutil.rmtree(place)
    return done
