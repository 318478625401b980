"""R5: a disk in mid-write as a power cut leaves it: what only the kernel had is gone."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from daq.journal.folder import segments_in

from .crash_frames import read_numbers

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


def cut_once(folder: Path, after_s: float) -> tuple[int, int] | None:
    """Copy a disk in mid-write and read what is on it; None where that is not possible.

    The writer is halted for the copy, so that the image is of one moment: all that had only
    reached the kernel's cache is not on it.

    Returns
    -------
    (int, int)
        Frames acknowledged, and read from the copy after the file system's own recovery.

    Raises
    ------
    AssertionError
        If an acknowledged frame is lost, or a frame is not what was written.
    """
    folder.mkdir()
    image, copy = folder / "disk", folder / "copy"
    with image.open("wb") as file:
        file.truncate(_IMAGE_BYTES)
    made = subprocess.run(["mkfs.ext4", "-q", str(image)], capture_output=True, check=False)
    if made.returncode:
        return None
    with mounted(image, folder / "live") as allowed:
        if not allowed:
            return None
        journal = folder / "live" / "journal"
        command = [sys.executable, "-m", "tests.daq.crash_kills", str(journal), ""]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            told = [writer.stdout.readline()]
            deadline_s = time.monotonic() + after_s
            while time.monotonic() < deadline_s:
                told.append(writer.stdout.readline())
            writer.send_signal(signal.SIGSTOP)
            os.waitpid(writer.pid, os.WUNTRACED)
            shutil.copyfile(image, copy)
            writer.send_signal(signal.SIGKILL)
            told += writer.stdout.readlines()
    acknowledged = int([line for line in told if line.endswith("\n")][-1])
    with mounted(copy, folder / "after") as allowed:
        assert allowed, "the copy cannot be mounted"
        read = read_numbers(segments_in(folder / "after" / "journal"))
    assert np.array_equal(read, np.arange(len(read))), "frames are missing, doubled or in disorder"
    assert len(read) >= acknowledged, f"{acknowledged - len(read)} acknowledged frames lost"
    return acknowledged, len(read)


def cuts(folder: Path, count: int, seed: int = 5) -> list[tuple[int, int]] | None:
    """Cut the power so often; None where disks cannot be mounted."""
    rng = np.random.default_rng(seed)
    done = []
    for i in range(count):
        one = cut_once(folder / f"cut{i}", rng.uniform(0.5, 3.0))
        if one is None:
            return None
        done.append(one)
        shutil.rmtree(folder / f"cut{i}")
    return done
