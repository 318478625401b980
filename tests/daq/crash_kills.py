"""R1: the whole `bumpbench record` under SIGKILL at random moments, paced and unthrottled."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .crash_process import RecorderProcess, assert_gapless, recovered
from .crash_sender import Sender

KILLS_A_FOLDER = 10
"""Kills of recorders that take up each other's recording, before the next folder is begun."""


@dataclass(frozen=True, slots=True)
class Kills:
    """Kills in one folder: how many, frames acknowledged and read at the end, runs recovered."""

    kills: int
    acknowledged: int
    read: int
    runs: int
    in_flight: tuple[int, ...]
    """Frames that a paced sender had sent and that were not stored, one for each kill."""


def kill_series(folder: Path, count: int, rng: np.random.Generator, *, hot: bool) -> Kills:
    """Kill `count` recorders that take up one recording, recover after each, and end the last.

    Raises
    ------
    AssertionError
        If a frame that was acknowledged before any kill is lost, or any is doubled or altered.
    """
    before = np.empty(0, np.int64)
    acknowledged, in_flight = 0, []
    folder.mkdir(parents=True)
    with Sender(hot=hot) as sender:
        for _ in range(count):
            with RecorderProcess(folder / "out", sender) as recorder:
                if rng.random() < 0.1:  # while it starts
                    time.sleep(rng.uniform(0.2, 2.0))
                else:
                    recorder.wait_open()
                    deadline_s = time.monotonic() + rng.uniform(0.05, 2.0)
                    while time.monotonic() < deadline_s:
                        acknowledged = max(acknowledged, recorder.status().disk.recorded_frames)
                sent = sender.sent
            found = recovered(folder / "out", sender)
            n = found.numbers
            assert len(n) >= acknowledged, f"{acknowledged - len(n)} acknowledged frames lost"
            assert np.array_equal(n[: len(before)], before), "earlier frames are gone"
            assert_gapless(n, sender)
            lost = found.lost
            assert lost.blocks_missing == lost.blocks_corrupt == lost.frames_dropped == 0
            if not hot and len(n) > len(before):
                in_flight.append(sent - 1 - int(n[-1]))
            before = n
        with RecorderProcess(folder / "out", sender) as last:
            last.wait_open()
            time.sleep(0.3)
            stop = sender.pause()
            expected = len(before) + stop - sender.openings[-1]
            last.until(lambda status: status.disk.recorded_frames == expected)
            last.end()
        found = recovered(folder / "out", sender)
        assert_gapless(found.numbers, sender)
        assert len(found.numbers) == expected
        assert found.numbers[-1] == stop - 1
        lost = found.lost  # a write that a kill cut off is no frame that was acknowledged
        assert lost.blocks_missing == lost.blocks_corrupt == lost.frames_dropped == 0, lost.text
    return Kills(count, acknowledged, expected, found.runs, tuple(in_flight))


def kills(folder: Path, first: int, count: int, seed: int = 1) -> Kills:
    """Kill the `first` and following of a campaign's recorders, every other folder unthrottled."""
    rng = np.random.default_rng([seed, first])
    place = folder / f"kills{first}"
    done = kill_series(place, count, rng, hot=first // KILLS_A_FOLDER % 2 == 1)
    shutil.rmtree(place)
    return done
